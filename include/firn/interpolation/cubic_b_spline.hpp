// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>

#include <array>

namespace firn
{

/// The cubic B-spline: four nodes per axis, continuous second derivative (Stomakhin et al. 2013, section 3).
struct CubicBSpline
{
    static constexpr int degree = 3;
    static constexpr auto name = "cubic";
    /// D^-1 of APIC in units of 1/h^2: D = h^2/3 I at every position (Jiang et al. 2015, section 5.3).
    static constexpr double inverse_inertia = 3;
    /// sup of the sum over a stencil of |dN/dx|^2 / N, in units of 1/h^2.
    static constexpr double gradient_bound = 3.137;

    /// Weights of the four nodes, for the offset t in [-1/2, 1/2) from the cell's centre (between two nodes).
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 4> weights(Real t)
    {
        Real const left = Real(0.5) - t, right = Real(0.5) + t, sixth = Real(ScalarOf<Real>(1.0 / 6.0));
        Real const first = sixth * left * left * left, last = sixth * right * right * right;
        // The inner two follow from their sum and their difference. 1/6 and 2/3 are rounded, and a sum of
        // weights that is always a little off one would accelerate everything by that factor in every step.
        Real const sum = Real(1) - (first + last), difference = t * (Real(1.25) - t * t), half = Real(0.5);
        return {first, half * (sum - difference), half * (sum + difference), last};
    }

    /// dN/dt of the four nodes [1/h].
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 4> derivatives(Real t)
    {
        Real const a = Real(0.5) - t, b = Real(0.5) + t, half = Real(0.5);
        return {-half * a * a, b * (Real(1.5) * b - Real(2)), a * (Real(2) - Real(1.5) * a), half * b * b};
    }

    /// Value and derivatives of the interpolant at the cell's centre.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 4> expanded(std::array<Real, 4> const& node)
    {
        Real const inner = node[2] - node[1], outer = node[3] - node[0],
                   curvature = Real(0.5) * ((node[3] - node[2]) - (node[1] - node[0]));
        return {Real(0.5) * (node[1] + node[2]) + Real(ScalarOf<Real>(1.0 / 24)) * curvature,
                Real(0.125) * outer + Real(0.625) * inner, curvature, outer - Real(3) * inner};
    }

    /// Factors of those derivatives in sum of w_i v_i (x_i - x_p) D^-1.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 3> spreads(Real t)
    {
        Real const square = t * t;
        return {Real(1), t, square * (Real(0.75) - Real(0.5) * square) - Real(0.03125)};
    }

    /// The weights whose derivatives are w_i (x_i - x) D^-1: see SurfaceWeights.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 4> surface_weights(Real t)
    {
        auto const outer = [](Real to_end) {
            Real const square = to_end * to_end;
            return square * square * (Real(0.25) - Real(ScalarOf<Real>(0.1)) * to_end);
        };
        auto const inner = [](Real distance) {
            Real const square = distance * distance;
            return Real(ScalarOf<Real>(0.7)) +
                   square * (square * (Real(0.75) - Real(ScalarOf<Real>(0.3)) * distance) - Real(1));
        };
        Real const left = Real(0.5) - t, right = Real(0.5) + t;
        return {outer(left), inner(right), inner(left), outer(right)};
    }
};

} // namespace firn
