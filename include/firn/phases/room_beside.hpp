// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <cstddef>

namespace firn
{

/// The share of a B-spline's integral on one side of a plane, at this signed distance from its centre
/// [cells]: 0.5 if the plane goes through that.
template <int degree, Lane Real>
FIRN_HOST_DEVICE Real share_above(Real const& distance)
{
    using Number = ScalarOf<Real>;
    auto const c = [](double value) { return Real(static_cast<Number>(value)); };
    Real const a = min(abs(distance), c(0.5 * (degree + 1)));
    Real larger;
    if constexpr (degree == 1)
        larger = c(0.5) + a - a * a * c(0.5);
    else if constexpr (degree == 2) {
        Real const rest = c(1.5) - a;
        larger = select(a < c(0.5), c(0.5) + c(0.75) * a - a * a * a * c(1.0 / 3),
                        c(1) - rest * rest * rest * c(1.0 / 6));
    }
    else {
        static_assert(degree == 3, "the integral of this kernel is not known");
        Real const rest = c(2) - a, a2 = a * a;
        larger = select(a < c(1), c(0.5) + a * c(2.0 / 3) - a2 * a * c(1.0 / 3) + a2 * a2 * c(0.125),
                        c(1) - rest * rest * rest * rest * c(1.0 / 24));
    }
    return select(distance < c(0), c(1) - larger, larger);
}

/// The shares of the kernels of a node and its neighbours that an obstacle leaves.
template <class Real, int d>
struct RoomBeside
{
    Real own, of_neighbours[std::size_t(2 * d)]; ///< below and above along each axis
};

/// The same by the distances [cells] of the node, of its neighbours and of no other place: `away(cells)` is
/// that of the place so far from the node. A surface that bends away from the kernel leaves more room than
/// its tangent plane: what counts is the mean distance across the kernel, found by second differences. With
/// the distance of the node itself a ball of three cells' radius would leave 8 % of its volume too little.
template <int degree, Lane Real, int d, class Away>
FIRN_HOST_DEVICE RoomBeside<Real, d> room_beside(Away const& away)
{
    using Number = ScalarOf<Real>;
    RoomBeside<Real, d> left;
    Real const here = away(zeros<Vector<Real, d>>());
    Real bend(0);
    for (int b = 0; b < 2 * d; ++b) {
        Vector<Real, d> cells = zeros<Vector<Real, d>>();
        cells[b / 2] = Real(Number(b % 2 == 0 ? -1 : 1));
        Real const there = away(cells);
        left.of_neighbours[b] = share_above<degree>(there);
        bend = bend + (there - here);
    }
    constexpr double variance = (degree + 1) / 12.0; // of the kernel along an axis [cells^2]
    left.own = share_above<degree>(here + bend * Real(static_cast<Number>(variance / 2)));
    return left;
}

} // namespace firn
