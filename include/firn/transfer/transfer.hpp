// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/core/lane.hpp>

#include <concepts>

// A transfer scheme says what a particle gives to the nodes of its stencil and what it takes from them. The
// phases do the sums; a scheme names the terms it needs, and a phase computes no other. Of the fields that a
// scheme gives a particle (its State), only those are stored from step to step that the next step asks for
// (Stored): the others are what was taken from the grid last, and are taken again when somebody wants to
// know.
namespace firn
{

/// Terms of a sum over a stencil beside the plain one (weighted by w_i).
struct Terms
{
    bool affine = false;   ///< weighted by w_i and the distance x_i - x_p
    bool gradient = false; ///< weighted by the gradient of w_i
};

/// What a particle gives to node i: w_i (momentum + affine (x_i - x_p)) + gradient dw_i, distances in cells.
template <class Real, int d>
struct ParticleContribution
{
    Vector<Real, d> momentum; ///< [kg m/s]
    Matrix<Real, d> affine;   ///< [kg m/s per cell]; set if the scheme gives Terms::affine
    Matrix<Real, d> gradient; ///< [kg m/s]; set if the scheme gives Terms::gradient
};

/// What a particle finds on its nodes, distances in cells.
template <class Real, int d>
struct Gathered
{
    Vector<Real, d> velocity; ///< sum of w_i v_i [m/s]
    /// sum of w_i v_i before the forces of the step, if the scheme keeps it; of what extending took from
    /// them, if it extends velocities
    Vector<Real, d> old_velocity;
    Matrix<Real, d> affine;   ///< sum of w_i v_i (x_i - x_p)^T D^-1 [m/s per cell]; if it takes Terms::affine
    Matrix<Real, d> gradient; ///< sum of v_i dw_i^T [m/s per cell]; if the scheme takes Terms::gradient
};

/// Whether a scheme extends the velocities of nodes by `passes()` to the particles and back, see Xpic.
template <class Transfer>
concept ExtendsVelocities = requires(Transfer const transfer)
{
    transfer.passes();
};

/// Whether the kernel has one inertia D for all positions (B-splines of order two and three have, the tent
/// has not).
template <class Kernel>
concept HasConstantInertia = requires
{
    Kernel::inverse_inertia;
};

} // namespace firn
