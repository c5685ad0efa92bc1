// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cells.hpp>
#include <firn/cuda/results.hpp>

#include <array>
#include <utility>

namespace firn::cuda
{

namespace detail
{
/// Wants the blocks of nodes under some blocks of cells.
template <int d>
__global__ void want_nodes(std::uint64_t const* cell_keys, std::uint32_t first, std::uint32_t blocks,
                           BlockSet::View nodes)
{
    std::uint32_t const b = first + (blockIdx.x * blockDim.x + threadIdx.x) / (1u << d);
    if (b >= blocks) return;
    Coordinates<d> block = block_of_key<d>(cell_keys[b]);
    for (int a = 0; a < d; ++a) block[a] += static_cast<int>(threadIdx.x >> (d - 1 - a) & 1);
    nodes.want(block_key<d>(block));
}

/// Ties some blocks of cells to the blocks of nodes under them.
template <int d>
__global__ void tie(std::uint64_t const* cell_keys, std::uint32_t first, std::uint32_t blocks,
                    BlockSet::View nodes, std::uint32_t* nodes_of, std::uint32_t* covered_by)
{
    constexpr std::uint32_t corners = 1u << d;
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x, b = first + i / corners,
                        corner = i % corners;
    if (b >= blocks) return;
    Coordinates<d> block = block_of_key<d>(cell_keys[b]);
    for (int a = 0; a < d; ++a) block[a] += static_cast<int>(corner >> (d - 1 - a) & 1);
    std::uint32_t const n = nodes.find(block_key<d>(block));
    nodes_of[b * corners + corner] = n;
    covered_by[n * corners + corner] = b;
}

/// Copies tiles to new places; a block that had none gets zeros.
template <class Sums>
__global__ void keep_tiles(std::uint32_t const* blocks_before, std::uint32_t known, int nodes,
                           Sums const* from, Sums* to)
{
    std::uint32_t const before = blocks_before[blockIdx.x];
    for (int n = static_cast<int>(threadIdx.x); n < nodes; n += static_cast<int>(blockDim.x))
        to[std::size_t(blockIdx.x) * nodes + n] =
            before < known ? from[std::size_t(before) * nodes + n] : Sums{};
}
} // namespace detail

/// Blocks of nodes under the blocks of cells: born with them.
///
/// A block of cells sums into a *tile* of its own: its nodes and `order` more per axis, so that blocks never
/// write to the same place. A node then adds up the tiles that cover it in a fixed order: no atomics, and no
/// result that depends on how a device schedules its work. Node n of the lattice is stored under n + reach:
/// the stencil of cell k begins at node k here.
template <class NumberType, int d, int order, int sums, int values>
class Grid
{
public:
    using Number = NumberType;
    using Shape = BlockShape<d>;
    using TileShape = Tile<d, order>;
    using Sums = Channels<Number, sums>;
    using Values = Channels<Number, values>;
    static constexpr int corners = 1 << d;
    static constexpr int reach = stencil_reach(order);
    static_assert(order <= Shape::extent, "a stencil may reach into the next block only");

    /// The grid as loops see it.
    struct View
    {
        std::uint64_t const* keys;     ///< of blocks of nodes
        std::uint32_t const* nodes_of; ///< per block of cells and corner: the block of nodes there
        std::uint32_t const*
            covered_by; ///< per block of nodes and corner: the block of cells at - corner, or absent
        Sums *tiles, *next_tiles; ///< per block of cells: of this step, and of the next one
        Values* node_values;      ///< per block of nodes
    };

    template <class Backend>
    explicit Grid(Backend const& backend)
        : queue_(backend.queue()), set_(queue_), nodes_of_(queue_),
          covered_by_(queue_), tiles_{Array<Sums>(queue_), Array<Sums>(queue_)}, values_(queue_),
          node_results_(queue_), item_results_(queue_)
    {}

    /// Brings blocks up to date with the cells; a block that was there before keeps its sums.
    template <class CellOrder>
    void follow(CellOrder const& cells)
    {
        OnDevice const here(queue_);
        if (cells.generation() != generation_) {
            generation_ = cells.generation();
            keep_tiles(cells.blocks_before(), cells.blocks());
        }
        std::uint32_t const before = blocks_, blocks = cells.blocks();
        if (before == blocks) return;
        unsigned const threads = 128, groups = groups_of(std::size_t(blocks - before) * corners, threads);
        if (before == 0 && tiles_[0].size() == 0) set_.reserve(2 * std::size_t(blocks) + 64);
        for (;;) {
            detail::want_nodes<d>
                <<<groups, threads, 0, queue_.stream>>>(cells.view().keys, before, blocks, set_.view());
            check_launch("want_nodes");
            std::uint32_t const births = set_.births();
            if (set_.has_room_for(births)) {
                set_.number(births);
                break;
            }
            set_.reserve(set_.size() + std::max<std::size_t>(2 * births, set_.size() / 8));
        }
        nodes_of_.resize(std::size_t(blocks) * corners);
        std::size_t const covered_before = before == 0 ? 0 : covered_by_.size();
        covered_by_.resize(std::size_t(set_.size()) * corners);
        covered_by_.fill_bytes(covered_before, covered_by_.size() - covered_before, 0xff);
        detail::tie<d><<<groups, threads, 0, queue_.stream>>>(cells.view().keys, before, blocks, set_.view(),
                                                              nodes_of_.data(), covered_by_.data());
        check_launch("tie");
        std::size_t const tiles_before = std::min(tiles_[0].size(), std::size_t(blocks) * TileShape::nodes),
                          tiles = std::size_t(blocks) * TileShape::nodes;
        tiles_[0].resize(tiles);
        tiles_[0].fill_bytes(tiles_before, tiles - tiles_before, 0);
        tiles_[1].renew(tiles);
        values_.renew(std::size_t(set_.size()) * Shape::cells);
        blocks_ = blocks;
    }

    Queue const& queue() const { return queue_; }
    std::uint32_t blocks() const { return blocks_; } ///< of cells
    std::uint32_t node_blocks() const { return set_.size(); }
    View view() const
    {
        return {set_.keys(),
                nodes_of_.data(),
                covered_by_.data(),
                const_cast<Sums*>(tiles_[0].data()),
                const_cast<Sums*>(tiles_[1].data()),
                const_cast<Values*>(values_.data())};
    }
    Results& node_results() { return node_results_; }
    Results& item_results() { return item_results_; }

    /// Takes the sums for the next step for those of this one.
    void accept() { std::swap(tiles_[0], tiles_[1]); }

    std::size_t memory() const
    {
        return set_.memory() + nodes_of_.memory() + covered_by_.memory() + tiles_[0].memory() +
               tiles_[1].memory() + values_.memory() + node_results_.memory() + item_results_.memory();
    }

private:
    /// Moves the tiles of blocks that were there before to their new places; all else begins anew.
    void keep_tiles(std::uint32_t const* blocks_before, std::uint32_t blocks)
    {
        tiles_[1].renew(std::size_t(blocks) * TileShape::nodes);
        detail::keep_tiles<<<blocks, 64, 0, queue_.stream>>>(blocks_before, blocks_, TileShape::nodes,
                                                             tiles_[0].data(), tiles_[1].data());
        check_launch("keep_tiles");
        std::swap(tiles_[0], tiles_[1]);
        set_.clear();
        set_.reserve(2 * std::size_t(blocks) + 64);
        blocks_ = 0;
    }

    Queue queue_;
    std::uint32_t blocks_ = 0, generation_ = 0;
    BlockSet set_;
    Array<std::uint32_t> nodes_of_, covered_by_;
    std::array<Array<Sums>, 2> tiles_;
    Array<Values> values_;
    Results node_results_, item_results_;
};

} // namespace firn::cuda
