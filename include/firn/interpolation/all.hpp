// SPDX-License-Identifier: MIT
#pragma once

#include <firn/interpolation/cubic_b_spline.hpp>
#include <firn/interpolation/linear.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>

#include <tuple>

namespace firn
{

/// The one list of interpolation kernels: what is to be done for each of them goes over it.
using AllKernels = std::tuple<Linear, QuadraticBSpline, CubicBSpline>;

} // namespace firn
