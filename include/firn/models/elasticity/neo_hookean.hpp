// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/fields.hpp>
#include <firn/models/lame.hpp>
#include <firn/models/response.hpp>

namespace firn
{

/// Compressible neo-Hookean solid with a logarithmic volume term:
/// Psi = mu/2 (|F|^2 - d) - mu ln J + lambda/2 (ln J)^2 (Bonet & Wood 2008, eq. 6.27).
/// Rubber and jelly. Infinitely stiff towards J = 0; an inverted particle is an error.
template <class SpaceType>
struct NeoHookean
{
    using Space = SpaceType;
    using Number = typename Space::Real;
    using State = Fields<DeformationGradient>;
    static constexpr auto name = "neo_hookean";

    Number density = 1000;                            ///< [kg/m^3]
    Lame<Number> elasticity = lame<Number>(1e5, 0.3); ///< [Pa]

    void validate() const
    {
        require_density(density, "NeoHookean");
        elasticity.validate("NeoHookean");
    }

    /// tau = mu (F F^T - I) + lambda ln J I.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        Matrix<Real, d>& F = state[DeformationGradient{}];
        F = deformed<Real, d>(F, velocity_gradient, dt);

        Real const J = F.determinant();
        Mask<Real> const inverted = !(J > Real(0));
        Real const log_J = log(select(inverted, Real(1), J));

        Response<Real, d> response;
        Matrix<Real, d> const b = F * F.transpose();
        response.kirchhoff_stress = b * mu;
        for (int i = 0; i < d; ++i) response.kirchhoff_stress(i, i) += lambda * log_J - mu;
        response.wave_modulus = wave_modulus(b, log_J);
        response.inverted = inverted;
        response.capped = nowhere<Real>();
        return response;
    }

private:
    /// The largest of sigma_i^2 Psi_ii = mu (sigma_i^2 + 1) + lambda (1 - ln J) and the shear value mu
    /// sigma_1^2, not below its value at rest. The largest row sum of |b| stands for sigma_1^2: it is never
    /// below, and exact at rest.
    template <class Real>
    FIRN_HOST_DEVICE Real wave_modulus(Matrix<Real, Space::dimension> const& b, Real log_J) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        Real stretch2(0);
        for (int i = 0; i < d; ++i) {
            Real row(0);
            for (int j = 0; j < d; ++j) row += abs(b(i, j));
            stretch2 = max(stretch2, row);
        }
        Real const longitudinal = mu * (stretch2 + Real(1)) + lambda * (Real(1) - log_J);
        return max(max(longitudinal, mu * stretch2), Real(elasticity.p_wave_modulus()));
    }
};

} // namespace firn
