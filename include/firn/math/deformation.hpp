// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/math/product.hpp>

// Measures of a deformation F from H = F - I: near rest, differences of F from I would be rounding errors.
namespace firn
{

/// F = I + H.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> deformation_gradient(Matrix<Real, d> const& H)
{
    Matrix<Real, d> F = H;
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) F(i, i) += Real(1);
    return F;
}

/// J - 1 - tr H, what the volume changes by beyond the first order.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real volume_remainder(Matrix<Real, d> const& H)
{
    auto const minor = [&](int i, int j) { return H(i, i) * H(j, j) - H(i, j) * H(j, i); };
    if constexpr (d == 2)
        return minor(0, 1);
    else
        return minor(0, 1) + minor(0, 2) + minor(1, 2) + H.determinant();
}

/// J - 1 = det(I + H) - 1, without the cancellation near rest.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real volume_change(Matrix<Real, d> const& H)
{
    if constexpr (d == 2)
        return H(0, 0) + H(1, 1) + volume_remainder<Real, d>(H);
    else
        return H(0, 0) + H(1, 1) + H(2, 2) + volume_remainder<Real, d>(H);
}

/// V^2 - I = F F^T - I with the left stretch V, without the cancellation near rest.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> squared_stretch_less_one(Matrix<Real, d> const& H)
{
    Matrix<Real, d> B = square_of<Real, d>(H);
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) FIRN_UNROLL
    for (int j = 0; j < d; ++j) B(i, j) += H(i, j) + H(j, i);
    return B;
}

} // namespace firn
