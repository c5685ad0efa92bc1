// SPDX-License-Identifier: MIT
#pragma once

#include <firn/transfer/transfer.hpp>

namespace firn
{

/// Particle-in-cell (Harlow 1964): particles get the grid's velocity. Very stable and very damped: angular
/// momentum and shear decay with every step, so that a smaller step damps more.
struct Pic
{
    static constexpr auto name = "pic";
    using State = Fields<Velocity>;
    using Stored = Fields<>;

    template <class Kernel>
    static constexpr Terms scatter_terms{.gradient = true};
    template <class Kernel>
    static constexpr Terms gather_terms{.gradient = true};
    static constexpr bool keeps_old_velocity = false;
    static constexpr bool moves_with_grid = true;

    /// m v, and the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d> scatter(Particle const& particle, Real mass,
                                                           Matrix<Real, d> const& stress_impulse, Real) const
    {
        ParticleContribution<Real, d> contribution;
        contribution.momentum = particle[Velocity{}] * mass;
        contribution.gradient = stress_impulse;
        return contribution;
    }

    /// Sets the particle's velocity; returns the velocity gradient L = sum of v_i dw_i^T [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        particle[Velocity{}] = gathered.velocity;
        return gathered.gradient * inverse_cell_size;
    }
};

} // namespace firn
