// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_set.hpp>
#include <firn/cuda/scan.hpp>
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

    /// The part in the block of nodes that lies `corner` behind the tile's block, of a tile that is so wide.
    template <int extent, int width>
    FIRN_HOST_DEVICE static PartOfTile at_corner(std::uint32_t of, int corner)
    {
        PartOfTile part{of, 0, {}, {}};
        for (unsigned a = 0; a < d; ++a) {
            bool const is_behind = ((static_cast<unsigned>(corner) >> (d - 1 - a)) & 1) != 0;
            part.begin[a] = is_behind ? extent : 0;
            part.end[a] = is_behind ? width : extent;
        }
        return part;
    }
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

inline constexpr unsigned bordering_threads = 128;

/// Finds what each block of nodes is to the device `rank`, and lists them; counts those at its borders for
/// each group of threads.
template <int layers, int corners>
__global__ void __launch_bounds__(bordering_threads)
    find_borders(BlocksAbove<layers> of, std::uint32_t blocks, std::uint32_t rank, unsigned char* kinds,
                 ListsOfNodes lists, std::uint32_t* of_groups)
{
    std::uint32_t const n = blockIdx.x * bordering_threads + threadIdx.x;
    std::uint32_t first = absent;
    bool is_mine = false, is_shared = false;
    for (int i = 0; n < blocks && i < layers * corners; ++i) {
        std::uint32_t const block = of.covered_by[i / corners][n * corners + i % corners];
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
        if (first == rank)
            lists.own_at_borders[atomicAdd(lists.counts + 1, 1u)] = n;
        else
            lists.of_others[atomicAdd(lists.counts + 2, 1u)] = n;
    }
    else if (is_mine)
        lists.inside[atomicAdd(lists.counts, 1u)] = n;
    if (n < blocks) kinds[n] = kind;
    std::uint64_t at_borders;
    sum_before_in_block<bordering_threads>(is_mine && is_shared, at_borders);
    if (threadIdx.x == 0) of_groups[blockIdx.x] = static_cast<std::uint32_t>(at_borders);
}

/// Lists the blocks of nodes at borders in their order, by as many groups of threads, and counts them.
static __global__ void __launch_bounds__(bordering_threads)
    list_borders(unsigned char const* kinds, std::uint32_t blocks, std::uint32_t const* of_groups,
                 std::uint32_t* borders, std::uint32_t* count)
{
    std::uint32_t const n = blockIdx.x * bordering_threads + threadIdx.x;
    std::uint64_t mine = 0, before, here;
    for (std::uint32_t group = threadIdx.x; group < blockIdx.x; group += bordering_threads)
        mine += of_groups[group];
    sum_before_in_block<bordering_threads>(mine, before);
    bool const is_border = n < blocks && (kinds[n] & kind_of_nodes::at_border) != 0;
    std::uint64_t const at = before + sum_before_in_block<bordering_threads>(is_border, here);
    if (is_border) borders[at] = n;
    if (threadIdx.x == 0 && blockIdx.x + 1 == gridDim.x) *count = static_cast<std::uint32_t>(before + here);
}

/// The blocks of nodes at borders are listed in so many chunks, each by a group of threads.
inline constexpr unsigned chunks_of_borders = 32;

/// How many parts of tiles of a layer a device swaps with another one, and of how many nodes, for the blocks
/// of nodes of a chunk.
struct CountsOfParts
{
    std::uint32_t sent, came, nodes_sent, nodes_came;
};

/// Where these parts are listed: those of a layer one device's behind the other's, each in the order of
/// blocks of nodes. Both sides list the same.
template <int d, int layers>
struct ListsOfParts
{
    CountsOfParts* counts; ///< per layer, device and chunk
    PartOfTile<d>*sent[layers], *came[layers];
    std::uint32_t room_sent[layers], room_came[layers]; ///< what is beyond is not listed
    bool counts_only;
};

/// Counts or lists the parts of tiles that the device `rank` swaps: above each block of nodes at a border,
/// each device sends its own to all others. A group of threads does so for a layer, another device and a
/// chunk of these blocks. They are counted before they are listed.
template <int d, int layers, int corners, int extent, int width>
__global__ void __launch_bounds__(bordering_threads)
    list_parts(BlocksAbove<layers> of, std::uint32_t const* borders, std::uint32_t const* border_count,
               std::uint32_t rank, std::uint32_t devices, ListsOfParts<d, layers> lists)
{
    using Part = PartOfTile<d>;
    std::uint32_t const chunk = blockIdx.x % chunks_of_borders,
                        other = blockIdx.x / chunks_of_borders % devices,
                        layer = blockIdx.x / chunks_of_borders / devices, count = *border_count,
                        each = (count + chunks_of_borders - 1) / chunks_of_borders, begin = chunk * each,
                        end = begin + each < count ? begin + each : count;
    CountsOfParts* const of_chunks = lists.counts + layer * devices * chunks_of_borders;
    std::uint32_t const own_chunk = other * chunks_of_borders + chunk;
    auto const pair = [](std::uint32_t sent, std::uint32_t came) { return std::uint64_t{came} << 32 | sent; };
    std::uint64_t parts = 0, nodes = 0; // both counts in one number, those that are sent in the lower half
    if (!lists.counts_only) {
        std::uint64_t mine_of_parts = 0, mine_of_nodes = 0;
        for (std::uint32_t i = threadIdx.x; i < own_chunk; i += bordering_threads) {
            CountsOfParts const before = of_chunks[i];
            mine_of_parts += pair(before.sent, before.came);
            mine_of_nodes += pair(before.nodes_sent, before.nodes_came);
        }
        sum_before_in_block<bordering_threads>(mine_of_parts, parts);
        sum_before_in_block<bordering_threads>(mine_of_nodes, nodes);
    }
    for (std::uint32_t first = begin; first < end && other != rank; first += bordering_threads) {
        std::uint32_t const i = first + threadIdx.x;
        std::uint32_t own = 0, theirs = 0; // corners above which there are cells of the layer
        bool is_above = false;             // whether cells of the other one are
        std::uint32_t const node_block = i < end ? borders[i] : 0;
        for (int k = 0; i < end && k < layers * corners; ++k) {
            std::uint32_t const block = of.covered_by[k / corners][node_block * corners + k % corners];
            if (block == absent) continue;
            std::uint32_t const owner = of.owners[k / corners][block];
            is_above = is_above || owner == other;
            if (k / corners != int(layer)) continue;
            if (owner == other) theirs |= 1u << (k % corners);
            if (owner == rank) own |= 1u << (k % corners);
        }
        if (!is_above) own = 0;
        std::uint32_t nodes_sent = 0, nodes_came = 0;
        for (int corner = 0; corner < corners; ++corner) {
            std::uint32_t const of_part = Part::template at_corner<extent, width>(0, corner).nodes();
            nodes_sent += (own >> corner & 1) * of_part;
            nodes_came += (theirs >> corner & 1) * of_part;
        }
        std::uint64_t all_parts, all_nodes;
        std::uint64_t const at = parts + sum_before_in_block<bordering_threads>(
                                             pair(static_cast<std::uint32_t>(__popc(own)),
                                                  static_cast<std::uint32_t>(__popc(theirs))),
                                             all_parts),
                            at_node = nodes + sum_before_in_block<bordering_threads>(
                                                  pair(nodes_sent, nodes_came), all_nodes);
        parts += all_parts;
        nodes += all_nodes;
        if (lists.counts_only) continue;
        auto const list = [&](std::uint32_t which, std::uint64_t place, std::uint64_t node, Part* to,
                              std::uint32_t room) {
            auto part_at = static_cast<std::uint32_t>(place), next = static_cast<std::uint32_t>(node);
            for (int corner = 0; corner < corners; ++corner) {
                if ((which >> corner & 1) == 0) continue;
                Part part = Part::template at_corner<extent, width>(
                    of.covered_by[layer][node_block * corners + std::uint32_t(corner)], corner);
                part.first = next;
                next += part.nodes();
                if (part_at < room) to[part_at] = part;
                ++part_at;
            }
        };
        list(own, at, at_node, lists.sent[layer], lists.room_sent[layer]);
        list(theirs, at >> 32, at_node >> 32, lists.came[layer], lists.room_came[layer]);
    }
    if (lists.counts_only && threadIdx.x == 0)
        of_chunks[own_chunk] = {static_cast<std::uint32_t>(parts), static_cast<std::uint32_t>(parts >> 32),
                                static_cast<std::uint32_t>(nodes), static_cast<std::uint32_t>(nodes >> 32)};
}

} // namespace firn::cuda::detail
