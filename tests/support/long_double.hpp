// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/space.hpp>

#include <Eigen/Eigenvalues>

// What decompositions of doubles are compared with. Eigen has no SIMD for long double: its decompositions of
// these are also compiled in a quarter of the time.
namespace firn::test
{

#if defined(__NVCC__) // to which every min of CUDA's is as good as any other for long double
using LongDouble = double;
#else
using LongDouble = long double;
#endif

template <int d>
using Long = Eigen::Matrix<LongDouble, d, d>;

/// The eigenvalues of a symmetric matrix, the smallest first, and its axes.
template <int d>
Eigen::SelfAdjointEigenSolver<Long<d>> spectrum_of(Matrix<double, d> const& symmetric)
{
    return Eigen::SelfAdjointEigenSolver<Long<d>>(Long<d>(symmetric.template cast<LongDouble>()));
}

} // namespace firn::test
