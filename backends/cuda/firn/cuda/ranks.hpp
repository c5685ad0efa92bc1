// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

// How a warp goes through the incoming items of its cells.
namespace firn::cuda::detail
{

/// Calls `use(rank, whether the cell has an item of it)` with all lanes of a warp, each for `count` items of
/// a cell of its own: for every rank, or for those of one of several teams.
template <class Use>
__device__ void for_each_rank(std::uint32_t count, Use const& use, std::uint32_t team, std::uint32_t teams)
{
    for (std::uint32_t rank = team; __any_sync(~0u, rank < count); rank += teams) use(rank, rank < count);
}

} // namespace firn::cuda::detail
