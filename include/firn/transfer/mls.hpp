// SPDX-License-Identifier: MIT
#pragma once

#include <firn/transfer/apic.hpp>

namespace firn
{

/// MLS-MPM (Hu et al. 2018): APIC whose affine matrix is also the velocity gradient, and whose force is the
/// matching moving-least-squares one, so that no kernel gradient is needed. With the tent, which has no
/// constant inertia, it is APIC.
struct Mls
{
    static constexpr auto name = "mls";
    using State = Apic::State;
    using Stored = Apic::Stored;

    template <class Kernel>
    static constexpr Terms scatter_terms{.affine = true, .gradient = !HasConstantInertia<Kernel>};
    template <class Kernel>
    static constexpr Terms gather_terms{.affine = HasConstantInertia<Kernel>,
                                        .gradient = !HasConstantInertia<Kernel>};
    static constexpr bool keeps_old_velocity = false;
    static constexpr bool moves_with_grid = true;

    /// m v + (m C - dt V0 D^-1 tau) (x_i - x_p) (Hu et al. 2018, eq. 18).
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, Matrix<Real, d> const& stress_impulse, Real cell_size) const
    {
        if constexpr (!HasConstantInertia<Kernel>)
            return Apic{}.scatter<Kernel, Real, d>(particle, mass, stress_impulse, cell_size);
        else {
            ParticleContribution<Real, d> contribution;
            contribution.momentum = particle[Velocity{}] * mass;
            contribution.affine = particle[AffineVelocity{}] * (mass * cell_size) +
                                  stress_impulse * Real(ScalarOf<Real>(Kernel::inverse_inertia));
            return contribution;
        }
    }

    /// v = sum w v_i, C = (sum w v_i (x_i - x_p)^T) D^-1; returns L = C [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        if constexpr (!HasConstantInertia<Kernel>)
            return Apic{}.gather<Kernel, Real, d>(particle, gathered, inverse_cell_size);
        else {
            particle[Velocity{}] = gathered.velocity;
            particle[AffineVelocity{}] = gathered.affine * inverse_cell_size;
            return copy_of(particle[AffineVelocity{}]);
        }
    }
};

} // namespace firn
