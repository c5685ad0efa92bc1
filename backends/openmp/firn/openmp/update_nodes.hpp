// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/core/lane.hpp>
#include <firn/openmp/cell_group.hpp>
#include <firn/openmp/node_rows.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/results.hpp>
#include <firn/openmp/tuning.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>

// The loop over nodes: they add up the tiles that cover them, and are updated.
namespace firn::openmp
{

namespace detail
{
/// What nodes of a phase look around for, if they do: found once for all nodes that a thread updates.
template <class Phase>
auto surroundings(Phase const& phase)
{
    if constexpr (Phase::looks_around)
        return phase.walls();
    else
        return 0;
}

/// Whether a row of nodes concerns a phase, if that says so.
template <class Lane, class GridType, class Phase, class Block>
bool concerns([[maybe_unused]] Phase const& phase, [[maybe_unused]] Block const& block,
              [[maybe_unused]] int row)
{
    if constexpr (SaysWhichConcern<Phase>) {
        constexpr int d = Phase::d;
        Vector<Lane, d> steps = zeros<Vector<Lane, d>>();
        steps[d - 1] = counting<Lane>();
        for (int place = 0; place < GridType::Shape::along; place += lane_width<Lane>)
            if (phase.template concerns<Lane>(GridType::node_at(block.coordinates, row, place), steps))
                return true;
        return false;
    }
    else
        return true;
}

/// Updates a block of nodes; `around` is what they look around for.
template <class Lane, class GridType, class Phase, class Around>
void update_block(GridType& grid, std::size_t n, Phase const& phase, [[maybe_unused]] Around const& around,
                  typename Phase::Result& result)
{
    constexpr int d = Phase::d;
    using Shape = typename GridType::Shape;
    auto const& block = grid.nodes()[n];
    constexpr bool adds_up = !AsksNoSums<Phase>;
    constexpr int channels = adds_up ? Phase::Sums::channels : 1;
    alignas(64) typename Phase::Number sums[std::size_t(channels)][std::size_t(Shape::along)];
    for (std::uint64_t rows = covered_rows(grid, block); rows != 0; rows &= rows - 1) {
        int const row = std::countr_zero(rows);
        if (!concerns<Lane, GridType>(phase, block, row)) continue;
        if constexpr (adds_up) sum_row<Lane, GridType, channels>(grid, block, row, sums);
        for (int place = 0; place < Shape::along; place += lane_width<Lane>) {
            Coordinates<d> const at = GridType::node_at(block.coordinates, row, place);
            auto* const values = grid.node_values(n) + row * Shape::along + place;
            NodeLanes<Lane, GridType, d> node(&sums[0][place], values, at);
            if constexpr (ListsImages<Phase>) {
                auto const listed =
                    std::as_const(grid).images().of(n, (row * Shape::along + place) / lane_width<Lane>);
                if (!listed.images.empty()) {
                    ListedNodes<Lane, GridType, d> looking(node, &sums[0][0], grid, static_cast<int>(n), row,
                                                           listed);
                    phase.look_around(around, looking, result);
                    continue;
                }
            }
            else if constexpr (Phase::looks_around)
                if (phase.looks_around_at(around, at, lane_width<Lane>)) {
                    LookingNodes<Lane, GridType, d> looking(node, &sums[0][0], grid, static_cast<int>(n),
                                                            row);
                    phase.look_around(around, looking, result);
                    continue;
                }
            phase(node, result);
        }
    }
}

/// The same for a phase that tells layers apart.
template <class Lane, class GridType, TellsLayersApart Phase, class Around>
void update_block(GridType& grid, std::size_t n, Phase const& phase, Around const&,
                  typename Phase::Result& result)
{
    using Shape = typename GridType::Shape;
    for (int row = 0; row < Shape::rows; ++row) {
        NodesOfLayers<Lane, GridType, Phase::d, Phase::Sums::channels> nodes(grid, n, row);
        if (!nodes.has_any()) continue;
        for (int place = 0; place < Shape::along; place += lane_width<Lane>) {
            nodes.enter(place);
            phase(nodes, result);
        }
    }
}
} // namespace detail

/// Nodes add up the tiles that cover them and are updated, row by row, owner by owner. Threads get the same
/// partitions as of `cells` if that is the only order (see parallel_for).
template <class Lane, class Order, class GridType, class Phase>
typename Phase::Result for_each_node(Threads const& threads, Order const& cells, GridType& grid,
                                     Phase const& phase)
{
    using Result = typename Phase::Result;
    auto& results =
        detail::ResultsOf<Result>::make_ready(cells.workspace(), static_cast<std::size_t>(grid.owners()));
    if constexpr (ListsImages<Phase>) list_images<Lane>(grid, phase, phase.walls());
    int const most = threads_for(grid.nodes().size(), threads.count, node_blocks_per_thread);
    parallel_for(threads.limited_to(most), grid.owners(), cells.partitions(), [&](int) {
        return [&, around = detail::surroundings(phase)](int owner) {
            Result& result = results.begin(static_cast<std::size_t>(owner));
            for (std::uint32_t const n : grid.nodes_at(owner))
                detail::update_block<Lane>(grid, n, phase, around, result);
        };
    });
    return results.merged(grid);
}

} // namespace firn::openmp
