// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/cuda/scan.hpp>

#include <cstdint>

// Blocks that have lost all of their items: how many may stay, and how the others are dropped.
namespace firn::cuda::detail
{

/// How many blocks may be empty beside `live` occupied ones. With many blocks memory matters; in a `small`
/// scene (see CellOrder::is_small) the host should seldom be needed.
FIRN_HOST_DEVICE inline std::uint32_t most_empty_blocks(std::uint32_t live, bool small)
{
    return small ? 32 + 2 * live : live <= 4096 ? 8 + live / 8 : live / 32;
}

/// Counts the blocks that hold items.
static __global__ void count_live_blocks(std::uint32_t const* begin, std::uint32_t blocks,
                                         std::uint32_t* live_count)
{
    std::uint32_t const b = blockIdx.x * blockDim.x + threadIdx.x;
    bool const holds = b < blocks && begin[(b + 1) * 64] > begin[b * 64];
    std::uint32_t const with_me = __ballot_sync(~0u, holds);
    if (threadIdx.x % 32 == 0) atomicAdd(live_count, static_cast<std::uint32_t>(__popc(with_me)));
}

/// Lists the blocks that hold items, in their order.
static __global__ void __launch_bounds__(scanning_threads)
    find_live_blocks(std::uint32_t const* begin, std::uint32_t blocks, std::uint32_t* live,
                     std::uint32_t* live_count)
{
    std::uint32_t before = 0;
    for (std::uint32_t first = 0; first < blocks; first += scanning_threads) {
        std::uint32_t const b = first + threadIdx.x;
        bool const holds = b < blocks && begin[(b + 1) * 64] > begin[b * 64];
        std::uint64_t total;
        std::uint64_t const mine = sum_before_in_block<scanning_threads>(holds, total);
        if (holds) live[before + mine] = b;
        before += static_cast<std::uint32_t>(total);
    }
    if (threadIdx.x == 0) *live_count = before;
}

/// Copies the cells of the blocks that stay to their new places.
static __global__ void keep_blocks(std::uint32_t const* blocks_before, std::uint32_t const* begin,
                                   std::uint32_t const* arrived_begin, std::uint32_t* new_begin,
                                   std::uint32_t* new_arrived_begin)
{
    std::uint32_t const from = blocks_before[blockIdx.x] * 64 + threadIdx.x,
                        to = blockIdx.x * 64 + threadIdx.x;
    new_begin[to] = begin[from];
    new_arrived_begin[to] = arrived_begin[from];
    if (blockIdx.x + 1 != gridDim.x || threadIdx.x != 63) return;
    new_begin[to + 1] = begin[from + 1];
    new_arrived_begin[to + 1] = arrived_begin[from + 1];
}

} // namespace firn::cuda::detail
