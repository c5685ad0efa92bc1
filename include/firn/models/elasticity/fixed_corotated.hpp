// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/fields.hpp>
#include <firn/math/singular_values.hpp>
#include <firn/models/lame.hpp>
#include <firn/models/response.hpp>

namespace firn
{

/// The fixed corotated law in principal stretches sigma (Stomakhin et al. 2012, section 3), shared by the
/// elastic solid and by snow: Psi = mu sum (sigma_i - 1)^2 + lambda/2 (J - 1)^2.
template <class Real, int d>
struct CorotatedPrincipal
{
    Vector<Real, d>
        kirchhoff;     ///< principal Kirchhoff stresses 2 mu (sigma_i - 1) sigma_i + lambda (J - 1) J [Pa]
    Real wave_modulus; ///< max_i sigma_i^2 Psi_ii = 2 mu sigma_1^2 + lambda J^2 [Pa], not below its value at
                       ///< rest

    FIRN_HOST_DEVICE CorotatedPrincipal(Vector<Real, d> const& sigma, Real mu, Real lambda)
    {
        Real J = sigma[0];
        for (int i = 1; i < d; ++i) J = J * sigma[i];
        Real const pressure = lambda * (J - Real(1)) * J;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) kirchhoff[i] = Real(2) * mu * (sigma[i] - Real(1)) * sigma[i] + pressure;
        // The shear values 2 mu sigma_1^2 (1 - 1/(sigma_i + sigma_j)) are always below the longitudinal one.
        wave_modulus = max(Real(2) * mu * sigma[0] * sigma[0] + lambda * J * J, lambda + Real(2) * mu);
    }
};

/// Fixed corotated solid: Psi = mu |F - R|^2 + lambda/2 (J - 1)^2 with the rotation R of the polar
/// decomposition (Stomakhin et al. 2012, eq. 6). Finite under inversion, from which it recovers; soft towards
/// J = 0.
template <class SpaceType>
struct FixedCorotated
{
    using Space = SpaceType;
    using Number = typename Space::Real;
    using State = Fields<DisplacementGradient>;
    static constexpr auto name = "fixed_corotated";

    Number density = 1000;                            ///< [kg/m^3]
    Lame<Number> elasticity = lame<Number>(1e5, 0.3); ///< [Pa]

    void validate() const
    {
        require_density(density, "FixedCorotated");
        elasticity.validate("FixedCorotated");
    }

    /// tau = 2 mu (F - R) F^T + lambda (J - 1) J I, from the singular values of F.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        H = deformed<Real, d>(H, velocity_gradient, dt);
        auto const svd = singular_values(deformation_gradient<Real, d>(H));
        CorotatedPrincipal<Real, d> const principal(svd.sigma, Real(elasticity.mu), Real(elasticity.lambda));

        Response<Real, d> response;
        response.kirchhoff_stress = svd.U * principal.kirchhoff.asDiagonal() * svd.U.transpose();
        response.wave_modulus = principal.wave_modulus;
        response.inverted = nowhere<Real>();
        response.capped = nowhere<Real>();
        return response;
    }
};

} // namespace firn
