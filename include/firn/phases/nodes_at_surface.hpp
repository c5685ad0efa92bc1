// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/surface_points.hpp>

#include <cstddef>
#include <cstdint>

// The nodes that points of surfaces reach: see surface_stencils.hpp.
namespace firn
{

/// Indices that the nodes had which points reach have nothing any more.
template <class Number, int d>
struct ForgetIndices
{
    SurfacePoints<Number, d> of;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        if (i < *of.reached_nodes && of.reached[i].node != 0) of.indices[of.reached[i].node - 1].count = 0;
    }
};

/// Finds the indices that they have now.
template <class Number, int d, class Nodes>
struct FindIndices
{
    SurfacePoints<Number, d> of;
    Nodes by_index;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        if (i >= *of.reached_nodes) return;
        NodeAtSurface<Number, d>& node = of.reached[i];
        std::uint32_t const index = by_index.find(node.place);
        node.node = index == Nodes::absent ? 0 : index + 1;
        if (node.node != 0) of.indices[index] = {static_cast<std::uint32_t>(i), node.points.count};
    }
};

/// The nodes that points reach take their masses and velocities from the grid, and if these points are new,
/// make room for them in the list of those of all nodes.
template <class Number, int d, class Nodes>
struct BeginNodes
{
    SurfacePoints<Number, d> of;
    Nodes by_index;
    Number smallest_mass; ///< see UpdateGrid
    int mass, velocity;   ///< the channels of the sums, and of the values
    bool may_change;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        if (i >= *of.reached_nodes) return;
        NodeAtSurface<Number, d>& node = of.reached[i];
        bool const is_there = node.node != 0;
        std::uint32_t const index = is_there ? node.node - 1 : 0;
        if (may_change && *of.changes > 0) {
            std::uint32_t const count = is_there ? of.indices[index].count : node.points.count;
            node.has_new_points = count != node.points.count;
            node.points.count = count;
            node.points.begin = next_number_of_all(*of.listed, node.points.count);
        }
        Number const sum = is_there ? by_index.sum(index, mass) : Number(0);
        bool const has_mass = sum > smallest_mass;
        node.inverse_mass = has_mass ? 1 / sum : Number(0);
        Vector<Number, d> free = zeros<Vector<Number, d>>();
        if (has_mass)
            for (int a = 0; a < d; ++a) free[a] = by_index.value(index, velocity + a);
        node.free.set(free);
        node.free.set_number(Number(0));
        of.velocities[i + 1].set_number(has_mass ? sum : Number(0));
    }
};

} // namespace firn
