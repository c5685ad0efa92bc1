// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/surface_memory.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/phases/surface_stencils.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

// On several ranks the points of surfaces, and the nodes that they reach, are known to all. Each rank finds
// all impulses, with the bits of one rank alone, and so takes part in no exchange between sweeps.
namespace firn::detail
{

/// The indices of the nodes that some points reach and for which this rank speaks.
template <class Kernel, class Backend, class Grid, class Number, int d>
std::vector<std::uint32_t> reached_nodes(Backend const& backend, Grid& grid,
                                         SurfacePoint<Number, d> const* points, std::size_t count)
{
    using Loop = PointLoop<Kernel, Number, d>;
    using Cell = typename Loop::Cell;
    auto const by_index = grid.nodes_by_index();
    std::vector<std::uint32_t> marks(grid.node_count(), 0),
        reached(std::min(marks.size(), count * std::size_t(Loop::nodes_of_each)));
    std::uint32_t number = 0;
    backend.for_each(count, [&](std::size_t p) {
        Vector<Number, d> offset;
        Coordinates<d> const first = Loop::cell_of(points[p], offset) + points[p].node -
                                     Coordinates<d>::Constant(stencil_reach(Kernel::degree));
        for (int row = 0; row < Cell::rows; ++row) {
            Coordinates<d> node = first;
            for (int a = 0; a < d - 1; ++a) node[a] += Cell::index(row, a);
            std::uint32_t index = by_index.absent;
            for (int k = 0; k < Cell::width; ++k, ++node[d - 1]) {
                index = k == 0 ? by_index.find(node) : by_index.find_next(node, index);
                if (index != by_index.absent && claim(marks[index], 1)) reached[next_number(number)] = index;
            }
        }
    });
    reached.resize(number);
    std::erase_if(reached, [&](auto const index) { return grid.share_of(index) != NodeShare::results; });
    return reached;
}

/// Lets all ranks know the nodes that points reach, with their masses and velocities; `mass` and `velocity`
/// are their channels.
template <class Kernel, class Backend, class Grid, class Number, int d>
NodesOfRanks<Number, d>&
share_nodes_at_surface(Backend const& backend, Grid& grid, SurfaceMemory<Backend, Number, d>& surface,
                       std::uint32_t points, Lattice const& lattice, int mass, int velocity)
{
    auto& nodes = surface.nodes_of_ranks;
    auto const by_index = grid.nodes_by_index();
    bool const is_new = points > surface.first_new() || !surface.have_nodes() ||
                        !surface.have_indices(nodes.list.numbering());
    if (is_new || sum_of_ranks(backend, nodes.numbering == grid.numbering() ? 0 : 1) > 0) {
        nodes.own = reached_nodes<Kernel>(backend, grid, surface.view().points, points);
        std::vector<Coordinates<d>> own;
        own.reserve(nodes.own.size());
        for (auto const index : nodes.own) own.push_back(by_index.node(index));
        nodes.set(of_all_ranks(backend, std::move(own)), d, lattice, grid);
    }
    std::vector<Number> own(nodes.own.size() * std::size_t(1 + d));
    backend.for_each(nodes.own.size(), [&](std::size_t i) {
        Number* const to = own.data() + i * std::size_t(1 + d);
        to[0] = by_index.sum(nodes.own[i], mass);
        for (int a = 0; a < d; ++a) to[1 + a] = by_index.value(nodes.own[i], velocity + a);
    });
    nodes.list.of_nodes() = of_all_ranks(backend, std::move(own));
    return nodes;
}

} // namespace firn::detail
