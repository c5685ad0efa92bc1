// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/math/principal_axes.hpp>
#include <firn/math/product.hpp>

namespace firn
{

/// The second derivatives of an elastic law in its principal stretches sigma.
template <class Real, int d>
struct PrincipalTangent
{
    Matrix<Real, d>
        stretching; ///< sigma_i sigma_j Psi_ij, that is d tau_i / d ln sigma_j less tau_i where i = j
    Matrix<Real, d> shearing; ///< (Psi_i - Psi_j) / (sigma_i - sigma_j) of two axes, free of cancellation
};

/// A state of an isotropic solid in its principal axes, of which a product is made.
template <class Real, int d>
struct StateInAxes
{
    Matrix<Real, d> U;         ///< the axes after the deformation
    Vector<Real, d> extension; ///< sigma - 1
    Vector<Real, d> kirchhoff; ///< tau_i [Pa]
    PrincipalTangent<Real, d> tangent;
};

/// Such a state of F - I, by an elastic law with these moduli.
template <Lane Real, int d, class Law>
FIRN_HOST_DEVICE inline StateInAxes<Real, d> state_in_axes(Law const& law,
                                                           Matrix<Real, d> const& displacement_gradient,
                                                           Real const& mu, Real const& lambda)
{
    auto const axes = principal_axes<Real, d>(displacement_gradient);
    Vector<Real, d> const strains = law.template strains<Real, d>(axes.extension);
    return {axes.U, axes.extension, law.template stress<Real, d>(strains, mu, lambda).kirchhoff,
            law.template tangent<Real, d>(axes.extension, mu, lambda)};
}

/// The part of a symmetric matrix that is positive semi-definite: without its eigenvalues below 0.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> semi_definite_part(Matrix<Real, d> const& symmetric)
{
    Matrix<Real, d> values = symmetric;
    Matrix<Real, d> const axes = detail::axes_of<Real>(values);
    return make_matrix<Real, d>([&](int i, int j) {
        return sum_of<Real, d>([&](int k) { return axes(i, k) * max(values(k, k), Real(0)) * axes(j, k); });
    });
}

/// The product Q = dP F^T with the tangent of an isotropic solid, for dF = dl F, from the axes U after the
/// deformation, extensions sigma - 1, and the principal stresses tau:
///
///   Q_ii = sum_j sigma_i sigma_j Psi_ij d_jj
///   Q_ij = sigma_j ((t + f) / 2 sigma_j d_ij + (t - f) / 2 sigma_i d_ji),   d = U^T dl U
///   t = (Psi_i - Psi_j) / (sigma_i - sigma_j),   f = (Psi_i + Psi_j) / (sigma_i + sigma_j)
///
/// (Smith et al. 2019, *Analytic eigensystems for isotropic distortion energies*, whose twists and flips have
/// f and t as their eigenvalues). With `semi_definite` these are at least 0, and so are the eigenvalues of
/// the first line: then dl : Q is never below 0 (Teran et al. 2005, *Robust quasistatic finite elements and
/// flesh simulation*).
template <Lane Real, int d, bool semi_definite = false>
FIRN_HOST_DEVICE inline Matrix<Real, d> product_in_axes(StateInAxes<Real, d> const& state,
                                                        Matrix<Real, d> const& change)
{
    Matrix<Real, d> const& U = state.U;
    Vector<Real, d> const &extension = state.extension, &kirchhoff = state.kirchhoff;
    PrincipalTangent<Real, d> const& tangent = state.tangent;
    auto const clipped = [](Real const& value) { return semi_definite ? max(value, Real(0)) : value; };
    Matrix<Real, d> stretching = tangent.stretching;
    if constexpr (semi_definite) stretching = semi_definite_part<Real, d>(stretching);
    Real const half(ScalarOf<Real>(0.5)), one(1);
    Matrix<Real, d> const in_axes = make_matrix<Real, d>([&](int i, int j) { // U^T dl U
        return sum_of<Real, d>(
            [&](int k) { return U(k, i) * sum_of<Real, d>([&](int l) { return change(k, l) * U(l, j); }); });
    });
    auto const over = [&](Real const& value) { // of what is not 0
        Mask<Real> const is_zero = !(abs(value) > Real(ScalarOf<Real>(1e-12)));
        return one / select(is_zero, Real(ScalarOf<Real>(1e-12)), value);
    };
    Matrix<Real, d> Q;
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j) {
            if (i == j) {
                Q(i, i) = sum_of<Real, d>([&](int k) { return stretching(i, k) * in_axes(k, k); });
                continue;
            }
            Real const sigma_i = one + extension[i], sigma_j = one + extension[j],
                       t = clipped(tangent.shearing(i, j)),
                       f = clipped((kirchhoff[i] * over(sigma_i) + kirchhoff[j] * over(sigma_j)) *
                                   over(sigma_i + sigma_j));
            Q(i, j) =
                sigma_j * half * ((t + f) * sigma_j * in_axes(i, j) + (t - f) * sigma_i * in_axes(j, i));
        }
    return make_matrix<Real, d>([&](int i, int j) { // U Q U^T
        return sum_of<Real, d>(
            [&](int k) { return U(i, k) * sum_of<Real, d>([&](int l) { return Q(k, l) * U(j, l); }); });
    });
}

} // namespace firn
