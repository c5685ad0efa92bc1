// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <concepts>

namespace firn
{

/// A vector of `d` numbers; `Real` is a number or a lane of numbers.
template <class Real, int d>
using Vector = Eigen::Matrix<Real, d, 1>;

/// A `d` × `d` matrix; `Real` is a number or a lane of numbers.
template <class Real, int d>
using Matrix = Eigen::Matrix<Real, d, d>;

/// The space a scene lives in: its dimension (2: plane strain, or 3) and its precision.
template <int d, std::floating_point Number>
    requires(d == 2 || d == 3)
struct Space
{
    static constexpr int dimension = d;
    using Scalar = Number;
};

} // namespace firn
