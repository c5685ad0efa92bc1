// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/items_of_block.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/shared_memory.hpp>
#include <firn/cuda/shared_tiles.hpp>

#include <cstddef>
#include <cstdint>

// The loops that gather: items move and scatter to the next grid, or scatter in place, or only gather.
namespace firn::cuda::detail
{

/// What the moving loop writes beside what the phase does.
template <class Number, int d, class Result>
struct Moved
{
    Leavers<Number> leavers;
    Destinations<d> to;
    unsigned char* left;
    ResultsOfGroups<Result> results;
};

/// All items gather, are updated, and scatter to the tile of the next step. Leavers go to a list, and to the
/// list of their new cell.
template <unsigned teams, class Order, class GridType, class Phase>
__global__ void __launch_bounds__(teams* ShapeOfItems<GridType, Phase>::team_threads,
                                  teams == 1 ? ShapeOfItems<GridType, Phase>::groups : 1)
    move(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid,
         Moved<typename GridType::Number, Phase::d, typename Phase::Result> moved)
{
    using In = ShapeOfItems<GridType, Phase>;
    Signal::Heard const heard = signal.hear();
    std::uint32_t const block = cells.block(blockIdx.x);
    ItemsOfBlock<Order, GridType, Phase, teams> items(cells, block); // loaded while the signal is on its way
    if (heard.stops()) return;
    __shared__ std::uint32_t left_cell[block_threads], left_chunk, first_leaver;
    if (threadIdx.x < block_threads) left_cell[threadIdx.x] = 0;
    if (threadIdx.x == 0) left_chunk = 0;
    items.read(grid, block);
    typename Phase::Result result{}, rare{};
    std::uint32_t left_block = 0;
    items.for_each(
        [&](auto& item, std::uint32_t i) {
            phase.begin(item);
            Phase::gather(item);
            phase.update(item, result, rare);
            moved.left[item.slot()] = item.leaves();
            items.store(item, i);
            if (item.leaves()) atomicAdd(left_cell + items.note_leaver(item, i, left_chunk), 1u);
        },
        [&](bool is_first) {
            std::uint32_t const left = left_chunk;
            left_block += left;
            if (threadIdx.x == 0 && left > 0)
                first_leaver = atomicAdd(&moved.leavers.counters->outgoing, left);
            items.scatter(grid.next_tiles + std::size_t(block) * GridType::TileShape::nodes, is_first, [&] {
                if (left == 0) return;
                items.write_leavers(moved.leavers, moved.to, block, first_leaver, left);
                if (threadIdx.x == 0) left_chunk = 0;
                __syncthreads();
            });
        });
    if (threadIdx.x < block_threads) {
        Changes const& changes = moved.to.changes;
        std::uint32_t const left = left_cell[threadIdx.x];
        changes.stay[block * block_threads + threadIdx.x] = items.size_of_cell(threadIdx.x) - left;
        if constexpr (Order::View::forgets_incoming) forget_incoming(changes, block);
        bool const some_left = __any_sync(~0u, left > 0);
        if (threadIdx.x % 32 == 0) changes.group_left[2 * block + threadIdx.x / 32] = some_left;
        if (threadIdx.x == 0) changes.block_stay[block] = items.size() - left_block;
    }
    result.merge(rare);
    using Result = typename Phase::Result;
    if constexpr (In::leaves_results)
        moved.results.take_in(result, reinterpret_cast<std::uint32_t*>(shared_memory() + In::contributions),
                              block);
    else {
        __shared__ __align__(16) unsigned char parts[In::declared_results(teams)];
        moved.results.take(result, reinterpret_cast<Result*>(parts), block);
    }
}

/// Shared memory that the moving loop declares for a phase, without padding in between [bytes].
template <class GridType, class Phase>
inline constexpr std::size_t declared_by_move =
    ShapeOfItems<GridType, Phase>::declared_results(ShapeOfItems<GridType, Phase>::most_teams) +
    block_threads * sizeof(std::uint32_t) + 64;

/// All items gather and scatter in place to their block's tile of the next sums.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(ShapeOfItems<GridType, Phase>::team_threads)
    scatter_back(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid)
{
    if (signal.stops()) return;
    std::uint32_t const block = cells.block(blockIdx.x);
    ItemsOfBlock<Order, GridType, Phase> items(cells, block);
    items.read(grid, block);
    typename Phase::Result result{};
    items.for_each(
        [&](auto& item, std::uint32_t i) {
            phase.begin(item);
            Phase::gather(item);
            phase.update(item, result);
            items.store(item, i);
        },
        [&](bool is_first) {
            items.scatter(grid.next_tiles + std::size_t(block) * GridType::TileShape::nodes, is_first, [] {});
        });
}

/// All items gather, and the phase stores what it needs.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(ShapeOfItems<GridType, Phase>::team_threads)
    gather(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid)
{
    if (signal.stops()) return;
    std::uint32_t const block = cells.block(blockIdx.x);
    ItemsOfBlock<Order, GridType, Phase> items(cells, block);
    items.read(grid, block);
    typename Phase::Result result{};
    items.for_each(
        [&](auto& item, std::uint32_t) {
            phase.begin(item);
            Phase::gather(item);
            phase.update(item, result);
        },
        [](bool) {});
}

} // namespace firn::cuda::detail
