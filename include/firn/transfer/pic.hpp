// SPDX-License-Identifier: MIT
#pragma once

#include <firn/transfer/transfer.hpp>

namespace firn
{

/// Particle-in-cell (Harlow 1964): particles take the grid's velocity. Very stable and very damped: angular
/// momentum and shear decay with every step, so that a smaller step damps more.
struct Pic
{
    static constexpr auto name = "pic";
    using State = Fields<Velocity>;
    using Stored = Fields<>;

    template <class Kernel>
    static constexpr Terms gives{.gradient = true};
    template <class Kernel>
    static constexpr Terms takes{.gradient = true};
    static constexpr bool keeps_old_velocity = false;
    static constexpr bool moves_with_grid = true;

    /// m v, and the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Given<Real, d> give(Particle const& particle, Real mass,
                                         Matrix<Real, d> const& stress_impulse, Real) const
    {
        Given<Real, d> given;
        given.momentum = particle[Velocity{}] * mass;
        given.gradient = stress_impulse;
        return given;
    }

    /// Sets the particle's velocity; returns the velocity gradient L = sum of v_i dw_i^T [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> take(Particle& particle, Gathered<Real, d> const& gathered,
                                          Real inverse_cell_size) const
    {
        particle[Velocity{}] = gathered.velocity;
        return gathered.gradient * inverse_cell_size;
    }
};

} // namespace firn
