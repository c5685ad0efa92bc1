// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/transfer/pic.hpp>

namespace firn
{

/// Extended PIC (Hammerquist & Nairn 2017, *A new method for material point method particle updates that
/// reduces noise and enhances stability*): particles lose only the part of their velocities that the grid
/// cannot resolve.
///
///   v <- (I - (I - S S+)^m) v + dt S a
///
/// with S from nodes to particles and S+, weighted by mass, back. Order 1 is PIC; the higher the order, the
/// nearer it is to FLIP without its noise on the grid. Each order beyond the first is a pass to the particles
/// and back: see ExtendVelocities. Positions move with the grid. Stores nothing. Not with a ReflectingWall.
struct Xpic
{
    int order = 5; ///< m

    static constexpr auto name = "xpic";
    using State = Fields<Velocity>;
    using Stored = Fields<>;

    template <class Kernel>
    static constexpr Terms scatter_terms{.gradient = true};
    template <class Kernel>
    static constexpr Terms gather_terms{.gradient = true};
    static constexpr bool keeps_old_velocity = true;
    static constexpr bool moves_with_grid = true;
    static constexpr double fraction = 0; ///< a particle keeps no share of its own velocity beyond the grid's

    int passes() const { return order - 1; } ///< to the particles and back, in every step

    void for_each_parameter(auto const& use) const { use("order", order); }

    void validate() const
    {
        require(order >= 1 && order <= 100, "the order is outside [1, 100]", "Xpic",
                "Pass 1 for PIC, or more for less damping, e.g. 5.");
    }

    /// m v, and separately the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, Matrix<Real, d> const& stress_impulse, Real cell_size) const
    {
        return Pic{}.scatter<Kernel, Real, d>(particle, mass, stress_impulse, cell_size);
    }

    /// v = sum w (v_i - (v_i^n - v_i*)), v_i* being the extended velocity: nodes store v_i^n - v_i* in place
    /// of the old velocity. Returns L = sum of v_i dw_i^T [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        particle[Velocity{}] = gathered.velocity - gathered.old_velocity;
        return gathered.gradient * inverse_cell_size;
    }
};

} // namespace firn
