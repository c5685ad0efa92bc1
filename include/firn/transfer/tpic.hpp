// SPDX-License-Identifier: MIT
#pragma once

#include <firn/transfer/apic.hpp>

namespace firn
{

/// Taylor particle-in-cell (Nakamura et al. 2023): APIC whose affine matrix is the velocity gradient. It
/// needs no inertia of the kernel; angular momentum is conserved well, but not exactly.
struct Tpic
{
    static constexpr auto name = "tpic";
    using State = Apic::State;
    using Stored = Apic::Stored;

    template <class Kernel>
    static constexpr Terms scatter_terms{.affine = true, .gradient = true};
    template <class Kernel>
    static constexpr Terms gather_terms{.gradient = true};
    static constexpr bool keeps_old_velocity = false;
    static constexpr bool moves_with_grid = true;

    /// m (v + C (x_i - x_p)), and the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, Matrix<Real, d> const& stress_impulse, Real cell_size) const
    {
        return Apic{}.scatter<Kernel, Real, d>(particle, mass, stress_impulse, cell_size);
    }

    /// v = sum w v_i, C = sum of v_i dw_i^T; returns L = C [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        particle[Velocity{}] = gathered.velocity;
        particle[AffineVelocity{}] = gathered.gradient * inverse_cell_size;
        return particle[AffineVelocity{}];
    }
};

} // namespace firn
