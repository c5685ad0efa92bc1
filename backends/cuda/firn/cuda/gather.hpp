// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/ranks.hpp>
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
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(most_teams_that_move<Phase>* block_threads, 1)
    move(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid,
         Moved<typename GridType::Number, Phase::d, typename Phase::Result> moved)
{
    using Tile = typename GridType::TileShape;
    Signal::Heard const heard = signal.hear();
    std::uint32_t const team = threadIdx.x / block_threads, teams = blockDim.x / block_threads;
    std::uint32_t const place = threadIdx.x % block_threads, c = blockIdx.x * block_threads + place,
                        below = (1u << threadIdx.x % 32) - 1;
    Ranks ranks(cells.begin, c); // loaded while the signal is on its way
    if (heard.stops()) return;
    std::uint32_t const* const sources = cells.order + ranks.begin;
    std::uint32_t const count = ranks.count;
    std::uint32_t next_source = team < count ? sources[team] : 0; // loaded one rank ahead

    SharedTiles<GridType> const tiles(shared_memory(), true);
    tiles.read_values(grid, blockIdx.x);
    tiles.clear_sums();
    __shared__ std::uint32_t left_cell[block_threads], left_group[2];
    if (threadIdx.x < block_threads) left_cell[threadIdx.x] = 0;
    if (threadIdx.x < 2) left_group[threadIdx.x] = 0;
    __syncthreads();

    CellOfThread<Order, GridType, Phase, Phase::d> cell(
        cells.cell(c), tiles.values + Tile::at(GridType::Shape::cell(int(place))));
    SumsInTile<GridType> sums{tiles.own_sums(int(place))};
    typename Phase::Result result{}, rare{};
    auto const use = [&](std::uint32_t rank, bool here, std::uint32_t slot) {
        cell.forget();
        if (here) {
            cell.enter(next_source, slot);
            if (rank + teams < count) next_source = sources[rank + teams];
            phase.begin(cell);
            Phase::gather(cell);
            phase.update(cell, result, rare);
            moved.left[slot] = cell.leaves();
        }
        if (std::uint32_t const left = __ballot_sync(~0u, cell.leaves())) {
            std::uint32_t first = 0;
            if (threadIdx.x % 32 == 0) {
                first =
                    atomicAdd(&moved.leavers.counters->outgoing, static_cast<std::uint32_t>(__popc(left)));
                atomicAdd(left_group + place / 32, static_cast<std::uint32_t>(__popc(left)));
            }
            std::uint32_t const i = __shfl_sync(~0u, first, 0) + __popc(left & below);
            if (cell.leaves()) {
                atomicAdd(left_cell + place, 1u);
                if (i < moved.leavers.most) {
                    cell.write_outgoing(moved.leavers, i, c);
                    if (moved.to.at_once) find_new_cell<Phase::d>(moved.leavers, moved.to, i, c, cell.way());
                }
                cell.forget_contribution();
            }
        }
        Phase::scatter(cell, sums);
    };
    ranks.for_each(use, team, teams);
    __syncthreads();
    if (team == 0) {
        Changes const& changes = moved.to.changes;
        changes.stay[c] = count - left_cell[place];
        if (place == 0) {
            std::uint32_t const had = cells.begin[c + block_threads] - ranks.begin;
            changes.block_stay[blockIdx.x] = had - left_group[0] - left_group[1];
        }
        if (place % 32 == 0) changes.group_left[2 * blockIdx.x + place / 32] = left_group[place / 32];
    }
    tiles.write_sums(grid.next_tiles + std::size_t(blockIdx.x) * Tile::nodes);
    __shared__ __align__(
        16) unsigned char parts[2 * most_teams_that_move<Phase> * sizeof(typename Phase::Result)];
    result.merge(rare);
    moved.results.take(result, reinterpret_cast<typename Phase::Result*>(parts));
}

/// Shared memory that the moving loop declares for a phase, without padding in between [bytes].
template <class Phase>
inline constexpr std::size_t declared_by_move = 2 * most_teams_that_move<Phase> *
                                                    sizeof(typename Phase::Result) +
                                                (block_threads + 2) * sizeof(std::uint32_t) + 64;

/// All items gather and scatter in place to their block's tile of the next sums.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(block_threads)
    scatter_back(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid)
{
    if (signal.stops()) return;
    SharedTiles<GridType> const tiles(shared_memory(), true);
    tiles.read_values(grid, blockIdx.x);
    tiles.clear_sums();
    __syncthreads();
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    CellOfThread<Order, GridType, Phase, Phase::d> cell(
        cells.cell(c), tiles.values + GridType::TileShape::at(GridType::Shape::cell(int(threadIdx.x))));
    SumsInTile<GridType> sums{tiles.own_sums(int(threadIdx.x))};
    typename Phase::Result result{};
    Ranks(cells.begin, c).for_each([&](std::uint32_t rank, bool here, std::uint32_t slot) {
        cell.forget();
        if (here) {
            cell.enter(cells.order[cells.begin[c] + rank], slot);
            phase.begin(cell);
            Phase::gather(cell);
            phase.update(cell, result);
        }
        Phase::scatter(cell, sums);
    });
    __syncthreads();
    tiles.write_sums(grid.next_tiles + std::size_t(blockIdx.x) * GridType::TileShape::nodes);
}

/// All items gather, and the phase stores what it needs. In double precision the compiler spills with 128 or
/// 168 registers, and when it chooses itself, but not with 96.
template <class Order, class GridType, class Phase>
__global__ void __launch_bounds__(block_threads,
                                  sizeof(typename GridType::Number) == sizeof(float) ? enough_groups : 10)
    gather(Signal signal, Phase phase, typename Order::View cells, typename GridType::View grid)
{
    if (signal.stops()) return;
    SharedTiles<GridType> const tiles(shared_memory(), true);
    tiles.read_values(grid, blockIdx.x);
    __syncthreads();
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    CellOfThread<Order, GridType, Phase, Phase::d> cell(
        cells.cell(c), tiles.values + GridType::TileShape::at(GridType::Shape::cell(int(threadIdx.x))));
    typename Phase::Result result{};
    Ranks(cells.begin, c).for_each([&](std::uint32_t rank, bool here, std::uint32_t slot) {
        if (!here) return;
        cell.enter(cells.order[cells.begin[c] + rank], slot);
        phase.begin(cell);
        Phase::gather(cell);
        phase.update(cell, result);
    });
}

} // namespace firn::cuda::detail
