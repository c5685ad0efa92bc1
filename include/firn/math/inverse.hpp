// SPDX-License-Identifier: MIT
#pragma once

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
    Vector<Real, 3> const x = F.col(0), y = F.col(1), z = F.col(2);
    Matrix<Real, 3> C;
    C.col(0) = y.cross(z);
    C.col(1) = z.cross(x);
    C.col(2) = x.cross(y);
    return C;
}

/// F⁻ᵀ; not finite where det F = 0.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> inverse_transpose(Matrix<Real, d> const& F)
{
    Matrix<Real, d> const C = cofactors(F);
    return C * (Real(1) / F.col(0).dot(C.col(0)));
}

/// F⁻¹; not finite where det F = 0.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> inverse(Matrix<Real, d> const& F)
{
    return inverse_transpose(F).transpose();
}

} // namespace firn
