// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_set.hpp>
#include <firn/cuda/tuning.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// What devices swap that share a grid: parts of tiles, one behind the other, and where they are.
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

/// The blocks of cells above blocks of nodes, layer by layer.
template <int layers>
struct BlocksAbove
{
    std::uint32_t const* covered_by[layers]; ///< per block of nodes and corner, or absent
    std::uint32_t const* owners[layers];     ///< which device has a block of cells
};

/// A block of nodes at a border between devices, and the blocks of cells above it, or absent.
template <int layers, int corners>
struct BorderBlock
{
    std::uint32_t node_block;
    std::uint32_t above[layers * corners];
};

/// What a block of nodes is to a device, by bits; 0 if none of its cells is above it.
namespace kind_of_nodes
{
inline constexpr unsigned char own = 1, ///< results are those of the device that has the first block above
    others = 2,                         ///< another device has the results
    at_border = 4;                      ///< cells of other devices are above it, too
} // namespace kind_of_nodes

/// The blocks of nodes that a device updates, in any order.
struct ListsOfNodes
{
    std::uint32_t* counts; ///< of each list, and of those at borders
    std::uint32_t *inside, *own_at_borders, *of_others;
};

/// Finds what each block of nodes is to the device `rank`, and lists them; those at its borders once more.
template <int layers, int corners>
__global__ void find_borders(BlocksAbove<layers> of, std::uint32_t blocks, std::uint32_t rank,
                             unsigned char* kinds, ListsOfNodes lists, BorderBlock<layers, corners>* borders)
{
    std::uint32_t const n = blockIdx.x * blockDim.x + threadIdx.x;
    if (n >= blocks) return;
    BorderBlock<layers, corners> here{n, {}};
    std::uint32_t first = absent;
    bool is_mine = false, is_shared = false;
    for (int i = 0; i < layers * corners; ++i) {
        std::uint32_t const block = of.covered_by[i / corners][n * corners + i % corners];
        here.above[i] = block;
        if (block == absent) continue;
        std::uint32_t const owner = of.owners[i / corners][block];
        if (first == absent) first = owner;
        is_mine = is_mine || owner == rank;
        is_shared = is_shared || owner != first;
    }
    unsigned char kind = 0;
    if (is_mine) kind = first == rank ? kind_of_nodes::own : kind_of_nodes::others;
    if (is_mine && is_shared) {
        kind |= kind_of_nodes::at_border;
        borders[atomicAdd(lists.counts + 3, 1u)] = here;
        if (first == rank)
            lists.own_at_borders[atomicAdd(lists.counts + 1, 1u)] = n;
        else
            lists.of_others[atomicAdd(lists.counts + 2, 1u)] = n;
    }
    else if (is_mine)
        lists.inside[atomicAdd(lists.counts, 1u)] = n;
    kinds[n] = kind;
}

} // namespace firn::cuda::detail
