// SPDX-License-Identifier: MIT
#pragma once

#include <firn/math/largest_eigenvalue.hpp>
#include <firn/models/elastoplastic.hpp>
#include <firn/models/remainders.hpp>

namespace firn
{

/// J^(1/d) of a volume ratio J > 0, by which F splits into volume and shape.
template <int d, Lane Real>
FIRN_HOST_DEVICE inline Real root_of_volume(Real J)
{
    if constexpr (d == 2)
        return sqrt(J);
    else
        return exp(log(J) * Real(ScalarOf<Real>(1.0 / 3)));
}

namespace detail
{
/// kappa/2 ((J^2 - 1)/2 - ln J), the energy of volume that goes with kappa/2 (J^2 - 1) [Pa].
template <Lane Real>
FIRN_HOST_DEVICE inline Real energy_of_volume(Real volume, Real kappa)
{
    Real const half(ScalarOf<Real>(0.5));
    return half * kappa * (half * volume * volume + log_remainder(volume));
}
} // namespace detail

/// The neo-Hookean law that splits shape from volume, with the bulk modulus kappa = lambda + 2 mu / d:
/// Psi = mu/2 (J^(-2/d) |F|^2 - d) + kappa/2 ((J^2 - 1)/2 - ln J) (Simo & Hughes 1998, eq. 9.2.3 and 9.2.6).
struct SplitNeoHookeanLaw : MeasuredByExtension, RefusesInversion
{
    static constexpr auto name = "split_neo_hookean";

    /// tau_i = mu J^(-2/d) (sigma_i^2 - |F|^2 / d) + kappa/2 (J^2 - 1), computed with sigma_i^2 - 1 instead
    /// of the squares, which leaves the deviator as it is.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalStress<Real, d> stress(Vector<Real, d> const& extension, Real mu,
                                                            Real lambda)
    {
        using Number = ScalarOf<Real>;
        Vector<Real, d> const square = squares_less_one<Real, d>(extension);
        Real const volume = volume_change<Real, d>(extension), J = Real(1) + volume;
        Real sum = square[0], least = sum, most = sum;
        FIRN_UNROLL
        for (int i = 1; i < d; ++i) {
            sum += square[i];
            least = min(least, square[i]);
            most = max(most, square[i]);
        }
        Real const root = root_of_volume<d>(select(J > Real(0), J, Real(1)));
        Real const shear = mu / (root * root), bulk = lambda + mu * Real(Number(2.0 / d));
        Real const pressure = Real(Number(0.5)) * bulk * volume * (J + Real(1)),
                   mean = sum * Real(Number(1.0 / d));
        PrincipalStress<Real, d> found;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) found.kirchhoff[i] = shear * (square[i] - mean) + pressure;
        found.wave_modulus = wave_modulus<d>(least, most, mean, shear, pressure, mu, lambda);
        return found;
    }

    /// With p = mu J^(-2/d), the mean m of x_i = sigma_i^2 - 1, and c = kappa/2 (J^2 - 1) - p (m + 1) as the
    /// part of tau_i that is the same for all i: d tau_i / d ln sigma_j = 2 p ((m - x_i - x_j - 1) / d +
    /// sigma_i^2 delta_ij) + kappa J^2, and the shear value p - c / (sigma_i sigma_j).
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalTangent<Real, d> tangent(Vector<Real, d> const& extension, Real mu,
                                                              Real lambda)
    {
        Real const one(1), two(2), share(ScalarOf<Real>(1.0 / d));
        Vector<Real, d> const x = squares_less_one<Real, d>(extension);
        Real const volume = volume_change<Real, d>(extension), J = one + volume,
                   root = root_of_volume<d>(select(J > Real(0), J, one)), p = mu / (root * root),
                   bulk = lambda + mu * two * share,
                   mean = share * sum_of<Real, d>([&](int i) { return x[i]; }),
                   pressure = Real(ScalarOf<Real>(0.5)) * bulk * volume * (J + one);
        PrincipalTangent<Real, d> found;
        found.stretching = make_matrix<Real, d>([&](int i, int j) {
            Real const both = two * p * share * (mean - x[i] - x[j] - one) + bulk * J * J;
            return i == j ? both + two * p * (x[i] + one) - (p * (x[i] - mean) + pressure) : both;
        });
        found.shearing = make_matrix<Real, d>([&](int i, int j) {
            Real const area = (one + extension[i]) * (one + extension[j]);
            return p - (pressure - p * (mean + one)) / select(area > Real(0), area, one);
        });
        return found;
    }

    /// Psi [Pa].
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Real energy(Vector<Real, d> const& extension, Real mu, Real lambda)
    {
        Vector<Real, d> const square = squares_less_one<Real, d>(extension);
        return energy_of<d>(stretch_remainder<Real, d>(extension),
                            sum_of<Real, d>([&](int i) { return square[i]; }),
                            volume_change<Real, d>(extension), mu, lambda);
    }

    /// Psi from stretch_remainder, |F|^2 - d and J - 1: ln(J^(-2/d) |F|^2 / d) is 2/d times the remainder of
    /// the stretch, but for those of the logarithms.
    template <int d, Lane Real>
    FIRN_HOST_DEVICE static Real energy_of(Real remainder, Real sum, Real volume, Real mu, Real lambda)
    {
        using Number = ScalarOf<Real>;
        Real const share(Number(2.0 / d));
        Real const log_of_shape =
            share * (remainder + log_remainder(volume)) - log_remainder(sum * Real(Number(1.0 / d)));
        return mu * Real(Number(0.5 * d)) * exp_minus_one(log_of_shape) +
               detail::energy_of_volume(volume, lambda + mu * share);
    }

    /// From the smallest and the largest sigma_i^2 - 1 and their mean: sigma_i^2 Psi_ii = mu J^(-2/d)
    /// ((1 - 4/d) sigma_i^2 + (2/d + 1) |F|^2 / d) + kappa/2 (J^2 + 1) is largest at the smallest stretch;
    /// the shear value is mu J^(-2/d) sigma_1^2.
    template <int d, Lane Real>
    FIRN_HOST_DEVICE static Real wave_modulus(Real least, Real most, Real mean, Real shear, Real pressure,
                                              Real mu, Real lambda)
    {
        using Number = ScalarOf<Real>;
        Real const one(1), bulk = lambda + mu * Real(Number(2.0 / d));
        Real const longitudinal =
            shear * (Real(Number(1 - 4.0 / d)) * (least + one) + Real(Number(2.0 / d + 1)) * (mean + one)) +
            pressure + bulk;
        return max(max(longitudinal, shear * (most + one)), lambda + Real(2) * mu);
    }
};

/// Neo-Hookean solid in which shape and volume do not couple: for nearly incompressible solids, and as the
/// elasticity of soils and yield-stress fluids. An inverted particle is an error.
///
/// tau = mu J^(-2/d) dev(F F^T) + kappa/2 (J^2 - 1) I: no principal axes are needed.
template <class SpaceType>
struct SplitNeoHookean
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<DisplacementGradient>;
    static constexpr auto name = SplitNeoHookeanLaw::name;

    Number density = 1000;                            ///< [kg/m^3]
    Lame<Number> elasticity = lame<Number>(1e5, 0.3); ///< [Pa]

    void for_each_parameter(auto const& use) const { use("elasticity", elasticity); }

    void validate() const
    {
        require_density(density, name);
        elasticity.validate(name);
    }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda), bulk = lambda + mu * Real(Number(2.0 / d));
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        H = deformed<Real, d>(H, velocity_gradient, dt);
        Real const volume = volume_change<Real, d>(H), J = Real(1) + volume;
        Matrix<Real, d> const square = squared_stretch_less_one<Real, d>(H);

        Response<Real, d> response;
        response.inverted = !(J > Real(0));
        response.capped = no_lanes<Real>();
        Real const root = root_of_volume<d>(select(response.inverted, Real(1), J));
        Real const shear = mu / (root * root), pressure = Real(Number(0.5)) * bulk * volume * (J + Real(1)),
                   mean = square.trace() * Real(Number(1.0 / d));
        response.kirchhoff_stress = square * shear;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) response.kirchhoff_stress(i, i) += pressure - shear * mean;
        Matrix<Real, d> const turned = -square; // its largest eigenvalue is minus the smallest of `square`
        response.wave_modulus = SplitNeoHookeanLaw::wave_modulus<d>(-largest_eigenvalue<Real>(turned),
                                                                    largest_eigenvalue<Real>(square), mean,
                                                                    shear, pressure, mu, lambda);
        return response;
    }

    /// The state in its principal axes, for SemiDefinite.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE StateInAxes<Real, Space::dimension> in_axes(Particle const& state) const
    {
        return state_in_axes<Real, Space::dimension>(SplitNeoHookeanLaw{}, state[DisplacementGradient{}],
                                                     Real(elasticity.mu), Real(elasticity.lambda));
    }

    /// Q = dP F^T = d tau - tau dl^T, for dF = dl F, with b = F F^T, db = dl b + b dl^T and p = mu J^(-2/d):
    /// d tau = p (dev db - 2/d tr(dl) dev b) + kappa J^2 tr(dl) I.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension>
    product(Particle const& state, Matrix<Real, Space::dimension> const& change) const
    {
        constexpr int d = Space::dimension;
        Real const mu(elasticity.mu), lambda(elasticity.lambda), bulk = lambda + mu * Real(Number(2.0 / d)),
                                                                 one(1), share(Number(1.0 / d));
        Matrix<Real, d> const& H = state[DisplacementGradient{}];
        Real const volume = volume_change<Real, d>(H), J = one + volume,
                   root = root_of_volume<d>(select(J > Real(0), J, one)), p = mu / (root * root),
                   pressure = Real(Number(0.5)) * bulk * volume * (J + one);
        Matrix<Real, d> const square = squared_stretch_less_one<Real, d>(H); // b - I
        auto const trace = [](Matrix<Real, d> const& A) {
            return sum_of<Real, d>([&](int i) { return A(i, i); });
        };
        Matrix<Real, d> const turned = firn::product<Real, d>(change, square);
        auto const db = make_matrix<Real, d>(
            [&](int i, int j) { return turned(i, j) + turned(j, i) + change(i, j) + change(j, i); });
        Real const grown = trace(change), mean = trace(square) * share, mean_of_change = trace(db) * share;
        auto const tau = make_matrix<Real, d>(
            [&](int i, int j) { return i == j ? p * (square(i, j) - mean) + pressure : p * square(i, j); });
        return make_matrix<Real, d>([&](int i, int j) {
            Real of_shape = db(i, j) - Real(2) * share * grown * square(i, j);
            if (i == j) of_shape += Real(2) * share * grown * mean - mean_of_change;
            Real const d_tau = i == j ? p * of_shape + bulk * J * J * grown : p * of_shape;
            return d_tau - sum_of<Real, d>([&](int k) { return tau(i, k) * change(j, k); });
        });
    }

    /// Psi [J/m^3].
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real energy(Particle const& state) const
    {
        constexpr int d = Space::dimension;
        Matrix<Real, d> const& H = state[DisplacementGradient{}];
        return SplitNeoHookeanLaw::energy_of<d>(
            stretch_remainder<Real, d>(H), squared_stretch_less_one<Real, d>(H).trace(),
            volume_change<Real, d>(H), Real(elasticity.mu), Real(elasticity.lambda));
    }
};

} // namespace firn
