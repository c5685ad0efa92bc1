// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/models/response.hpp>
#include <firn/transfer/apic.hpp>

namespace firn
{

/// Affine FLIP that lets particles separate (Fei et al. 2021): APIC whose particles keep a share of their own
/// velocity, as in FLIP, and also move by it where material separates. For spray, and thrown sand.
///
/// Stores the velocity; the affine matrix is gathered anew in every step. With `separation` = 0 it is the
/// affine FLIP of that paper (AFLIP).
struct Asflip
{
    double fraction =
        0.97; ///< alpha: the share of its own velocity, beyond the grid's, that a particle keeps
    double separation = 1.0; ///< the share of that velocity by which it moves where material separates

    static constexpr auto name = "asflip";
    using State = Fields<Velocity, AffineVelocity>;
    using Stored = Fields<Velocity>;

    template <class Kernel>
    static constexpr Terms scatter_terms{.affine = true, .gradient = true};
    template <class Kernel>
    static constexpr Terms gather_terms = Apic::gather_terms<Kernel>;
    static constexpr bool keeps_old_velocity = true;
    static constexpr bool moves_with_grid = false;

    void for_each_parameter(auto const& use) const
    {
        use("fraction", fraction);
        use("separation", separation);
    }

    void validate() const
    {
        require(is_between(0, fraction, 1), "the FLIP fraction is outside [0, 1]", "Asflip",
                "Pass the share of FLIP, e.g. 0.97.");
        require(is_between(0, separation, 1), "the separation is outside [0, 1]", "Asflip",
                "Pass 1, or 0 for particles that move with the grid.");
    }

    /// m (v + C (x_i - x_p)), and separately the force -V0 tau dw_i.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE ParticleContribution<Real, d>
    scatter(Particle const& particle, Real mass, Matrix<Real, d> const& stress_impulse, Real cell_size) const
    {
        return Apic{}.scatter<Kernel, Real, d>(particle, mass, stress_impulse, cell_size);
    }

    /// The velocity [m/s] by which a particle moves, called before gather(): sum w v_i + gamma alpha (v - sum
    /// w v_i^n), with gamma = `separation` where the flow opens and the particle is not compressed, else 0.
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Vector<Real, d> motion(Particle const& particle, Gathered<Real, d> const& gathered) const
    {
        Mask<Real> const open = (!(gathered.gradient.trace() < Real(0))) & (!compressed<Real, d>(particle));
        Real const share(ScalarOf<Real>(fraction * separation));
        return gathered.velocity +
               (particle[Velocity{}] - gathered.old_velocity) * select(open, share, Real(0));
    }

    /// v = sum w v_i + alpha (v - sum w v_i^n), C as APIC's; returns L = sum of v_i dw_i^T [1/s].
    template <class Kernel, Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, d> gather(Particle& particle, Gathered<Real, d> const& gathered,
                                            Real inverse_cell_size) const
    {
        Vector<Real, d>& v = particle[Velocity{}];
        v = gathered.velocity + (v - gathered.old_velocity) * Real(ScalarOf<Real>(fraction));
        Matrix<Real, d> const gradient = gathered.gradient * inverse_cell_size;
        if constexpr (HasConstantInertia<Kernel>)
            particle[AffineVelocity{}] = gathered.affine * inverse_cell_size;
        else
            particle[AffineVelocity{}] = gradient;
        return gradient;
    }

private:
    /// Whether a particle's volume is smaller than at rest by a thousandth or more.
    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE static Mask<Real> compressed(Particle const& particle)
    {
        Real const bound(ScalarOf<Real>(-1e-3));
        if constexpr (requires { particle[DisplacementGradient{}]; })
            return volume_change<Real, d>(particle[DisplacementGradient{}]) < bound;
        else if constexpr (requires { particle[LogVolumeRatio{}]; })
            return particle[LogVolumeRatio{}] < bound;
        else
            return no_lanes<Real>();
    }
};

} // namespace firn
