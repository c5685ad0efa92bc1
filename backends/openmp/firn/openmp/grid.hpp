// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/cells.hpp>

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>
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

    template <class Backend>
    explicit Grid(Backend const&)
    {}

    struct NodeBlock
    {
        Coordinates<d> coordinates;
        std::array<int, corners> covered_by; ///< the cell blocks at coordinates - corner, or absent
    };

    /// Brings blocks up to date with the cells; a block that was there before keeps its sums.
    template <class CellOrder>
    void follow(CellOrder const& cells)
    {
        bool const missed_none = cells.generation() <= generation_ + 1;
        generation_ = cells.generation();
        if (cells.version() == version_) return;
        version_ = cells.version();
        follow_tiles(cells, missed_none);
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
    /// The tile of a block with the sums of this step, and the one that is being filled for the next step.
    Number* tile(std::size_t block) { return tile_in(tiles_[0], block); }
    Number* next_tile(std::size_t block) { return tile_in(tiles_[1], block); }
    /// One bit for each row of the block's tile that holds sums; the others are not to be read.
    std::uint64_t& touched(std::size_t block) { return touched_[0][tile_of_[block]]; }
    std::uint64_t& next_touched(std::size_t block) { return touched_[1][tile_of_[block]]; }
    Number* node_values(std::size_t node_block) { return &values_[node_block * values * block_channel]; }
    Number const* node_values(std::size_t node_block) const
    {
        return &values_[node_block * values * block_channel];
    }

    /// Takes the sums for the next step for those of this one.
    void accept()
    {
        std::swap(tiles_[0], tiles_[1]);
        std::swap(touched_[0], touched_[1]);
    }

    std::size_t memory() const
    {
        return tiles_[0].memory() + tiles_[1].memory() + values_.memory() +
               (touched_[0].capacity() + touched_[1].capacity()) * sizeof(std::uint64_t) +
               tile_of_.capacity() * sizeof(std::size_t) + map_.memory() +
               nodes_.capacity() * sizeof(NodeBlock) + nodes_of_.capacity() * sizeof(nodes_of_[0]);
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
            return row + stencil_row(i);
        else
            return row / Shape::across * rows_across + row % Shape::across + stencil_row(i);
    }

    /// How many rows of a tile the i-th row of a stencil lies behind its first.
    static constexpr int stencil_row(int i)
    {
        return d == 2 ? i : i / (order + 1) * rows_across + i % (order + 1);
    }

    static constexpr int stencil_rows = d == 3 ? (order + 1) * (order + 1) : order + 1;

private:
    /// Finds each block its tile: the one it had, or one that is free.
    template <class CellOrder>
    void follow_tiles(CellOrder const& cells, bool have_history)
    {
        std::size_t const blocks = cells.blocks().size();
        std::vector<std::size_t> next(blocks, blocks);
        auto& touched = touched_[0];
        std::vector<char> taken(std::max(blocks, touched.size()), 0);
        for (std::size_t b = 0; b < blocks; ++b)
            if (int const old = cells.old_block(b); have_history && old != absent)
                taken[next[b] = tile_of_[static_cast<std::size_t>(old)]] = 1;
        std::size_t free = 0, count = 0;
        touched.resize(taken.size(), 0);
        for (std::size_t b = 0; b < blocks; ++b) {
            bool const is_new = !have_history || cells.old_block(b) == absent;
            if (is_new) {
                while (taken[free]) ++free;
                touched[free] = 0;
                next[b] = free++;
            }
            count = std::max(count, next[b] + 1);
        }
        tile_of_ = std::move(next);
        for (auto& rows : touched_) rows.resize(count);
        for (auto& tiles : tiles_) tiles.resize(count * sums * tile_channel);
    }

    Number* tile_in(Array<Number>& tiles, std::size_t block)
    {
        return &tiles[tile_of_[block] * sums * tile_channel];
    }

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

    std::uint64_t version_ = 0, generation_ = 0;
    std::vector<NodeBlock> nodes_;
    std::vector<std::array<int, corners>> nodes_of_; ///< per cell block: the node blocks at + corner
    BlockMap map_;
    std::vector<std::size_t> tile_of_;   ///< per cell block
    std::array<Array<Number>, 2> tiles_; ///< [channel][row][place] of each: of this step and of the next
    Array<Number> values_;               ///< per node block: [channel][row][place]
    std::array<std::vector<std::uint64_t>, 2> touched_; ///< per tile
};

} // namespace firn::openmp
