// SPDX-License-Identifier: MIT
#pragma once

#include <firn/transfer/transfer.hpp>

namespace firn
{

/// The affine particle-in-cell method (Jiang et al. 2015): particles carry an affine velocity field, so that
/// angular momentum is conserved exactly.
struct Apic
{
    static constexpr auto name = "apic";
    using State = Fields<Velocity, AffineVelocity>;
    using Stored = Fields<>;

    template <class Kernel>
    static constexpr Terms scatter_terms{.affine = true, .gradient = true};
    // With a singular inertia (the tent) C is the velocity gradient itself, which is the same for multilinear
    // weights.
    template <class Kernel>
    static constexpr Terms gather_terms{.affine = HasConstantInertia<Kernel>, .gradient = true};
    static constexpr bool keeps_old_velocity = false;
    static constexpr bool moves_with_grid = true;

    /// m (v + C (x_i - x_p)) (eq. 8), and the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, Matrix<Real, d> const& stress_impulse, Real cell_size) const
    {
        ParticleContribution<Real, d> contribution;
        contribution.momentum = particle[Velocity{}] * mass;
        contribution.affine = particle[AffineVelocity{}] * (mass * cell_size);
        contribution.gradient = stress_impulse;
        return contribution;
    }

    /// v = sum w v_i, C = (sum w v_i (x_i - x_p)^T) D^-1 (eq. 10); returns L = sum of v_i dw_i^T [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        particle[Velocity{}] = gathered.velocity;
        Matrix<Real, d> const gradient = gathered.gradient * inverse_cell_size;
        if constexpr (HasConstantInertia<Kernel>)
            particle[AffineVelocity{}] = gathered.affine * inverse_cell_size;
        else
            particle[AffineVelocity{}] = gradient;
        return gradient;
    }
};

} // namespace firn
