// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

// Eigen 3.4's inverse() inside a larger expression becomes a trap in device code; these do not.
namespace firn
{

/// The cofactors of F: det(F) F⁻ᵀ, the derivative of det F with respect to F; finite for singular F too.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 2> cofactors(Matrix<Real, 2> const& F)
{
    Matrix<Real, 2> C;
    C << F(1, 1), -F(1, 0), -F(0, 1), F(0, 0);
    return C;
}

/// The cofactors of F: det(F) F⁻ᵀ, the derivative of det F with respect to F; finite for singular F too.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 3> cofactors(Matrix<Real, 3> const& F)
{
    return make_matrix<Real, 3>([&](int i, int j) { // cyclic indices need no sign
        int const i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
        return F(i1, j1) * F(i2, j2) - F(i2, j1) * F(i1, j2);
    });
}

/// F⁻ᵀ; not finite where det F = 0.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> inverse_transpose(Matrix<Real, d> const& F)
{
    Matrix<Real, d> const C = cofactors(F);
    Real const determinant = sum_of<Real, d>([&](int k) { return F(k, 0) * C(k, 0); });
    return C * (Real(1) / determinant);
}

/// F⁻¹; not finite where det F = 0.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> inverse(Matrix<Real, d> const& F)
{
    Matrix<Real, d> const T = inverse_transpose(F);
    return make_matrix<Real, d>([&](int i, int j) { return T(j, i); });
}

} // namespace firn
