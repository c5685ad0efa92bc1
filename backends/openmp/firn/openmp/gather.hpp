// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/by_rank.hpp>
#include <firn/openmp/for_each_group.hpp>
#include <firn/openmp/items.hpp>
#include <firn/openmp/migrate.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/results.hpp>
#include <firn/openmp/scatter.hpp>
#include <firn/openmp/tile_rows.hpp>
#include <firn/openmp/tuning.hpp>
#include <firn/openmp/workspace.hpp>

#include <cstddef>
#include <cstdint>
#include <utility>

// The loops that gather: items move and scatter to the next grid, or scatter in place, or only gather.
namespace firn::openmp
{

namespace detail
{
template <class Phase, class Items>
FIRN_INLINE_WHOLE void begin_items(Phase const& phase, Items& items)
{
    phase.begin(items);
}

/// Gathers from a group's nodes. Like scatter(), this is a template over what is gathered, so that phases
/// share the code, but those that expect something, which call `expect(rank)` before each rank. Where only
/// few cells have so many items, these are processed side by side, whatever their cells. The group's items
/// end before number `end` in the scratch.
template <class Gather, class Group, class Nodes, class Expect>
FIRN_INLINE_WHOLE void gather(Group& group, std::size_t end, Nodes& nodes, Expect const& expect)
{
    for (int channel = 0; channel < Gather::node_channels; channel += Nodes::channels) {
        nodes.read(group, channel);
        group.restart();
        for (int rank = 0, ranks = group.ranks(); rank < ranks; ++rank) {
            group.enter(rank);
            if (group.is_sparse(ranks - rank, end)) {
                group.side_by_side(rank, end, [&](auto& some) { Gather::gather(some, nodes, channel); });
                break;
            }
            expect(rank);
            Gather::gather(group, nodes, channel);
        }
    }
}

struct ExpectNothing
{
    void operator()(int) const {}
};

template <class Phase>
concept SaysWhatComes = requires(Phase const& phase)
{
    phase.expect(ExpectedItems{});
};

/// A phase that finds bounds keeps them in one result per thread: starting each block at zero would find a
/// new largest value many times over.
template <class Phase, class Items>
FIRN_INLINE_WHOLE void update_items(Phase const& phase, Items& items, typename Phase::Result& of_thread,
                                    typename Phase::Result& of_block)
{
    if constexpr (requires { phase.update(items, of_thread, of_block); })
        phase.update(items, of_thread, of_block);
    else
        phase.update(items, of_block);
}

/// A thread's buffers for gathering.
template <class Lane, class GridType, class Phase>
struct GatherBuffers
{
    Array<typename Phase::Number> nodes;
    typename Phase::template CellNodes<Lane> nodes_of_cells;
    Scratch<Lane, Phase::d> scratch;
};

/// A thread's scatter to the next step's grid, block by block and group by group.
template <class Lane, class Order, class GridType, class Phase>
struct ScatterToNext
{
    using ItemsType = Items<Lane, Order, Phase::d>;
    using ScratchType = Scratch<Lane, Phase::d>;
    using Scatter = typename Phase::Scatter;

    Order const& cells;
    GridType& grid;
    ScatterBuffers<Lane, Scatter>& buffers;

    ItemsType begin(std::size_t block, std::uint64_t rows, ScratchType& scratch)
    {
        clear_rows<GridType, Phase::channels>(grid.next_tile(block), rows);
        grid.next_touched(block) = rows;
        return {cells, block, scratch};
    }
    void scatter(std::size_t block, int first, int behind, ScratchType& scratch)
    {
        typename Phase::Number const* const nothing = nullptr;
        for_each_group<Lane, GridType>(
            cells, block, first, behind, scratch, nothing, grid.next_tile(block),
            [&](auto& group, std::size_t) { detail::scatter<Scatter>(group, buffers.spreads); });
    }
    void end(std::size_t) {}

    /// What groups scatter to that go by rank.
    auto* tile(std::size_t block) { return grid.next_tile(block); }
    auto& spreads() { return buffers.spreads; }
};

/// The same for items that move. Of the leavers, some scatter when the rest of their block has (see
/// CellOrder::note_outgoing).
template <class Lane, class Order, class GridType, class Phase>
struct MoveAndScatter
{
    using ItemsType = MovingItems<Lane, Order, Phase::d>;
    using Stay = ScatterToNext<Lane, Order, GridType, Phase>;
    using ScratchType = typename Stay::ScratchType;

    Order& cells;
    typename Order::LeaverNotes& notes;
    Stay stay;

    ItemsType begin(std::size_t block, std::uint64_t rows, ScratchType& scratch)
    {
        stay.begin(block, rows, scratch);
        return {cells, block, scratch, notes};
    }
    void scatter(std::size_t block, int first, int behind, ScratchType& scratch)
    {
        stay.scatter(block, first, behind, scratch);
    }
    void end(std::size_t block)
    {
        scatter_listed<Lane, typename Phase::Scatter>(cells.note_outgoing(block, notes), stay.grid,
                                                      stay.grid.next_tile(block),
                                                      stay.grid.next_touched(block), stay.buffers);
    }
};

/// For loops that only gather.
template <class Lane, class Order, class Phase>
struct ScatterNothing
{
    using ItemsType = Items<Lane, Order, Phase::d>;
    using ScratchType = Scratch<Lane, Phase::d>;

    Order const& cells;

    ItemsType begin(std::size_t block, std::uint64_t, ScratchType& scratch)
    {
        return {cells, block, scratch};
    }
    void scatter(std::size_t, int, int, ScratchType&) {}
    void end(std::size_t) {}
};

/// Each block of cells copies the nodes it needs into one tile; its items gather from it and are updated, and
/// their contributions are scattered by the buffers of each thread: `make_buffers(its number)`. Gather and
/// scatter go group by group; the update in between goes by whole packs, which sparse groups share.
template <class Lane, class Order, class GridType, class Phase, class MakeBuffers>
typename Phase::Result gather_and_update(Threads const& threads, Order& cells, GridType& grid,
                                         Phase const& phase, Workspace& workspace,
                                         MakeBuffers const& make_buffers)
{
    constexpr int lanes = lane_width<Lane>;
    int const blocks = static_cast<int>(cells.blocks().size());
    using Result = typename Phase::Result;
    auto& results = ResultsOf<Result>::make_ready(workspace, cells.blocks().size());
    workspace.for_threads(threads.count);
    parallel_for(threads, blocks, cells.partitions(), [&](int thread) {
        // On the heap: compilers would split it into scalars and copy these for every group.
        auto& gather_buffers = workspace.of<GatherBuffers<Lane, GridType, Phase>>(thread);
        gather_buffers.nodes.resize(Phase::node_channels * GridType::tile_channel);
        return [&, found = Result{}, buffers = make_buffers(thread)](int b) mutable {
            Result& result = results.begin(static_cast<std::size_t>(b));
            // no structured binding: clang's OpenMP does not capture it in a lambda
            auto& nodes = gather_buffers.nodes;
            auto& nodes_of_cells = gather_buffers.nodes_of_cells;
            auto& scratch = gather_buffers.scratch;
            typename Phase::Number* const nowhere = nullptr;
            std::uint64_t const rows = touched_by_items<GridType>(cells, std::size_t(b));
            fill_tile<GridType, Phase::node_channels>(grid, std::size_t(b), rows, nodes.data());
            auto items = buffers.begin(std::size_t(b), rows, scratch);
            for (int g = 0, next; g < GridType::Shape::groups; g = next) {
                next = cells.end_of_groups(std::size_t(b), g);
                std::size_t const begin = cells.group_begin(std::size_t(b), g),
                                  end = cells.group_end(std::size_t(b), next - 1);
                if (begin == end) continue;
                if constexpr (GoesByRank<Lane, Phase>)
                    if (next == g + 1) {
                        GroupOf<Lane, GridType> group(cells.counts(std::size_t(b), g), g, scratch, 0,
                                                      std::as_const(nodes).data(),
                                                      buffers.tile(std::size_t(b)));
                        if (openmp::go_by_rank(end - begin, group.ranks(), lanes)) {
                            detail::go_by_rank(phase, group, begin, cells.size(), nodes_of_cells,
                                               buffers.spreads());
                            continue;
                        }
                    }
                scratch.reserve(Phase::scratch_channels, end - begin);
                for (std::size_t slot = begin; slot < end; slot += lanes) {
                    if constexpr (Phase::work.loads_stored)
                        items.enter_slots(slot, end, slot - begin);
                    else
                        items.enter(slot, end, slot - begin);
                    begin_items(phase, items);
                }
                std::size_t from = begin;
                for_each_group<Lane, GridType>(
                    cells, std::size_t(b), g, next, scratch, std::as_const(nodes).data(), nowhere,
                    [&](auto& group, std::size_t behind) {
                        if constexpr (SaysWhatComes<Phase>)
                            gather<typename Phase::Gather>(group, behind, nodes_of_cells, [&](int rank) {
                                std::size_t const ahead = std::size_t(rank) * lane_width<Lane>;
                                if (end + ahead < cells.size())
                                    phase.expect(ExpectedItems{from + ahead, end + ahead});
                            });
                        else
                            gather<typename Phase::Gather>(group, behind, nodes_of_cells, ExpectNothing{});
                        from = begin + behind;
                    });
                for (std::size_t slot = begin; slot < end; slot += lanes) {
                    items.enter_again(slot, slot - begin);
                    update_items(phase, items, found, result);
                }
                buffers.scatter(std::size_t(b), g, next, scratch);
            }
            result.merge(found);
            buffers.end(std::size_t(b));
        };
    });
    return results.merged(cells);
}
} // namespace detail

/// Items gather from the nodes, move, and scatter to their block's tile for the next step.
template <class Lane, class Order, class GridType, class Phase>
typename Phase::Result move(Threads const& threads, Order& cells, GridType& grid, Phase const& phase)
{
    cells.expect_outgoing();
    Workspace& workspace = cells.workspace();
    return detail::gather_and_update<Lane>(threads, cells, grid, phase, workspace, [&](int thread) {
        return detail::MoveAndScatter<Lane, Order, GridType, Phase>{
            cells,
            workspace.of<typename Order::LeaverNotes>(thread),
            {cells, grid, workspace.of<detail::ScatterBuffers<Lane, typename Phase::Scatter>>(thread)}};
    });
}

/// Items gather from the nodes and scatter in place to the next sums.
template <class Lane, class Order, class GridType, class Phase>
void scatter_back(Threads const& threads, Order const& cells, GridType& grid, Phase const& phase)
{
    Workspace& workspace = cells.workspace();
    detail::gather_and_update<Lane>(threads, cells, grid, phase, workspace, [&](int thread) {
        return detail::ScatterToNext<Lane, Order, GridType, Phase>{
            cells, grid, workspace.of<detail::ScatterBuffers<Lane, typename Phase::Scatter>>(thread)};
    });
}

/// Items gather from the nodes as in their last move, and the phase stores the results. Several host threads
/// may do so at the same time, so this does not use the workspace of the cells.
template <class Lane, class Order, class GridType, class Phase>
void gather(Threads const& threads, Order const& cells, GridType const& grid, Phase const& phase)
{
    Workspace own;
    detail::gather_and_update<Lane>(threads, cells, grid, phase, own,
                                    [&](int) { return detail::ScatterNothing<Lane, Order, Phase>{cells}; });
}

} // namespace firn::openmp
