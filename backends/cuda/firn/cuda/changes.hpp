// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_set.hpp>

#include <cstdint>

// What changes in cells from one order to the next, and the loops that know it without any motion.
namespace firn::cuda::detail
{

/// What changes in cells when items move.
struct Changes
{
    std::uint32_t* stay;           ///< per cell: how many items stay
    std::uint32_t* incoming;       ///< per cell: how many items come in
    std::uint32_t* first_incoming; ///< per cell: one of these, or absent
    std::uint32_t* group_left;     ///< per group of cells: above 0 if items leave
    std::uint32_t* block_stay;     ///< per block: how many items stay in their cells
    std::uint32_t* block_arrived;  ///< per block: how many items come into its cells
};

/// Clears the incoming items of a block's cells; called by 64 threads.
static __device__ void forget_incoming(Changes const& changes, std::uint32_t block)
{
    std::uint32_t const c = block * 64 + threadIdx.x;
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    if (threadIdx.x == 0) changes.block_arrived[block] = 0;
}

/// Cells of new blocks are empty and begin behind all items; nothing comes into any cell.
static __global__ void clear_cells(std::uint32_t first, std::uint32_t cells, std::uint32_t items,
                                   std::uint32_t* begin, Changes changes)
{
    std::uint32_t const c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= cells) return;
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    if (c % 64 == 0) changes.block_arrived[c / 64] = 0;
    if (c < first) return;
    if (c == 0) begin[0] = items;
    begin[c + 1] = items;
    changes.stay[c] = 0;
    if (c % 32 == 0) changes.group_left[c / 32] = 0;
    if (c % 64 == 0) changes.block_stay[c / 64] = 0;
}

/// The changes if no item moves.
static __global__ void stay_all(std::uint32_t const* begin, std::uint32_t cells, Changes changes)
{
    std::uint32_t const c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= cells) return;
    changes.stay[c] = begin[c + 1] - begin[c];
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    if (c % 32 == 0) changes.group_left[c / 32] = 0;
    if (c % 64 != 0) return;
    changes.block_stay[c / 64] = begin[c + 64] - begin[c];
    changes.block_arrived[c / 64] = 0;
}

/// The changes if items are erased and none moves: those for which `gone[where it lies]` is not 0. `order`
/// says where items lie; null: at their slots.
static __global__ void __launch_bounds__(64)
    leave(std::uint32_t const* begin, std::uint32_t const* order, unsigned char const* gone, Changes changes,
          unsigned char* left)
{
    __shared__ std::uint32_t block_stays;
    if (threadIdx.x == 0) block_stays = 0;
    __syncthreads();
    std::uint32_t const c = blockIdx.x * 64 + threadIdx.x, first = begin[c], count = begin[c + 1] - first;
    std::uint32_t stay = count;
    for (std::uint32_t slot = first; slot < first + count; ++slot) {
        bool const leaves = gone[order ? order[slot] : slot] != 0;
        left[slot] = leaves;
        stay -= leaves;
    }
    changes.stay[c] = stay;
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    bool const some_leave = __any_sync(~0u, stay < count);
    if (c % 32 == 0) changes.group_left[c / 32] = some_leave;
    atomicAdd(&block_stays, stay);
    __syncthreads();
    if (threadIdx.x != 0) return;
    changes.block_stay[blockIdx.x] = block_stays;
    changes.block_arrived[blockIdx.x] = 0;
}

} // namespace firn::cuda::detail
