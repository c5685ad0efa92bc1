// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>

#include <array>

namespace firn
{

/// The cubic B-spline: four nodes per axis, continuous second derivative (Stomakhin et al. 2013, section 3).
struct CubicBSpline
{
    static constexpr int order = 3;
    static constexpr auto name = "cubic";
    /// D^-1 of APIC in units of 1/h^2: D = h^2/3 I at every position (Jiang et al. 2015, section 5.3).
    static constexpr double inverse_inertia = 3;
    /// sup of the sum over a stencil of |dN/dx|^2 / N, in units of 1/h^2.
    static constexpr double gradient_bound = 3.137;

    /// Weights of the four nodes, for the offset t in [-1/2, 1/2) from the cell's centre (between two nodes).
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 4> weights(Real t)
    {
        Real const a = Real(0.5) - t, b = Real(0.5) + t; // distances to the right and left node of the cell
        Real const sixth = Real(1.0 / 6.0), two_thirds = Real(2.0 / 3.0), half = Real(0.5);
        std::array<Real, 4> w{sixth * a * a * a, two_thirds - b * b * (Real(1) - half * b),
                              two_thirds - a * a * (Real(1) - half * a), sixth * b * b * b};
        // 1/6 and 2/3 are rounded, so that the sum is always a little off one, which would speed everything
        // up (or turn it off its course, were it mended on one side) by that much with every step.
        Real const missing = half * (Real(1) - ((w[0] + w[3]) + (w[1] + w[2])));
        w[1] += missing;
        w[2] += missing;
        return w;
    }

    /// dN/dt of the four nodes [1/h].
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 4> derivatives(Real t)
    {
        Real const a = Real(0.5) - t, b = Real(0.5) + t, half = Real(0.5);
        return {-half * a * a, b * (Real(1.5) * b - Real(2)), a * (Real(2) - Real(1.5) * a), half * b * b};
    }
};

} // namespace firn
