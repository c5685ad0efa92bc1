// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/migration.hpp>

#include <cstdint>

// How a warp goes through the items of its cells.
namespace firn::cuda::detail
{

/// A lane's view of its warp's group of cells: which items are where.
struct Ranks
{
    std::uint32_t begin, count; ///< of the items of the lane's cell
    std::uint32_t slot;         ///< of the first item of the current rank, over all lanes

    __device__ Ranks(std::uint32_t const* begins, std::uint32_t cell)
        : begin(begins[cell]), count(begins[cell + 1] - begin), slot(begins[cell - threadIdx.x % 32])
    {}
    /// Of items that are listed by cell, and have no slots.
    __device__ explicit Ranks(ArrivedInCell const& came) : begin(came.begin), count(came.count), slot(0) {}

    /// Calls `use(rank, whether the cell has an item of it, the item's slot)` with all lanes of the warp: for
    /// every rank, or for those of one of several teams.
    template <class Use>
    __device__ void for_each(Use const& use, std::uint32_t team = 0, std::uint32_t teams = 1)
    {
        std::uint32_t const below = (1u << threadIdx.x % 32) - 1;
        for (std::uint32_t rank = team, passed = 0;; rank += teams) {
            for (; passed < rank; ++passed)
                slot += __popc(__ballot_sync(~0u, passed < count)); // ranks of other teams
            std::uint32_t const pattern = __ballot_sync(~0u, rank < count);
            if (pattern == 0) return;
            use(rank, rank < count, slot + __popc(pattern & below));
            slot += __popc(pattern);
            passed = rank + 1;
        }
    }
};

} // namespace firn::cuda::detail
