// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/items_of_block.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/ranks.hpp>
#include <firn/cuda/shared_memory.hpp>
#include <firn/cuda/shared_tiles.hpp>

#include <cstddef>
#include <cstdint>

// The loops that only scatter: all items, or those that came into another cell.
namespace firn::cuda::detail
{

/// All items scatter to the tile of their block.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(ShapeOfItems<GridType, Phase>::team_threads)
    scatter(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid, bool afresh)
{
    if (signal.stops()) return;
    std::uint32_t const block = cells.block(blockIdx.x);
    ItemsOfBlock<Order, GridType, Phase> items(cells, block);
    items.read(grid, block);
    items.for_each(
        [&](auto& item, std::uint32_t i) {
            phase.prepare(item);
            items.store(item, i);
        },
        [&](bool is_first) {
            items.scatter(grid.tiles + std::size_t(block) * GridType::TileShape::nodes, afresh && is_first,
                          [] {});
        });
}

/// Items that came into the cells of a block scatter the contributions that were stored when they left
/// theirs.
template <class Order, class GridType, class Phase>
struct ScatterIncoming
{
    typename Order::View cells;
    typename Order::Arrived arrived;
    typename Order::Leavers leavers;
    typename GridType::View grid;

    /// Called by all threads of a group of `teams` teams, with shared memory for the sums of each.
    __device__ void operator()(std::uint32_t block, ArrivedInCell const& came, std::uint32_t teams) const
    {
        if (!__syncthreads_or(came.count > 0)) return; // most blocks have few, or none
        SharedTiles<GridType> const tiles(shared_memory(), false);
        tiles.clear_sums();
        __syncthreads();
        std::uint32_t const team = teams == 1 ? 0 : threadIdx.x / block_threads,
                            place = threadIdx.x % block_threads;
        CellOfThread<Order, GridType, Phase, Phase::d> cell(cells.cell(block * block_threads + place),
                                                            nullptr);
        SumsInTile<GridType> sums{tiles.own_sums(int(place))};
        std::uint32_t const* const of_cell = arrived.arrived + came.begin;
        std::uint32_t next = team < came.count ? of_cell[team] : 0; // loaded one rank ahead
        auto const use = [&](std::uint32_t rank, bool here) {
            cell.forget();
            sums.here = here;
            if (here) {
                cell.read_outgoing(leavers, next);
                if (rank + teams < came.count) next = of_cell[rank + teams];
            }
            Phase::scatter(cell, sums);
        };
        for_each_rank(came.count, use, team, teams);
        __syncthreads();
        tiles.add_sums(grid.tiles + std::size_t(block) * GridType::TileShape::nodes, teams);
        __syncthreads();
    }
};

/// The same for each block that is here once their order is written, with at most `most` teams. A
/// thread in a small group uses more registers, which costs more than it gains where there are many blocks.
/// In double precision the compiler is not told that a group may use all registers, because it would use more
/// than there are.
template <unsigned most, class Order, class GridType, class Phase>
__global__ void __launch_bounds__(most* block_threads,
                                  most > 1 && sizeof(typename GridType::Number) == sizeof(float) ? 1 : 0)
    scatter_leavers(Signal signal, ScatterIncoming<Order, GridType, Phase> scatter)
{
    if (signal.stops()) return;
    std::uint32_t const block = scatter.cells.block(blockIdx.x);
    std::uint32_t const c = block * block_threads + threadIdx.x % block_threads,
                        begin = scatter.arrived.begin[c];
    scatter(block, {begin, scatter.arrived.begin[c + 1] - begin}, most == 1 ? 1 : blockDim.x / block_threads);
}

} // namespace firn::cuda::detail
