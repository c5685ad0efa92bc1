// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/space.hpp>

#include <Eigen/Eigenvalues>

// What decompositions of doubles are compared with. Eigen has no SIMD for long double: its decompositions of
// these are also compiled in a quarter of the time.
namespace firn::test
{

template <int d>
using Long = Eigen::Matrix<long double, d, d>;

/// The eigenvalues of a symmetric matrix, the smallest first, and its axes.
template <int d>
Eigen::SelfAdjointEigenSolver<Long<d>> spectrum_of(Long<d> const& symmetric)
{
    return Eigen::SelfAdjointEigenSolver<Long<d>>(symmetric);
}
template <int d>
Eigen::SelfAdjointEigenSolver<Long<d>> spectrum_of(Matrix<double, d> const& symmetric)
{
    return spectrum_of<d>(Long<d>(symmetric.template cast<long double>()));
}

} // namespace firn::test
