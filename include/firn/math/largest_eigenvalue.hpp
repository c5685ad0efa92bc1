// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <limits>

namespace firn
{

/// The largest eigenvalue of a symmetric matrix.
template <Lane Real>
FIRN_HOST_DEVICE inline Real largest_eigenvalue(Matrix<Real, 2> const& S)
{
    Real const half(ScalarOf<Real>(0.5)), mean = half * (S(0, 0) + S(1, 1)),
                                          apart = half * (S(0, 0) - S(1, 1));
    return mean + sqrt(apart * apart + S(0, 1) * S(0, 1));
}

/// The largest eigenvalue of a symmetric matrix, or above it by at most half a percent of the largest of its
/// deviator: trace / 3 + 2 sqrt(J_2 / 3) cos theta with cos 3 theta = (3 sqrt(3) / 2) J_3 / J_2^(3/2), where
/// a parabola in cos(3 theta / 2) stands for cos theta; exact where two eigenvalues are the same.
template <Lane Real>
FIRN_HOST_DEVICE inline Real largest_eigenvalue(Matrix<Real, 3> const& S)
{
    using Number = ScalarOf<Real>;
    auto const number = [](double x) { return Real(Number(x)); };
    Real const mean = number(1.0 / 3) * (S(0, 0) + S(1, 1) + S(2, 2));
    Real const x = S(0, 0) - mean, y = S(1, 1) - mean, z = S(2, 2) - mean;
    Real const xy = S(0, 1) * S(0, 1), xz = S(0, 2) * S(0, 2), yz = S(1, 2) * S(1, 2);
    Real const J2 = number(0.5) * (x * x + y * y + z * z) + xy + xz + yz;
    Real const J3 = x * (y * z - yz) - y * xz - z * xy + number(2) * S(0, 1) * S(0, 2) * S(1, 2);
    Real const root = sqrt(J2), cube = J2 * root;
    // where the cube of the deviator underflows or overflows, the upper bound
    using Limits = std::numeric_limits<Number>;
    Mask<Real> const told = (cube > number(Limits::min())) & (cube < number(Limits::max()));
    Real const cosine =
        select(told, number(2.59807621135331594) * J3 / select(told, cube, number(1)), number(1));
    Real const half = sqrt(max(number(0.5) + number(0.5) * cosine, number(0)));
    return mean + root * (number(0.57735026918962576) +
                          half * (number(2.0 / 3) - number(0.08931639747704091) * half));
}

} // namespace firn
