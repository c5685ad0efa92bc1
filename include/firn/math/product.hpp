// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <cmath>
#include <concepts>

// Products as functions: each of Eigen's own makes some six types of expressions for every type of numbers
// (see core/components.hpp).
namespace firn
{

/// a . b.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real dot(Vector<Real, d> const& a, Vector<Real, d> const& b)
{
    return sum_of<Real, d>([&](int i) { return a[i] * b[i]; });
}

/// |A|^2, the sum of the squares of all components, by halves as Eigen sums them.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real squared_norm(Matrix<Real, d> const& A)
{
    auto const square = [a = A.data()](int i) { return a[i] * a[i]; };
    Real const first = (square(0) + square(1)) + (square(2) + square(3));
    if constexpr (d == 2)
        return first;
    else
        return first + ((square(4) + square(5)) + (square(6) + (square(7) + square(8))));
}

/// The length of a vector.
template <std::floating_point Number, int d>
FIRN_HOST_DEVICE inline Number norm(Eigen::Matrix<Number, d, 1> const& v)
{
    return std::sqrt(dot<Number, d>(v, v));
}

/// The Frobenius norm of a matrix.
template <std::floating_point Number, int d>
FIRN_HOST_DEVICE inline Number norm(Eigen::Matrix<Number, d, d> const& A)
{
    return std::sqrt(squared_norm<Number, d>(A));
}

/// A x.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Vector<Real, d> product(Matrix<Real, d> const& A, Vector<Real, d> const& x)
{
    return make_vector<Real, d>(
        [&](int i) { return sum_of<Real, d>([&](int k) { return A(i, k) * x[k]; }); });
}

/// A^T x.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Vector<Real, d> transpose_product(Matrix<Real, d> const& A, Vector<Real, d> const& x)
{
    return make_vector<Real, d>(
        [&](int i) { return sum_of<Real, d>([&](int k) { return A(k, i) * x[k]; }); });
}

/// A B.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> product(Matrix<Real, d> const& A, Matrix<Real, d> const& B)
{
    return make_matrix<Real, d>(
        [&](int i, int j) { return sum_of<Real, d>([&](int k) { return A(i, k) * B(k, j); }); });
}

/// A A^T.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> square_of(Matrix<Real, d> const& A)
{
    return make_matrix<Real, d>(
        [&](int i, int j) { return sum_of<Real, d>([&](int k) { return A(i, k) * A(j, k); }); });
}

/// The largest of the absolute values of a vector's components.
template <Lane Real, int d>
FIRN_HOST_DEVICE Real largest_component(Vector<Real, d> const& v)
{
    Real largest = abs(v[0]);
    for (int a = 1; a < d; ++a) largest = max(largest, abs(v[a]));
    return largest;
}

} // namespace firn
