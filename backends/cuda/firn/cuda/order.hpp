// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/cuda/block_set.hpp>
#include <firn/cuda/tuning.hpp>

#include <array>
#include <cstdint>

// The loops that keep the order of cells up to date.
namespace firn::cuda::detail
{

/// Items on their way to other cells. What a departed item gives to the grid lies beside it: `given` has one
/// row of `most` numbers per channel, its offset from the centre of its cell first.
template <class Number>
struct Movers
{
    std::uint32_t* count;
    std::uint32_t most;     ///< there is room for so many
    std::uint32_t* slot;    ///< where the item lies
    std::uint32_t* cell;    ///< where it was
    std::uint32_t* way;     ///< to which neighbour it goes: three digits of base 3, first axis highest
    std::uint32_t* to;      ///< its cell now
    std::uint32_t* arrival; ///< a number of its own among those that come into the same cell
    Number* given;
};

/// What changes about cells when items move.
struct Changes
{
    std::uint32_t* stay;          ///< per cell: items that stay
    std::uint32_t* arrivals;      ///< per cell: items that come
    std::uint32_t* group_left;    ///< per group of cells: items that leave
    std::uint32_t* block_arrived; ///< per block: items that come into its cells
};

/// Finds the new cells of departed items, and counts them there; wants the blocks that are not there yet.
template <int d, class Number>
__global__ void find_new_cells(Movers<Number> movers, Changes changes, BlockSet::View set,
                               std::uint64_t const* keys)
{
    using Shape = BlockShape<d>;
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= *movers.count || i >= movers.most) return;
    std::uint32_t block = movers.cell[i] / Shape::cells, way = movers.way[i];
    Coordinates<d> cell = Shape::cell(movers.cell[i] % Shape::cells), beyond;
    bool leaves_block = false;
    for (int a = d - 1; a >= 0; --a, way /= 3) {
        int const moved = cell[a] + static_cast<int>(way % 3) - 1;
        beyond[a] = moved >> Shape::bits;
        cell[a] = moved & (Shape::extent - 1);
        leaves_block = leaves_block || beyond[a] != 0;
    }
    if (leaves_block) {
        std::uint64_t const key = block_key<d>(block_of_key<d>(keys[block]) + beyond);
        block = set.find(key);
        if (block == absent) {
            set.want(key);
            movers.to[i] = absent;
            return;
        }
    }
    std::uint32_t const to = block * Shape::cells + static_cast<std::uint32_t>(Shape::place(cell));
    movers.to[i] = to;
    movers.arrival[i] = atomicAdd(changes.arrivals + to, 1u);
    atomicAdd(changes.block_arrived + block, 1u);
}

/// The same for new items, which say where they are.
template <int d, class Number>
__global__ void find_cells(Movers<Number> movers, std::array<int, d> const* cells, std::uint32_t first,
                           std::uint32_t count, Changes changes, BlockSet::View set)
{
    using Shape = BlockShape<d>;
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    Coordinates<d> cell, in_block;
    for (int a = 0; a < d; ++a) {
        in_block[a] = cells[i][a] & (Shape::extent - 1);
        cell[a] = cells[i][a] >> Shape::bits;
    }
    std::uint64_t const key = block_key<d>(cell);
    std::uint32_t const block = set.find(key);
    if (block == absent) {
        set.want(key);
        return;
    }
    std::uint32_t const to = block * Shape::cells + static_cast<std::uint32_t>(Shape::place(in_block));
    movers.slot[i] = first + i;
    movers.to[i] = to;
    movers.arrival[i] = atomicAdd(changes.arrivals + to, 1u);
    atomicAdd(changes.block_arrived + block, 1u);
}

/// What changes if nobody moves: nothing.
static __global__ void stay_all(std::uint32_t const* begin, std::uint32_t cells, Changes changes)
{
    std::uint32_t const c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= cells) return;
    changes.stay[c] = begin[c + 1] - begin[c];
    changes.arrivals[c] = 0;
    if (c % 32 == 0) changes.group_left[c / 32] = 0;
    if (c % 64 == 0) changes.block_arrived[c / 64] = 0;
}

/// The sum of a value over the lanes of a warp before this one; `total` becomes that over all.
__device__ inline std::uint64_t sum_before(std::uint64_t value, std::uint64_t& total)
{
    int const lane = static_cast<int>(threadIdx.x % 32);
    std::uint64_t sum = value;
    for (int step = 1; step < 32; step *= 2) {
        std::uint64_t const other = __shfl_up_sync(~0u, sum, step);
        if (lane >= step) sum += other;
    }
    total = __shfl_sync(~0u, sum, 31);
    return sum - value;
}

/// The same over the threads of a group of them.
template <int threads>
__device__ std::uint64_t sum_before_in_block(std::uint64_t value, std::uint64_t& total)
{
    __shared__ std::uint64_t of_warp[threads / 32];
    std::uint64_t of_mine;
    std::uint64_t before = sum_before(value, of_mine);
    if (threadIdx.x % 32 == 31) of_warp[threadIdx.x / 32] = of_mine;
    __syncthreads();
    total = 0;
    for (unsigned w = 0; w < threads / 32; ++w) {
        if (w < threadIdx.x / 32) before += of_warp[w];
        total += of_warp[w];
    }
    __syncthreads();
    return before;
}

inline constexpr int scanning_threads = 1024;

/// Where each block's items and arrivals begin: both counts in one number, items in its lower half. One group
/// of threads does it all: there are few blocks.
static __global__ void __launch_bounds__(scanning_threads)
    find_block_begins(std::uint32_t const* begin, std::uint32_t blocks, Changes changes,
                      std::uint64_t* block_begin)
{
    std::uint64_t before = 0;
    for (std::uint32_t first = 0; first < blocks; first += scanning_threads) {
        std::uint32_t const b = first + threadIdx.x;
        std::uint64_t count = 0;
        if (b < blocks) {
            std::uint32_t const arrived = changes.block_arrived[b];
            std::uint32_t const had = begin[(b + 1) * 64] - begin[b * 64];
            std::uint32_t const left = changes.group_left[2 * b] + changes.group_left[2 * b + 1];
            count = (std::uint64_t(arrived) << 32) | (had - left + arrived);
        }
        std::uint64_t total;
        std::uint64_t const mine = before + sum_before_in_block<scanning_threads>(count, total);
        if (b < blocks) block_begin[b] = mine;
        before += total;
    }
}

/// Writes a block's new cells, and the new order of those who stay: they keep their order in the cell.
static __global__ void __launch_bounds__(64)
    place_stayers(std::uint32_t const* begin, Changes changes, std::uint64_t const* block_begin,
                  unsigned char const* left, std::uint32_t const* source, std::uint32_t* new_begin,
                  std::uint32_t* movers_begin, std::uint32_t* order)
{
    std::uint32_t const c = blockIdx.x * 64 + threadIdx.x;
    std::uint32_t const arrivals = changes.arrivals[c];
    std::uint64_t total;
    std::uint64_t const mine =
        block_begin[blockIdx.x] +
        sum_before_in_block<64>((std::uint64_t(arrivals) << 32) | (changes.stay[c] + arrivals), total);
    std::uint32_t to = static_cast<std::uint32_t>(mine);
    new_begin[c] = to;
    movers_begin[c] = static_cast<std::uint32_t>(mine >> 32);
    if (blockIdx.x + 1 == gridDim.x && threadIdx.x == 63) {
        new_begin[c + 1] = to + changes.stay[c] + arrivals;
        movers_begin[c + 1] = static_cast<std::uint32_t>(mine >> 32) + arrivals;
    }

    std::uint32_t const count = begin[c + 1] - begin[c], below = (1u << threadIdx.x % 32) - 1;
    std::uint32_t slot = begin[c - threadIdx.x % 32];
    for (std::uint32_t rank = 0;; ++rank) {
        std::uint32_t const pattern = __ballot_sync(~0u, rank < count);
        if (pattern == 0) break;
        std::uint32_t const at = slot + __popc(pattern & below);
        slot += __popc(pattern);
        if (rank >= count || (left && left[at])) continue;
        order[to++] = source ? source[begin[c] + rank] : at;
    }
}

/// Puts each arrival among those of its cell.
template <class Number>
__global__ void place_arrivals(Movers<Number> movers, std::uint32_t count, std::uint32_t const* movers_begin,
                               std::uint32_t* arrived)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) arrived[movers_begin[movers.to[i]] + movers.arrival[i]] = i;
}

/// Brings the offsets of arrivals back into their cells, and with them what they give from there.
template <int d, class Number>
__global__ void wrap_offsets(Movers<Number> movers, std::uint32_t count,
                             std::array<typename CellOffset<Number>::Stored*, d> offset)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    std::uint32_t const slot = movers.slot[i];
    for (int a = 0; a < d; ++a) {
        auto stored = offset[a][slot];
        CellOffset<Number>::wrap(stored);
        offset[a][slot] = stored;
        movers.given[std::size_t(a) * movers.most + i] = CellOffset<Number>::value(stored);
    }
}

/// Orders the arrivals of each cell by where they lie, and writes them behind those who stayed. A warp takes
/// its cells together where one has many.
template <class Number>
__global__ void sort_arrivals(Movers<Number> movers, std::uint32_t cells, std::uint32_t const* movers_begin,
                              std::uint32_t const* new_begin, Changes changes, std::uint32_t* arrived,
                              std::uint32_t* spare, std::uint32_t* order)
{
    constexpr std::uint32_t few = 32;
    std::uint32_t const c = blockIdx.x * blockDim.x + threadIdx.x;
    std::uint32_t first = 0, count = 0, to = 0;
    if (c < cells) {
        first = movers_begin[c];
        count = movers_begin[c + 1] - first;
        to = new_begin[c] + changes.stay[c];
    }
    if (count <= few) {
        for (std::uint32_t i = 1; i < count; ++i) {
            std::uint32_t const item = arrived[first + i], slot = movers.slot[item];
            std::uint32_t at = i;
            for (; at > 0 && movers.slot[arrived[first + at - 1]] > slot; --at)
                arrived[first + at] = arrived[first + at - 1];
            arrived[first + at] = item;
        }
        for (std::uint32_t i = 0; i < count; ++i) order[to + i] = movers.slot[arrived[first + i]];
    }
    for (std::uint32_t crowded = __ballot_sync(~0u, count > few); crowded != 0; crowded &= crowded - 1) {
        int const lane = __ffs(static_cast<int>(crowded)) - 1;
        std::uint32_t const begin = __shfl_sync(~0u, first, lane), items = __shfl_sync(~0u, count, lane),
                            where = __shfl_sync(~0u, to, lane);
        for (std::uint32_t i = threadIdx.x % 32; i < items; i += 32) {
            std::uint32_t const item = arrived[begin + i], slot = movers.slot[item];
            std::uint32_t rank = 0;
            for (std::uint32_t j = 0; j < items; ++j) rank += movers.slot[arrived[begin + j]] < slot;
            spare[begin + rank] = item;
            order[where + rank] = slot;
        }
        __syncwarp();
        for (std::uint32_t i = threadIdx.x % 32; i < items; i += 32) arrived[begin + i] = spare[begin + i];
        __syncwarp();
    }
}

} // namespace firn::cuda::detail
