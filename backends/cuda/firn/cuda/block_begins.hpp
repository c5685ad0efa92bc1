// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/changes.hpp>
#include <firn/cuda/scan.hpp>
#include <firn/cuda/teams.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/grid/block_key.hpp>

#include <cstddef>
#include <cstdint>
#include <vector>

// Where the items of blocks begin in the new order: found by one group of threads for all blocks, or by each
// group for its own.
namespace firn::cuda::detail
{

inline constexpr int scanned_at_once = 8;

/// Where each block's items, and its incoming items, begin.
struct BlockBegins
{
    std::uint32_t blocks;
    std::uint64_t* of_block; ///< both counts in one number, items in the lower half
};

/// Finds them with one group of threads, since blocks are few. Returns how many hold items.
__device__ inline std::uint32_t find_block_begins(BlockBegins const& begins, Changes const& changes)
{
    std::uint32_t const blocks = begins.blocks;
    std::uint64_t before = 0;
    std::uint32_t live = 0;
    for (std::uint32_t first = 0; first < blocks; first += scanning_threads * scanned_at_once) {
        std::uint64_t count[scanned_at_once], sum = 0;
#pragma unroll
        for (int i = 0; i < scanned_at_once; ++i) {
            std::uint32_t const b = first + threadIdx.x * scanned_at_once + static_cast<std::uint32_t>(i);
            count[i] = 0;
            if (b >= blocks) continue;
            std::uint32_t const arrived =
                __ldcg(changes.block_arrived + b); // other multiprocessors have just counted it
            count[i] = (std::uint64_t(arrived) << 32) | (changes.block_stay[b] + arrived);
            live += count[i] != 0;
        }
#pragma unroll
        for (int i = 0; i < scanned_at_once; ++i) sum += count[i];
        std::uint64_t total;
        std::uint64_t mine = before + sum_before_in_block<scanning_threads>(sum, total);
#pragma unroll
        for (int i = 0; i < scanned_at_once; ++i) {
            std::uint32_t const b = first + threadIdx.x * scanned_at_once + static_cast<std::uint32_t>(i);
            if (b < blocks) begins.of_block[b] = mine;
            mine += count[i];
        }
        before += total;
    }
    std::uint64_t all_live;
    sum_before_in_block<scanning_threads>(live, all_live);
    return static_cast<std::uint32_t>(all_live);
}

/// The same as a loop of its own.
static __global__ void __launch_bounds__(scanning_threads)
    find_all_block_begins(BlockBegins begins, Changes changes)
{
    find_block_begins(begins, changes);
}

/// With many blocks it is done by several groups of threads, each for a chunk of the blocks, in two loops:
/// this one counts the items of each chunk.
inline constexpr std::uint32_t blocks_of_chunk = 2 * scanning_threads;

static __device__ std::uint64_t count_of_block(BlockBegins const& begins, Changes const& changes,
                                               std::uint32_t b)
{
    if (b >= begins.blocks) return 0;
    std::uint64_t const arrived = changes.block_arrived[b];
    return (arrived << 32) | (changes.block_stay[b] + arrived);
}
static __global__ void __launch_bounds__(scanning_threads)
    count_chunks(BlockBegins begins, Changes changes, std::uint64_t* chunks)
{
    std::uint32_t const b = blockIdx.x * blocks_of_chunk + 2 * threadIdx.x;
    std::uint64_t all;
    sum_before_in_block<scanning_threads>(
        count_of_block(begins, changes, b) + count_of_block(begins, changes, b + 1), all);
    if (threadIdx.x == 0) chunks[blockIdx.x] = all;
}
/// And this one finds where the blocks of each begin.
static __global__ void __launch_bounds__(scanning_threads)
    find_begins_of_chunks(BlockBegins begins, Changes changes, std::uint64_t const* chunks)
{
    std::uint64_t of_others = 0, before;
    for (std::uint32_t c = threadIdx.x; c < blockIdx.x; c += scanning_threads) of_others += chunks[c];
    sum_before_in_block<scanning_threads>(of_others, before);
    std::uint32_t const b = blockIdx.x * blocks_of_chunk + 2 * threadIdx.x;
    std::uint64_t const first = count_of_block(begins, changes, b),
                        second = count_of_block(begins, changes, b + 1);
    std::uint64_t all;
    std::uint64_t const mine = before + sum_before_in_block<scanning_threads>(first + second, all);
    if (b < begins.blocks) begins.of_block[b] = mine;
    if (b + 1 < begins.blocks) begins.of_block[b + 1] = mine + first;
}

/// Finds them by loops of their own; `chunks` is memory for what chunks count.
inline void find_begins_of_all_blocks(Queue const& queue, BlockBegins const& begins, Changes const& changes,
                                      Array<std::uint64_t>& chunks)
{
    unsigned const count = groups_of(begins.blocks, blocks_of_chunk);
    if (count <= 1) {
        launch_after("find_all_block_begins", queue, find_all_block_begins, 1, scanning_threads, begins,
                     changes);
        return;
    }
    chunks.renew(count);
    launch_after("count_chunks", queue, count_chunks, count, scanning_threads, begins, changes,
                 chunks.data());
    launch_after("find_begins_of_chunks", queue, find_begins_of_chunks, count, scanning_threads, begins,
                 changes, chunks.data());
}

/// Where a block's items, and its incoming items, begin. With few blocks each group of threads finds it by
/// itself.
__device__ inline std::uint64_t find_block_begin(std::uint32_t block, Changes const& changes)
{
    __shared__ std::uint64_t of_warp[most_teams_that_rebin * 2];
    std::uint64_t sum = 0;
#pragma unroll 4
    for (std::uint32_t b = threadIdx.x; b < block; b += blockDim.x) {
        std::uint32_t const arrived = __ldcg(changes.block_arrived + b);
        sum += (std::uint64_t(arrived) << 32) | (changes.block_stay[b] + arrived);
    }
    sum_before(sum, sum);
    if (threadIdx.x % 32 == 0) of_warp[threadIdx.x / 32] = sum;
    __syncthreads();
    sum = 0;
    for (std::uint32_t w = 0; w < blockDim.x / 32; ++w) sum += of_warp[w];
    return sum;
}

/// How many blocks will hold items, counted by all threads of a group; the first thread gets the result.
__device__ inline std::uint32_t count_live_blocks(std::uint32_t blocks, Changes const& changes)
{
    __shared__ std::uint32_t count;
    if (threadIdx.x == 0) count = 0;
    __syncthreads();
    std::uint32_t live = 0;
#pragma unroll 4
    for (std::uint32_t b = threadIdx.x; b < blocks; b += blockDim.x)
        live += changes.block_stay[b] + __ldcg(changes.block_arrived + b) > 0;
    atomicAdd(&count, live);
    __syncthreads();
    return count;
}

/// Calls `visit(where it lies, coordinates of its cell)` for every item, on the host. An empty `order` says
/// that items lie at their slots.
template <int d, class Visit>
void for_each_item(std::vector<std::uint64_t> const& keys, std::vector<std::uint32_t> const& begin,
                   std::vector<std::uint32_t> const& order, Visit const& visit)
{
    using Shape = BlockShape<d>;
    for (std::size_t c = 0; c + 1 < begin.size(); ++c) {
        Coordinates<d> const block = block_of_key<d>(keys[c / Shape::cells]),
                             cell =
                                 block * int{Shape::extent} + Shape::cell(static_cast<int>(c % Shape::cells));
        for (std::uint32_t slot = begin[c]; slot < begin[c + 1]; ++slot)
            visit(order.empty() ? std::size_t{slot} : std::size_t{order[slot]}, cell);
    }
}

} // namespace firn::cuda::detail
