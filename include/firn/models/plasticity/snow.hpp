// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elasticity/fixed_corotated.hpp>

namespace firn
{

/// Snow of Stomakhin et al. 2013: fixed corotated elasticity whose stretches yield outside
/// [1 - critical_compression, 1 + critical_stretch] and whose moduli harden by e^(xi (1 - J_P)) (sections 5
/// and 6). Stores F_E and J_P = det F_P: the stress needs F_P through its determinant alone.
template <class SpaceType>
struct Snow
{
    using Space = SpaceType;
    using Number = typename Space::Real;
    using State = Fields<DisplacementGradient, PlasticVolumeRatio>;
    static constexpr auto name = "snow";

    Number density = 400;                               ///< [kg/m^3]
    Lame<Number> elasticity = lame<Number>(1.4e5, 0.2); ///< at J_P = 1 [Pa]
    Number critical_compression = Number(2.5e-2);       ///< theta_c
    Number critical_stretch = Number(7.5e-3);           ///< theta_s
    Number hardening = 10;                              ///< xi
    /// The range in which J_P hardens or softens; outside, the moduli stay as they are and the particle
    /// counts as capped: e^(xi (1 - J_P)) would otherwise stop the time step (54.6 at 0.6 and xi = 10).
    Number smallest_plastic_ratio = Number(0.6);
    Number largest_plastic_ratio = 20;

    void validate() const
    {
        require_density(density, "Snow");
        elasticity.validate("Snow");
        require(critical_compression >= 0 && critical_compression < 1,
                "the critical compression is outside [0, 1)", "Snow", "Pass theta_c, e.g. 2.5e-2.");
        require(critical_stretch >= 0 && std::isfinite(critical_stretch), "the critical stretch is below 0",
                "Snow", "Pass theta_s, e.g. 7.5e-3.");
        require(hardening >= 0 && std::isfinite(hardening), "the hardening coefficient is below 0", "Snow",
                "Pass xi, e.g. 10.");
        require(smallest_plastic_ratio > 0 && smallest_plastic_ratio <= 1 && largest_plastic_ratio >= 1,
                "the caps of J_P do not enclose 1", "Snow",
                "Pass 0 < smallest <= 1 <= largest, e.g. 0.6 and 20.");
    }

    /// Return map (eqs. 8 and 9 with the clamp of section 7), stress and wave modulus from one SVD.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        Real& J_P = state[PlasticVolumeRatio{}];
        Matrix<Real, d> const trial = deformed<Real, d>(H, velocity_gradient, dt);
        auto const svd = singular_values(deformation_gradient<Real, d>(trial));

        Vector<Real, d> elastic;
        Real plastic_part(1);
        Mask<Real> yields = nowhere<Real>();
        Real const low(Number(1) - critical_compression), high(Number(1) + critical_stretch);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            elastic[i] = min(max(svd.sigma[i], low), high);
            plastic_part = plastic_part * (svd.sigma[i] / elastic[i]);
            yields = yields | !(elastic[i] == svd.sigma[i]);
        }
        // Without yielding F stays as it is: rebuilding it would add the rounding of the SVD with every step.
        Matrix<Real, d> const F_E = svd.U * elastic.asDiagonal() * svd.V.transpose();
        Matrix<Real, d> const mapped = displacement_gradient<Real, d>(F_E);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) FIRN_UNROLL
        for (int j = 0; j < d; ++j) H(i, j) = select(yields, mapped(i, j), trial(i, j));
        // J_P = det F / det F_E, kept track of far beyond the caps, so that it may come back, but not without
        // end.
        Real const far(Number(100));
        J_P = min(max(J_P * plastic_part, Real(smallest_plastic_ratio) / far),
                  Real(largest_plastic_ratio) * far);

        Real const within = min(max(J_P, Real(smallest_plastic_ratio)), Real(largest_plastic_ratio));
        Real const harder = exp(Real(hardening) * (Real(1) - within));
        CorotatedPrincipal<Real, d> const principal(elastic, Real(elasticity.mu) * harder,
                                                    Real(elasticity.lambda) * harder);

        Response<Real, d> response;
        response.kirchhoff_stress = svd.U * principal.kirchhoff.asDiagonal() * svd.U.transpose();
        response.wave_modulus = principal.wave_modulus;
        response.inverted = nowhere<Real>();
        response.capped = !(within == J_P);
        return response;
    }
};

} // namespace firn
