// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>

#include <cstdint>

namespace firn::cuda
{

/// Whether half of the loops of steps are compiled: one for any number of teams, and none that ends a step
/// while it rebins items. Then FIRN_COMPILE_SOON is defined, in all units of a program or in none. Results
/// have the same bits, and small scenes take longer.
#if defined(FIRN_COMPILE_SOON) && !defined(FIRN_ON_PROCESSOR)
inline constexpr bool compiled_soon = true;
#else
inline constexpr bool compiled_soon = false;
#endif

/// The shape of a block of cells, or of nodes: 4 x 4 x 4, or 8 x 8 in two dimensions. A warp that
/// scatters works on one of its two groups of 32 cells, lane l on the l-th.
template <int d>
struct BlockShape
{
    static constexpr int bits = d == 3 ? 2 : 3; ///< of the coordinates within a block
    static constexpr int extent = 1 << bits;    ///< cells along each axis
    static constexpr int cells = 64, lanes = 32, groups = 2;
    static constexpr int group_extent = extent / groups; ///< cells of a group along the first axis

    /// The cell's coordinates in its block.
    ///
    /// In three dimensions eight neighbouring lanes are 2 x 1 x 4 cells: their nodes, 16 bytes each, lie in
    /// different banks of the shared memory (see Tile).
    FIRN_HOST_DEVICE static Coordinates<d> cell(int place)
    {
        if constexpr (d == 3)
            return {((place >> 5) << 1) | ((place >> 2) & 1), (place >> 3) & 3, place & 3};
        else
            return {place >> 3, place & 7};
    }

    FIRN_HOST_DEVICE static int place(Coordinates<d> const& cell)
    {
        if constexpr (d == 3)
            return ((cell[0] >> 1) << 5) | (cell[1] << 3) | ((cell[0] & 1) << 2) | cell[2];
        else
            return (cell[0] << 3) | cell[1];
    }
};

/// The nodes under a block of cells, as they lie in memory: its own and `degree` more per axis.
template <int d, int degree>
struct Tile
{
    using Shape = BlockShape<d>;
    static constexpr int width = Shape::extent + degree; ///< nodes per axis
    /// The stride from one plane (in two dimensions: row) to the next. In three dimensions it is 4 nodes more
    /// than a multiple of 8, so that lanes of both planes read from different banks.
    static constexpr int plane = d == 3 ? (width * width + 3) / 8 * 8 + 4 : width;
    static constexpr int nodes = width * plane;
    static constexpr int group_planes = Shape::group_extent + degree;
    static constexpr int group_nodes = group_planes * plane; ///< under one group of cells
    static constexpr int group_offset =
        Shape::group_extent * plane; ///< where those of the second group begin

    FIRN_HOST_DEVICE static int at(Coordinates<d> const& node)
    {
        if constexpr (d == 3)
            return node[0] * plane + node[1] * width + node[2];
        else
            return node[0] * plane + node[1];
    }

    /// Where the node at place k of a stencil's row lies, relative to the stencil's first node.
    FIRN_HOST_DEVICE static constexpr int in_stencil(int row, int k)
    {
        return d == 2 ? row * plane + k : row / (degree + 1) * plane + row % (degree + 1) * width + k;
    }

    /// The same for a layer of the stencil across the first axis, relative to its first node.
    FIRN_HOST_DEVICE static constexpr int in_layer(int row, int k) { return row * width + k; }

    /// Whether a stencil has a node at place k of a row.
    FIRN_HOST_DEVICE static constexpr bool has(int row, int k)
    {
        return row >= 0 && row < (d == 2 ? degree + 1 : (degree + 1) * (degree + 1)) && k >= 0 && k <= degree;
    }

    /// The node at a place; false if there is none, since planes are padded.
    FIRN_HOST_DEVICE static bool node_at(int place, Coordinates<d>& node)
    {
        node[0] = place / plane;
        if constexpr (d == 3) {
            node[1] = place % plane / width;
            node[2] = place % plane % width;
        }
        else
            node[1] = place % plane;
        return node[1] < width;
    }
};

/// The channels of one node, loaded and stored at once.
template <class Number, int count>
struct alignas(sizeof(Number) * (count <= 2 ? count : 4) <= 16 ? sizeof(Number) * (count <= 2 ? count : 4)
                                                               : 16) Channels
{
    static constexpr int stored = count <= 2 ? count : (count + 3) / 4 * 4;
    Number of[stored];
};

} // namespace firn::cuda
