// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/cells.hpp>

#include <array>
#include <cstdint>
#include <vector>

namespace firn::openmp
{

/// Blocks of nodes under the blocks of cells: born with them, gone with them.
///
/// A block of cells sums into a *tile* of its own: its nodes and `order` more per axis, so that blocks never
/// write to the same place. A node then adds up the tiles that cover it in a fixed order, which makes the
/// sums independent of the number of threads. Node n of the lattice is stored under n + reach: the stencil of
/// cell k begins at node k here.
template <class Number, int d, int order, int sums, int values, int lanes>
class Grid
{
public:
    using Shape = BlockShape<d, lanes>;
    static constexpr int corners = 1 << d;
    static constexpr int reach = stencil_reach(order);
    static constexpr int row_length = Shape::along + order;   ///< nodes in a row of a tile
    static constexpr int rows_across = Shape::across + order; ///< rows of a tile per axis
    static constexpr int rows = d == 3 ? rows_across * rows_across : rows_across;
    static constexpr int tile_channel = rows * row_length;
    static constexpr int block_channel = Shape::cells;
    static_assert(order <= Shape::across && order <= Shape::along,
                  "a stencil may reach into the next block only");
    static_assert(rows <= 64, "the touched rows of a tile are kept as bits");

    static constexpr int absent = BlockMap::absent;

    struct NodeBlock
    {
        Coordinates<d> coordinates;
        std::array<int, corners> covered_by; ///< the cell blocks at coordinates - corner, or absent
    };

    /// Brings blocks up to date with the cells.
    template <class CellOrder>
    void follow(CellOrder const& cells)
    {
        tiles_.resize(cells.blocks().size() * sums * tile_channel);
        touched_.resize(cells.blocks().size());
        if (cells.version() == version_) return;
        version_ = cells.version();
        nodes_.clear();
        nodes_of_.resize(cells.blocks().size());
        map_.clear(cells.blocks().size() * corners);
        for (std::size_t b = 0; b < cells.blocks().size(); ++b)
            for (int corner = 0; corner < corners; ++corner)
                nodes_of_[b][corner] = node_block(cells.blocks()[b].coordinates + offset(corner));
        for (std::size_t b = 0; b < cells.blocks().size(); ++b)
            for (int corner = 0; corner < corners; ++corner)
                nodes_[nodes_of_[b][corner]].covered_by[corner] = int(b);
        values_.resize(nodes_.size() * values * block_channel);
    }

    /// The block corner (0 or 1 per axis, first axis highest).
    static Coordinates<d> offset(int corner)
    {
        Coordinates<d> o;
        for (int a = 0; a < d; ++a) o[a] = (corner >> (d - 1 - a)) & 1;
        return o;
    }

    std::vector<NodeBlock> const& nodes() const { return nodes_; }
    std::array<int, corners> const& nodes_of(std::size_t block) const { return nodes_of_[block]; }
    Number* tile(std::size_t block) { return &tiles_[block * sums * tile_channel]; }
    std::uint64_t& touched(std::size_t block) { return touched_[block]; }
    Number* node_values(std::size_t node_block) { return &values_[node_block * values * block_channel]; }

    std::size_t memory() const
    {
        return tiles_.memory() + values_.memory() + touched_.capacity() * sizeof(std::uint64_t) +
               map_.memory() + nodes_.capacity() * sizeof(NodeBlock) +
               nodes_of_.capacity() * sizeof(nodes_of_[0]);
    }

    /// The rows of a tile that a group's stencils touch.
    static constexpr std::uint64_t rows_of_group(int group)
    {
        std::uint64_t touched = 0;
        for (int i = 0; i < stencil_rows; ++i) touched |= std::uint64_t{1} << tile_row(group, i);
        return touched;
    }

    /// The tile's row under the i-th row of the stencils of a group.
    static constexpr int tile_row(int group, int i)
    {
        int const row = group / Shape::groups_per_row;
        if constexpr (d == 2)
            return row + i;
        else
            return (row / Shape::across + i / (order + 1)) * rows_across + row % Shape::across +
                   i % (order + 1);
    }

    static constexpr int stencil_rows = d == 3 ? (order + 1) * (order + 1) : order + 1;

private:
    int node_block(Coordinates<d> const& coordinates)
    {
        auto const key = block_key<d>(coordinates);
        int index = map_.find(key);
        if (index != absent) return index;
        index = static_cast<int>(nodes_.size());
        NodeBlock block{coordinates, {}};
        block.covered_by.fill(absent);
        nodes_.push_back(block);
        map_.insert(key, index);
        return index;
    }

    std::uint64_t version_ = 0;
    std::vector<NodeBlock> nodes_;
    std::vector<std::array<int, corners>> nodes_of_; ///< per cell block: the node blocks at + corner
    BlockMap map_;
    Array<Number> tiles_;  ///< per cell block: [channel][row][place]
    Array<Number> values_; ///< per node block: [channel][row][place]
    std::vector<std::uint64_t> touched_;
};

} // namespace firn::openmp
