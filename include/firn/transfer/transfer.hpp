// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/core/lane.hpp>

#include <concepts>

// A transfer scheme defines what a particle scatters to the nodes of its stencil and what it gathers from
// them. The phases do the sums; a scheme names the terms it needs, and a phase computes no other. Of the
// fields that a scheme adds to a particle (State), only those that the next step needs are stored from step
// to step (Stored). The others are those of the last gather, and are regathered on request.
namespace firn
{

/// Terms of a sum over a stencil beside the plain one (weighted by w_i).
struct Terms
{
    bool affine = false;   ///< weighted by w_i and the distance x_i - x_p
    bool gradient = false; ///< weighted by the gradient of w_i
};

/// A particle's contribution to node i: w_i (momentum + affine (x_i - x_p)) + gradient dw_i, distances in
/// cells.
template <class Real, int d>
struct ParticleContribution
{
    Vector<Real, d> momentum; ///< [kg m/s]
    Matrix<Real, d> affine;   ///< [kg m/s per cell]; set if scatter_terms have Terms::affine
    Matrix<Real, d> gradient; ///< [kg m/s]; set if scatter_terms have Terms::gradient
};

/// The sums that a particle gathers from its nodes, distances in cells.
template <class Real, int d>
struct Gathered
{
    Vector<Real, d> velocity; ///< sum of w_i v_i [m/s]
    /// sum of w_i v_i^n, before the forces of the step, if the scheme keeps the old velocity; for schemes
    /// that extend velocities, sum of w_i (v_i^n - v_i*), see Xpic [m/s]
    Vector<Real, d> old_velocity;
    Matrix<Real, d> affine;   ///< sum of w_i v_i (x_i - x_p)^T D^-1 [m/s per cell]; if gather_terms have it
    Matrix<Real, d> gradient; ///< sum of v_i dw_i^T [m/s per cell]; if gather_terms have it
};

/// Whether a scheme extends nodal velocities in `passes()` passes to the particles and back, see Xpic.
template <class Transfer>
concept ExtendsVelocities = requires(Transfer const transfer)
{
    transfer.passes();
};

/// Whether the kernel has one inertia D for all positions. B-splines of degree two and three do, the tent
/// does not.
template <class Kernel>
concept HasConstantInertia = requires
{
    Kernel::inverse_inertia;
};

} // namespace firn
