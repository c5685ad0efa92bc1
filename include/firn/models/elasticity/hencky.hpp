// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elastoplastic.hpp>
#include <firn/models/principal_product.hpp>

namespace firn
{

/// St. Venant–Kirchhoff's law of logarithmic (Hencky) strains eps_i = ln sigma_i:
/// Psi = mu sum eps_i^2 + lambda/2 (sum eps_i)^2 (Klár et al. 2016, eq. 26).
struct HenckyLaw : RefusesInversion
{
    static constexpr auto name = "hencky";
    /// Smaller stretches are clamped to this one, and the particle counts as capped: there is no logarithm at
    /// 0.
    static constexpr double smallest_stretch = 1e-4;

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Mask<Real> capped(Vector<Real, d> const& extension)
    {
        Mask<Real> below = no_lanes<Real>();
        FIRN_UNROLL
        for (int i = 0; i < d; ++i)
            below = below | (extension[i] < Real(ScalarOf<Real>(smallest_stretch - 1)));
        return below;
    }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Vector<Real, d> strains(Vector<Real, d> const& extension)
    {
        Vector<Real, d> strains;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i)
            strains[i] = log_one_plus(max(extension[i], Real(ScalarOf<Real>(smallest_stretch - 1))));
        return strains;
    }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Vector<Real, d> extensions(Vector<Real, d> const& strains)
    {
        Vector<Real, d> extension;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) extension[i] = exp_minus_one(strains[i]);
        return extension;
    }

    /// tau_i = 2 mu eps_i + lambda tr eps.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalStress<Real, d> stress(Vector<Real, d> const& strains, Real mu,
                                                            Real lambda)
    {
        Real trace = strains[0], low = strains[0], high = strains[0];
        FIRN_UNROLL
        for (int i = 1; i < d; ++i) {
            trace += strains[i];
            low = min(low, strains[i]);
            high = max(high, strains[i]);
        }
        PrincipalStress<Real, d> found;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) found.kirchhoff[i] = Real(2) * mu * strains[i] + lambda * trace;
        // sigma_i^2 Psi_ii = lambda + 2 mu - tau_i. The shear value sigma_1^2 (tau_1 - tau_3) / (sigma_1^2 -
        // sigma_3^2) = 2 mu x / (1 - e^(-2 x)) with x = eps_1 - eps_3 is at most mu (1 + 2 x), and that at
        // rest.
        Real const rest = lambda + Real(2) * mu;
        Real const longitudinal = rest - (Real(2) * mu * low + lambda * trace);
        found.wave_modulus = max(max(longitudinal, mu * (Real(1) + Real(2) * (high - low))), rest);
        return found;
    }

    /// sigma_i sigma_j Psi_ij = lambda + (2 mu - tau_i) where i = j, and with x = (sigma_i - sigma_j) /
    /// sigma_j the shear value (2 mu (ln(1 + x) / x - eps_j) - lambda tr eps) / (sigma_i sigma_j).
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalTangent<Real, d> tangent(Vector<Real, d> const& extension, Real mu,
                                                              Real lambda)
    {
        Vector<Real, d> const eps = strains<Real, d>(extension);
        Real const one(1), trace = sum_of<Real, d>([&](int i) { return eps[i]; }), twice = mu + mu;
        auto const stretch = [&](int i) {
            return max(one + extension[i], Real(ScalarOf<Real>(smallest_stretch)));
        };
        PrincipalTangent<Real, d> found;
        found.stretching = make_matrix<Real, d>([&](int i, int j) {
            return i == j ? lambda + twice - (twice * eps[i] + lambda * trace) : lambda;
        });
        found.shearing = make_matrix<Real, d>([&](int i, int j) {
            Real const sigma = stretch(j), x = (stretch(i) - sigma) / sigma;
            Mask<Real> const differs = abs(x) > Real(ScalarOf<Real>(1e-6)); // 1 - x / 2 else
            Real const share = select(differs, log_one_plus(x) / select(differs, x, one),
                                      one - x * Real(ScalarOf<Real>(0.5)));
            return (twice * (share - eps[j]) - lambda * trace) / (stretch(i) * sigma);
        });
        return found;
    }

    /// Psi [Pa].
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Real energy(Vector<Real, d> const& strains, Real mu, Real lambda)
    {
        Real const trace = sum_of<Real, d>([&](int i) { return strains[i]; });
        return mu * dot<Real, d>(strains, strains) + Real(ScalarOf<Real>(0.5)) * lambda * trace * trace;
    }
};

/// St. Venant–Kirchhoff–Hencky solid: linear in the logarithms of the stretches, for large strains in
/// compression; under tension it softens, and beyond a stretch of about e loses its stability.
template <class Space>
using Hencky = Elastoplastic<HenckyLaw, NoFlow<Space>>;

} // namespace firn
