// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/surface_memory.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/world_layout.hpp>

#include <cstdint>
#include <vector>

namespace firn
{

/// A place where an obstacle touched material in a step.
template <int d>
struct ContactPoint
{
    std::uint32_t world; ///< of many worlds; else 0
    /// Its number in the list: in a world's own, if each has one. Lists of a call are numbered through, and
    /// those of worlds follow the others.
    std::uint32_t obstacle;
    /// On its surface [m], or a node inside it: all nodes act in what sticks, and those deep inside in
    /// others.
    Vector<double, d> position;
    Vector<double, d> normal;  ///< of the surface, outward
    Vector<double, d> impulse; ///< on the obstacle [N s]
};

/// Those of one step: see contact_points().
template <int d>
struct ContactPoints
{
    double dt = 0; ///< of the step [s]
    std::vector<ContactPoint<d>> points;
};

namespace detail
{
/// Adds the points at which a list of obstacles acted in the last step; `mass_unit` is that of the scene's
/// masses [kg].
template <class Backend, class Number, int d>
void add_contacts(SurfaceMemory<Backend, Number, d> const& memory, Lattice const& lattice, double mass_unit,
                  std::vector<ContactPoint<d>>& to)
{
    constexpr int on_nodes = 1; // the cells of this degree have nodes as their corners: half a cell off
    auto const worlds = WorldLayout<d>::of(lattice);
    for (auto const& point : memory.last()) {
        Vector<double, d> impulse, offset, normal;
        for (int a = 0; a < d; ++a) {
            impulse[a] = -double(point.impulse[a]) * double(point.support) * mass_unit;
            offset[a] = double(point.offset[a]) - 0.5;
            normal[a] = double(point.normal[a]);
        }
        if (impulse.isZero(0)) continue;
        to.push_back({lattice.half_world == 0 ? 0 : worlds.world_of(point.node),
                      memory.number_of(point.obstacle),
                      world_position<d>(lattice, on_nodes, point.node, offset), normal, impulse});
    }
}
} // namespace detail

} // namespace firn
