// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/models/lame.hpp>
#include <firn/models/principal_product.hpp>
#include <firn/models/remainders.hpp>
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
    using Number = typename Space::Scalar;
    using State = Fields<DisplacementGradient>;
    static constexpr auto name = "neo_hookean";

    Number density = 1000;                            ///< [kg/m^3]
    Lame<Number> elasticity = lame<Number>(1e5, 0.3); ///< [Pa]

    void for_each_parameter(auto const& use) const { use("elasticity", elasticity); }

    void validate() const
    {
        require_density(density, name);
        elasticity.validate(name);
    }

    /// tau = mu (F F^T - I) + lambda ln J I.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        H = deformed<Real, d>(H, velocity_gradient, dt);

        Real const growth = volume_change<Real, d>(H); // J - 1
        Mask<Real> const inverted = !(growth > Real(-1));
        Real const log_J = log_one_plus(select(inverted, Real(0), growth));

        Response<Real, d> response;
        Matrix<Real, d> const strain = squared_stretch_less_one<Real, d>(H); // F F^T - I
        response.kirchhoff_stress = make_matrix<Real, d>([&](int i, int j) { return strain(i, j) * mu; });
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) response.kirchhoff_stress(i, i) += lambda * log_J;
        response.wave_modulus = wave_modulus(strain, log_J);
        response.inverted = inverted;
        response.capped = no_lanes<Real>();
        return response;
    }

    /// The state in its principal axes, for SemiDefinite: tau_i = mu (sigma_i^2 - 1) + lambda ln J, sigma_i
    /// sigma_j Psi_ij = lambda + (mu sigma_i^2 + mu - lambda ln J) where i = j, and the shear value mu + (mu
    /// - lambda ln J) / (sigma_i sigma_j).
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE StateInAxes<Real, Space::dimension> in_axes(Particle const& state) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda), one(1);
        auto const axes = principal_axes<Real, d>(state[DisplacementGradient{}]);
        Vector<Real, d> const x = squares_less_one<Real, d>(axes.extension);
        Real const growth = volume_change<Real, d>(axes.extension),
                   pressure = lambda * log_one_plus(select(growth > Real(-1), growth, Real(0)));
        StateInAxes<Real, d> in{axes.U, axes.extension, {}, {}};
        for (int i = 0; i < d; ++i) in.kirchhoff[i] = mu * x[i] + pressure;
        in.tangent.stretching = make_matrix<Real, d>(
            [&](int i, int j) { return i == j ? lambda + mu * (x[i] + one) + mu - pressure : lambda; });
        in.tangent.shearing = make_matrix<Real, d>([&](int i, int j) {
            Real const area = (one + axes.extension[i]) * (one + axes.extension[j]);
            return mu + (mu - pressure) / select(area > Real(0), area, one);
        });
        return in;
    }

    /// Q = dP F^T = mu dl b + (mu - lambda ln J) dl^T + lambda tr(dl) I, for dF = dl F and b = F F^T: the
    /// derivative of P = mu F + (lambda ln J - mu) F^-T (Bonet & Wood 2008, eq. 6.28, times F^-T).
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension>
    product(Particle const& state, Matrix<Real, Space::dimension> const& change) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        Matrix<Real, d> const& H = state[DisplacementGradient{}];
        Real const growth = volume_change<Real, d>(H); // J - 1
        Real const turned = mu - lambda * log_one_plus(select(growth > Real(-1), growth, Real(0)));
        Matrix<Real, d> const stretched =
            firn::product<Real, d>(change, squared_stretch_less_one<Real, d>(H));
        Real const grown = lambda * sum_of<Real, d>([&](int i) { return change(i, i); });
        return make_matrix<Real, d>([&](int i, int j) {
            Real const sheared = mu * (stretched(i, j) + change(i, j)) + turned * change(j, i);
            return i == j ? sheared + grown : sheared;
        });
    }

    /// Psi [J/m^3].
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real energy(Particle const& state) const
    {
        constexpr int d = Space::dimension;
        Matrix<Real, d> const& H = state[DisplacementGradient{}];
        Real const growth = volume_change<Real, d>(H), log_J = log_one_plus(growth);
        return Real(elasticity.mu) * (stretch_remainder<Real, d>(H) + log_remainder(growth)) +
               Real(Number(0.5)) * Real(elasticity.lambda) * log_J * log_J;
    }

private:
    /// The largest of sigma_i^2 Psi_ii = mu (sigma_i^2 + 1) + lambda (1 - ln J) and the shear value mu
    /// sigma_1^2, not below its value at rest. The largest row sum of |F F^T| stands for sigma_1^2: it is
    /// never below, and exact at rest.
    template <class Real>
    FIRN_HOST_DEVICE Real wave_modulus(Matrix<Real, Space::dimension> const& strain, Real log_J) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        Real stretch2(0);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            Real row(0);
            FIRN_UNROLL
            for (int j = 0; j < d; ++j) row += i == j ? abs(Real(1) + strain(i, j)) : abs(strain(i, j));
            stretch2 = max(stretch2, row);
        }
        Real const longitudinal = mu * (stretch2 + Real(1)) + lambda * (Real(1) - log_J);
        return max(max(longitudinal, mu * stretch2), Real(elasticity.p_wave_modulus()));
    }
};

} // namespace firn
