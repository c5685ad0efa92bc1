// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/models/elasticity/split_neo_hookean.hpp>

namespace firn
{

/// Mooney's and Rivlin's law of rubber, in which a part of the shear modulus belongs to the second invariant
/// of the shape (Mooney 1940; Rivlin 1948; Bonet & Wood 2008, section 6.6.1 with C_10 = (1 - b) mu / 2 and
/// C_01 = b mu / 2):
///
///   Psi = mu/2 ((1 - b) (I_1 - 3) + b (I_2 - 3)) + kappa/2 ((J^2 - 1)/2 - ln J)
///   I_1 = J^(-2/3) sum sigma_i^2,   I_2 = J^(-4/3) sum_(i<j) sigma_i^2 sigma_j^2,   kappa = lambda + 2/3 mu
///
/// In two dimensions the strain is plane, and the third stretch is 1. With b = 0 in three dimensions it is
/// the split neo-Hookean law.
template <class Number>
struct MooneyRivlinLaw : MeasuredByExtension, RefusesInversion
{
    static constexpr auto name = "mooney_rivlin";

    Number second = Number(0.25); ///< b, in [0, 1]

    void for_each_parameter(auto const& use) const { use("second", second); }

    void validate() const
    {
        require(is_between(0, second, 1), "the share of the second invariant is outside [0, 1]", name,
                "Pass C_01 / (C_10 + C_01), e.g. 0.25.");
    }

    /// tau_i = A (x_i - mean x) + B (mean y - y_i) + kappa/2 (J^2 - 1) with A = (1 - b) mu J^(-2/3),
    /// B = b mu J^(-4/3), x_i = sigma_i^2 - 1, and y_i that of the other two, sigma_j^2 sigma_k^2 - 1: no
    /// difference of numbers that are 1 at rest.
    ///
    /// The wave modulus is the largest of three: sigma_i^2 Psi_ii = A (5 (mean x + 1) - (x_i + 1)) / 3 + B (5
    /// (y_i + 1) - (mean y + 1)) / 3 + kappa/2 (J^2 + 1) along the shortest stretch, the shear value
    /// sigma_i^2 (A + B sigma_k^2) of two axes i and j, and the value at rest.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE PrincipalStress<Real, d> stress(Vector<Real, d> const& extension, Real mu,
                                                     Real lambda) const
    {
        Real const one(1), third(Number(1.0 / 3)), two_thirds(Number(2.0 / 3));
        Vector<Real, d> const in_scene = squares_less_one<Real, d>(extension);
        Vector<Real, 3> x = zeros<Vector<Real, 3>>(), y;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) x[i] = in_scene[i];
        FIRN_UNROLL
        for (int i = 0; i < 3; ++i) {
            Real const j = x[(i + 1) % 3], k = x[(i + 2) % 3];
            y[i] = j + k + j * k;
        }
        Real const volume = volume_change<Real, d>(extension), J = one + volume;
        Real const root = root_of_volume<3>(select(J > Real(0), J, one)), square = root * root;
        Real const A = mu * (one - Real(second)) / square, B = mu * Real(second) / (square * square);
        Real const bulk = lambda + two_thirds * mu;
        Real const pressure = Real(Number(0.5)) * bulk * volume * (J + one);
        Real const mean_x = (x[0] + x[1] + x[2]) * third, mean_y = (y[0] + y[1] + y[2]) * third;
        PrincipalStress<Real, d> found;
        Real least = x[0], most = x[0], most_of_two = y[0];
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            found.kirchhoff[i] = A * (x[i] - mean_x) + B * (mean_y - y[i]) + pressure;
            least = min(least, x[i]);
            most = max(most, x[i]);
            most_of_two = max(most_of_two, y[i]);
        }
        Real const five_thirds(Number(5.0 / 3));
        Real const longitudinal = A * (five_thirds * (mean_x + one) - third * (least + one)) +
                                  B * (five_thirds * (most_of_two + one) - third * (mean_y + one)) +
                                  pressure + bulk;
        Real const shear = A * (most + one) + B * (most_of_two + one);
        found.wave_modulus = max(max(longitudinal, shear), lambda + Real(2) * mu);
        return found;
    }

    /// With X_i = x_i + 1, Y_i = y_i + 1 and the stress as above: d tau_i / d ln sigma_j = A (2 X_i delta_ij
    /// - 2/3 (X_i + X_j - mean X)) + B (4/3 (Y_i - mean Y) + 2/3 (3 mean Y - Y_j) - 2 Y_i (1 - delta_ij)) +
    /// kappa J^2. With c as what is the same in all tau_i = A X_i - B Y_i + c, the shear value is A + B J^2
    /// (sigma_i^2 + sigma_i sigma_j + sigma_j^2) / (sigma_i sigma_j)^3 - c / (sigma_i sigma_j).
    template <Lane Real, int d>
    FIRN_HOST_DEVICE PrincipalTangent<Real, d> tangent(Vector<Real, d> const& extension, Real mu,
                                                       Real lambda) const
    {
        Real const one(1), two(2), third(Number(1.0 / 3)), two_thirds(Number(2.0 / 3));
        Real const volume = volume_change<Real, d>(extension), J = one + volume,
                   root = root_of_volume<3>(select(J > Real(0), J, one)), square = root * root,
                   A = mu * (one - Real(second)) / square, B = mu * Real(second) / (square * square),
                   bulk = lambda + two_thirds * mu, pressure = Real(Number(0.5)) * bulk * volume * (J + one);
        Vector<Real, 3> X, Y;
        for (int i = 0; i < 3; ++i) {
            Real const sigma = i < d ? one + extension[i < d ? i : 0] : one;
            X[i] = sigma * sigma;
        }
        for (int i = 0; i < 3; ++i) Y[i] = X[(i + 1) % 3] * X[(i + 2) % 3];
        Real const mean_X = (X[0] + X[1] + X[2]) * third, mean_Y = (Y[0] + Y[1] + Y[2]) * third,
                   same = pressure - A * mean_X + B * mean_Y;
        PrincipalTangent<Real, d> found;
        found.stretching = make_matrix<Real, d>([&](int i, int j) {
            Real const both = A * two_thirds * (mean_X - X[i] - X[j]) +
                              B * two_thirds * (two * (Y[i] - mean_Y) + Real(3) * mean_Y - Y[j]) +
                              bulk * J * J;
            return i == j ? both + two * A * X[i] - (A * X[i] - B * Y[i] + same) : both - two * B * Y[i];
        });
        found.shearing = make_matrix<Real, d>([&](int i, int j) {
            Real const one_of = one + extension[i], other = one + extension[j], area = one_of * other,
                       inverse = one / select(area > Real(0), area, one), inverse_J = J * inverse;
            return A - same * inverse + B * inverse_J * inverse_J * inverse * (X[i] + X[j] + area);
        });
        return found;
    }

    /// Psi [Pa]: I_1 / 3 and I_2 / 3 from their logarithms, which are of the second order in the strains.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE Real energy(Vector<Real, d> const& extension, Real mu, Real lambda) const
    {
        Real const third(Number(1.0 / 3)), two_thirds(Number(2.0 / 3)), b(second);
        Vector<Real, d> const x = squares_less_one<Real, d>(extension);
        Real sum = x[0] + x[1], products = x[0] * x[1];
        if constexpr (d == 3) {
            products += sum * x[2];
            sum += x[2];
        }
        Real const volume = volume_change<Real, d>(extension),
                   shape = two_thirds * (stretch_remainder<Real, d>(extension) + log_remainder(volume));
        Real const log_of_first = shape - log_remainder(sum * third);
        Real const log_of_second =
            Real(2) * shape + products * third - log_remainder((Real(2) * sum + products) * third);
        return Real(Number(1.5)) * mu *
                   ((Real(1) - b) * exp_minus_one(log_of_first) + b * exp_minus_one(log_of_second)) +
               detail::energy_of_volume(volume, lambda + two_thirds * mu);
    }
};

/// Mooney–Rivlin solid: rubber that stiffens less in shear with stretch than a neo-Hookean one. An inverted
/// particle is an error.
template <class Space>
using MooneyRivlin = Elastoplastic<MooneyRivlinLaw<typename Space::Scalar>, NoFlow<Space>>;

} // namespace firn
