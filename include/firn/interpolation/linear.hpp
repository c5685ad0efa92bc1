// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>

#include <array>

namespace firn
{

/// The linear (tent) kernel N(r) = 1 - |r|. Its gradient jumps at cell faces, so that particles crossing
/// cells feel a spurious force. It is the negative control of tests and studies, not for scenes.
struct Linear
{
    static constexpr int degree = 1;
    static constexpr auto name = "linear";
    /// The sum over a stencil of |dN/dx|^2 / N at the cell's centre, in units of 1/h^2. Its sup is unbounded,
    /// so no time step is safe at a free surface.
    static constexpr double gradient_bound = 4;

    /// Weights of the two nodes, for the offset t in [-1/2, 1/2) from the cell's centre.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 2> weights(Real t)
    {
        return {Real(0.5) - t, Real(0.5) + t};
    }

    /// dN/dt of the two nodes [1/h].
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 2> derivatives(Real)
    {
        return {Real(-1), Real(1)};
    }

    /// Value and derivative of the interpolant at the cell's centre.
    template <Lane Real>
    FIRN_HOST_DEVICE static std::array<Real, 2> expanded(std::array<Real, 2> const& node)
    {
        return {Real(0.5) * (node[0] + node[1]), node[1] - node[0]};
    }
};

} // namespace firn
