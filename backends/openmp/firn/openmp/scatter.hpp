// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/for_each_group.hpp>
#include <firn/openmp/items.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/tile_rows.hpp>
#include <firn/openmp/tuning.hpp>
#include <firn/openmp/workspace.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// The loop that only scatters, and how a group of cells does so in any loop.
namespace firn::openmp
{

namespace detail
{
/// Adds the contributions of `here` ranks of a group's items, row by row of their stencils, so that the sums
/// of a row stay in registers.
template <class Scatter, class Group, class Spreads>
void add_rows(Group& group, Spreads const& spreads, int here)
{
    using Real = typename Group::Real;
    for (int row = 0; row < Scatter::rows; ++row) {
        Real sums[Scatter::width][Scatter::channels];
        for (auto& node : sums)
            for (auto& sum : node) sum = Real(typename Group::Number(0));
        for (int i = 0; i < here; ++i) Scatter::scatter(spreads[static_cast<std::size_t>(i)], row, sums);
        group.template add<Scatter::width, Scatter::channels>(row, sums);
    }
}

/// Scatters the contributions of a group's items.
template <class Scatter, class Group, class Spreads>
FIRN_INLINE_WHOLE void scatter(Group& group, Spreads& spreads)
{
    group.restart();
    for (int rank = 0, ranks = group.ranks(); rank < ranks;) {
        int here = 0;
        for (; here < static_cast<int>(spreads.size()) && rank < ranks; ++here, ++rank) {
            group.enter(rank);
            Scatter::make_ready(group, spreads[static_cast<std::size_t>(here)]);
        }
        add_rows<Scatter>(group, spreads, here);
    }
}

/// The contributions of as many ranks as are summed at once.
template <class Lane, class Scatter>
using Spreads = std::array<typename Scatter::template Spread<Lane>, ranks_at_once>;

/// A thread's buffers for scattering.
template <class Lane, class Scatter>
struct ScatterBuffers
{
    Scratch<Lane, Scatter::d> scratch;
    Spreads<Lane, Scatter> spreads;
};

template <class Phase, class Items>
FIRN_INLINE_WHOLE void prepare(Phase const& phase, Items& items)
{
    phase.prepare(items);
}
} // namespace detail

/// Each block of cells sums the contributions of its items into its own tile: afresh, or onto what is there.
template <class Lane, class Order, class GridType, class Phase>
void scatter(Threads const& threads, Order const& cells, GridType& grid, Phase const& phase, bool afresh)
{
    constexpr int d = Phase::d, lanes = lane_width<Lane>;
    using ScatterBuffers = detail::ScatterBuffers<Lane, typename Phase::Scatter>;
    int const blocks = static_cast<int>(cells.blocks().size());
    Workspace& workspace = cells.workspace().for_threads(threads.count);
    parallel_for(threads, blocks, cells.partitions(), [&](int thread) {
        return [&, &buffers = workspace.of<ScatterBuffers>(thread)](int b) {
            auto& [scratch, spreads] = buffers;
            if (afresh) grid.touched(std::size_t(b)) = 0;
            std::uint64_t const rows = detail::touched_by_items<GridType>(cells, std::size_t(b));
            detail::clear_rows<GridType, Phase::channels>(grid.tile(std::size_t(b)),
                                                          rows & ~grid.touched(std::size_t(b)));
            grid.touched(std::size_t(b)) |= rows;
            Items<Lane, Order, d> items(cells, std::size_t(b), scratch);
            for (int g = 0; g < GridType::Shape::groups; ++g) {
                std::size_t const begin = cells.group_begin(std::size_t(b), g),
                                  end = cells.group_end(std::size_t(b), g);
                if (begin == end) continue;
                scratch.reserve(Phase::scratch_channels, end - begin);
                for (std::size_t slot = begin; slot < end; slot += lanes) {
                    items.enter(slot, end, slot - begin);
                    detail::prepare(phase, items);
                }
                detail::GroupOf<Lane, GridType> group(cells.counts(std::size_t(b), g), g, scratch, 0, nullptr,
                                                      grid.tile(std::size_t(b)));
                detail::scatter<typename Phase::Scatter>(group, spreads);
            }
        };
    });
}

} // namespace firn::openmp
