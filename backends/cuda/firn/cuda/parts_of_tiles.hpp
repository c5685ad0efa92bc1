// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/tuning.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// Parts of tiles, one behind the other: what devices that share a grid swap.
namespace firn::cuda::detail
{

/// The nodes of a block's tile between two corners.
template <int d>
struct PartOfTile
{
    std::uint32_t block;
    std::uint32_t first; ///< where the part begins among all parts
    std::array<std::uint8_t, d> begin, end;

    FIRN_HOST_DEVICE std::uint32_t nodes() const
    {
        std::uint32_t count = 1;
        for (unsigned a = 0; a < d; ++a) count *= static_cast<std::uint32_t>(end[a] - begin[a]);
        return count;
    }
    /// The coordinates of its i-th node in the tile.
    FIRN_HOST_DEVICE Coordinates<d> node(std::uint32_t i) const
    {
        Coordinates<d> at;
        for (unsigned a = d; a-- > 0;) {
            auto const extent = static_cast<std::uint32_t>(end[a] - begin[a]);
            at[a] = static_cast<int>(begin[a] + i % extent);
            i /= extent;
        }
        return at;
    }
};

/// Copies parts of tiles to where they lie one behind the other (`packs`), or back. A group of threads copies
/// one part.
template <class TileShape, class Sums, int d>
__global__ void copy_parts(PartOfTile<d> const* parts, bool packs, Sums* tiles, Sums* packed)
{
    PartOfTile<d> const part = parts[blockIdx.x];
    Sums* const tile = tiles + std::size_t(part.block) * TileShape::nodes;
    for (std::uint32_t i = threadIdx.x, count = part.nodes(); i < count; i += blockDim.x) {
        Sums &in_tile = tile[TileShape::at(part.node(i))], &in_pack = packed[std::size_t(part.first) + i];
        (packs ? in_pack : in_tile) = packs ? in_tile : in_pack;
    }
}

} // namespace firn::cuda::detail
