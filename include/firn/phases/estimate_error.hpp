// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/phases/solve_phase.hpp>

namespace firn
{

/// On nodes that have mass and momentum: by how much a step of backward Euler moves them otherwise than the
/// trapezoidal rule does, whose velocity is the mean of that before the step and the solution. That is the
/// part of the error of backward Euler in a step that is largest in short ones, dt^2 / 2 times the
/// acceleration.
///
/// Sums: first m times the square of that way; largest: the square itself.
template <class Space, class Kernel, class Transfer>
struct EstimateError : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Number, typename Phase::Own, typename Phase::Result;
    using Sums = NodeSums<d, SumsOf<Transfer>>; ///< which particles have scattered for the step

    Number dt; ///< [s]

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Real const mass = node.value(Own::mass), inverse_mass = Phase::inverse_of(mass);
        Vector<Real, d> const before =
            make_vector<Real, d>([&](int a) { return node.sum(Sums::momentum + a) * inverse_mass; });
        Vector<Real, d> const way = (Phase::vector(node, Own::solution) - before) * Real(dt / 2);
        Real const square = select(counted(node) & (mass > Real(0)), dot<Real, d>(way, way), Real(0));
        add_lanes(result.first, square * mass);
        result.look(square, node.first(), node.offset()[d - 1]);
    }
};

} // namespace firn
