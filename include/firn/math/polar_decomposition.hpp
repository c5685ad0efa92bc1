// SPDX-License-Identifier: MIT
#pragma once

#include <firn/math/singular_values.hpp>

namespace firn
{

/// The rotation R = U Vᵀ of F = R S, from singular values that are known already.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> rotation(SingularValues<Real, d> const& F)
{
    return F.U * F.V.transpose();
}

/// The rotation R of the polar decomposition F = R S, S symmetric, in closed form: with a = F₀₀ + F₁₁ and
/// b = F₁₀ − F₀₁, R = [[a, −b], [b, a]] / √(a² + b²); R = I where a = b = 0.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 2> rotation(Matrix<Real, 2> const& F)
{
    Real const a = F(0, 0) + F(1, 1), b = F(1, 0) - F(0, 1);
    Real const scale = max(abs(a), abs(b));
    auto const none = scale < Real(std::numeric_limits<Scalar<Real>>::min());
    Real const inverse = Real(1) / select(none, Real(1), scale);
    Real const x = select(none, Real(1), a * inverse), y = b * inverse; // NaN in b reaches both
    Real const length = inverse_sqrt(x * x + y * y);
    Matrix<Real, 2> R;
    R << x * length, -y * length, y * length, x * length;
    return R;
}

/// The rotation R of the polar decomposition F = R S, S symmetric, from the singular values of F. Where F is
/// inverted, R is the nearest rotation and S has one negative eigenvalue: the smallest in size.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 3> rotation(Matrix<Real, 3> const& F)
{
    return rotation(singular_values(F));
}

} // namespace firn
