// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>

#include <array>

namespace firn
{

/// The quadratic B-spline: three nodes per axis, continuous gradient (Steffen et al. 2008, eq. 15).
struct QuadraticBSpline
{
    static constexpr int degree = 2;
    static constexpr auto name = "quadratic";
    /// D^-1 of APIC in units of 1/h^2: D = h^2/4 I at every position (Jiang et al. 2015, section 5.3).
    static constexpr double inverse_inertia = 4;
    /// sup of the sum over a stencil of |dN/dx|^2 / N, in units of 1/h^2.
    static constexpr double gradient_bound = 6;

    /// Weights of the three nodes, for the offset t in [-1/2, 1/2) from the cell's centre (a node).
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 3> weights(Real t)
    {
        Real const left = Real(0.5) - t, right = Real(0.5) + t;
        return {Real(0.5) * left * left, Real(0.75) - t * t, Real(0.5) * right * right};
    }

    /// dN/dt of the three nodes [1/h].
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 3> derivatives(Real t)
    {
        return {t - Real(0.5), Real(-2) * t, t + Real(0.5)};
    }

    /// Value and derivatives of the interpolant at the cell's centre.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 3> expanded(std::array<Real, 3> const& node)
    {
        Real const curvature = (node[2] - node[1]) - (node[1] - node[0]);
        return {node[1] + Real(0.125) * curvature, Real(0.5) * (node[2] - node[0]), curvature};
    }

    /// Factors of those derivatives in sum of w_i v_i (x_i - x_p) D^-1.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 2> spreads(Real t)
    {
        return {Real(1), t * (Real(1.5) - Real(2) * t * t)};
    }

    /// The weights whose derivatives are w_i (x_i - x) D^-1: see SurfaceWeights.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 3> surface_weights(Real t)
    {
        Real const left = Real(0.5) - t, right = Real(0.5) + t, half = Real(0.5);
        Real const first = left * left * left * (Real(1) - half * left),
                   last = right * right * right * (Real(1) - half * right);
        return {first, Real(1) - (first + last), last};
    }
};

} // namespace firn
