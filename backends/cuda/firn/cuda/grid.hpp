// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/readback.hpp>

#include <array>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn::cuda
{

namespace detail
{
/// Requests the blocks of nodes under some blocks of cells.
template <int d>
__global__ void want_nodes(std::uint64_t const* cell_keys, std::uint32_t first, std::uint32_t blocks,
                           BlockSet::View nodes, Periods<d> periods)
{
    std::uint32_t const b = first + (blockIdx.x * blockDim.x + threadIdx.x) / (1u << d);
    if (b >= blocks) return;
    Coordinates<d> block = block_of_key<d>(cell_keys[b]);
    for (int a = 0; a < d; ++a) block[a] += static_cast<int>(threadIdx.x >> (d - 1 - a) & 1);
    nodes.want(block_key<d>(periods.wrapped(block)));
}

/// Connects some blocks of cells to the blocks of nodes under them.
template <int d>
__global__ void tie(std::uint64_t const* cell_keys, std::uint32_t first, std::uint32_t blocks,
                    BlockSet::View nodes, Periods<d> periods, std::uint32_t* nodes_of,
                    std::uint32_t* covered_by)
{
    constexpr std::uint32_t corners = 1u << d;
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x, b = first + i / corners,
                        corner = i % corners;
    if (b >= blocks) return;
    Coordinates<d> block = block_of_key<d>(cell_keys[b]);
    for (int a = 0; a < d; ++a) block[a] += static_cast<int>(corner >> (d - 1 - a) & 1);
    std::uint32_t const n = nodes.find(block_key<d>(periods.wrapped(block)));
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

/// The types and sizes of what a grid is made of.
///
/// A block of cells sums into a *tile* of its own: its nodes and `degree` more per axis, so that blocks never
/// write to the same place. Node n of the lattice is stored under n + reach: the stencil of cell k begins at
/// node k here.
template <class NumberType, int d, int degree, int sums, int values>
struct GridShape
{
    using Number = NumberType;
    using Shape = BlockShape<d>;
    using TileShape = Tile<d, degree>;
    using Sums = Channels<Number, sums>;
    using Values = Channels<Number, values>;
    static constexpr int corners = 1 << d;
    static constexpr int reach = stencil_reach(degree);
    static_assert(degree <= Shape::extent, "a stencil may reach into the next block only");
};

/// Blocks of nodes under the blocks of cells, created with them.
///
/// Several orders of cells may share the nodes. Each has a *layer* of the grid: the tiles that its blocks sum
/// into. A node adds up the tiles that cover it in a fixed order, layer by layer: no atomics, and no result
/// that depends on how a device schedules its work. All layers share the nodes' values, or each has its own.
template <class NumberType, int d, int degree, int sums, int values, int layer_count = 1,
          bool own_values = false, int ungathered_count = 0>
class Grid : public GridShape<NumberType, d, degree, sums, values>
{
    using Base = GridShape<NumberType, d, degree, sums, values>;

public:
    using Base::corners;
    using typename Base::Number, typename Base::Shape, typename Base::TileShape, typename Base::Sums,
        typename Base::Values;
    static constexpr int layers = layer_count;
    static constexpr int values_count = values;
    static constexpr int ungathered = ungathered_count; ///< values of a node beside those that items gather

    /// The tiles over a block of nodes, as loops see them.
    struct Cover
    {
        std::uint32_t const*
            covered_by; ///< per block of nodes and corner: the block of cells at - corner, or absent
        Sums const* tiles;
    };
    /// Those values of all nodes that items do not gather, channel by channel: beside the others they would
    /// fill the shared memory of loops that gather.
    struct Ungathered
    {
        Number* ungathered;
    };
    struct NothingUngathered
    {};
    /// The nodes as loops see them.
    struct View : std::conditional_t<(ungathered > 0), Ungathered, NothingUngathered>
    {
        std::uint64_t const* keys; ///< of blocks of nodes
        Cover layer[layers];
        Values* node_values; ///< per block of nodes
        std::size_t count;   ///< of nodes
        Periods<d> periods;  ///< of blocks

        /// Whether a loop updates this block of nodes. Where several devices share a grid, each has its part.
        __device__ static constexpr bool shows(std::uint32_t) { return true; }
        /// The block of nodes that a group of threads updates.
        __device__ static constexpr std::uint32_t block(std::uint32_t group) { return group; }

        FIRN_HOST_DEVICE Values* values_of(std::size_t layer_number) const
        {
            return node_values + (own_values ? layer_number * count : 0);
        }
        /// A value of node i of all.
        FIRN_HOST_DEVICE Number& value(std::size_t i, int channel) const
        {
            if constexpr (ungathered > 0)
                if (channel >= values) return this->ungathered[std::size_t(channel - values) * count + i];
            return node_values[i].of[channel];
        }
    };

private:
    /// The tiles of one order of cells.
    struct Tiles
    {
        std::uint32_t blocks = 0, generation = 0;
        Array<std::uint32_t> nodes_of, covered_by;
        std::array<Array<Sums>, 2> of;
        Results item_results;

        explicit Tiles(Queue const& queue)
            : nodes_of(queue), covered_by(queue), of{Array<Sums>(queue), Array<Sums>(queue)},
              item_results(queue)
        {}

        std::size_t memory() const
        {
            return nodes_of.memory() + covered_by.memory() + of[0].memory() + of[1].memory() +
                   item_results.memory();
        }
    };

public:
    /// The grid as one order of cells sees it: all nodes, and its own tiles. A light handle, made when
    /// needed.
    class Layer : public Base
    {
    public:
        /// The layer as loops see it.
        struct View
        {
            std::uint32_t const* nodes_of; ///< per block of cells and corner: the block of nodes there
            Sums *tiles, *next_tiles;      ///< per block of cells: of this step, and of the next one
            Values const* node_values;     ///< per block of nodes
        };

        Layer(Grid& grid, std::size_t number) : grid_(&grid), tiles_(&grid.tiles_[number]), number_(number) {}

        Queue const& queue() const { return grid_->queue(); }
        std::uint32_t blocks() const { return tiles_->blocks; } ///< of cells
        View view() const
        {
            return {tiles_->nodes_of.data(), tiles_->of[0].data(), tiles_->of[1].data(),
                    grid_->view().values_of(number_)};
        }
        Results& item_results() const { return tiles_->item_results; }

    private:
        Grid* grid_;
        Tiles* tiles_;
        std::size_t number_;
    };
    Layer layer(std::size_t of) { return {*this, of}; }

    template <class Backend>
    explicit Grid(Backend const& backend, Periods<d> const& periods = {})
        : Grid(backend.queue(), periods, std::make_index_sequence<static_cast<std::size_t>(layers)>{})
    {}

    /// Updates the blocks to the orders of cells, one per layer; a block that existed before keeps its sums.
    template <class Order>
    void activate(std::array<Order*, layers> const& orders)
    {
        OnDevice const here(queue_);
        forget_empty_blocks(orders);
        bool grows = false;
        for (std::size_t l = 0; l < layers; ++l) grows = grows || tiles_[l].blocks != orders[l]->blocks();
        if (!grows) return;
        ++numbering_;
        if (set_.memory() == 0) set_.reserve(2 * all_blocks(orders) + BlockSet::few);
        for (std::size_t l = 0; l < layers; ++l) find_nodes(tiles_[l], *orders[l]);
        for (std::size_t l = 0; l < layers; ++l) tie(tiles_[l], *orders[l]);
        values_.renew((own_values ? layers : 1) * node_count());
        if constexpr (ungathered > 0) {
            // phases that keep values leave nodes alone to which nothing is added, and items gather from
            // these
            ungathered_.renew(std::size_t(ungathered) * node_count());
            values_.fill_bytes(0, values_.size(), 0);
            ungathered_.fill_bytes(0, ungathered_.size(), 0);
        }
    }

    Queue const& queue() const { return queue_; }
    std::uint32_t node_blocks() const { return set_.size(); }
    View view() const
    {
        View view{{}, set_.keys(), {}, const_cast<Values*>(values_.data()), node_count(), periods_};
        if constexpr (ungathered > 0) view.ungathered = const_cast<Number*>(ungathered_.data());
        for (std::size_t l = 0; l < layers; ++l)
            view.layer[l] = {tiles_[l].covered_by.data(), tiles_[l].of[0].data()};
        return view;
    }
    /// How many groups of threads update nodes.
    std::uint32_t groups() const { return node_blocks(); }
    BlockSet::View blocks_of_nodes() { return set_.view(); }
    Results& node_results() { return node_results_; }

    /// Single nodes that have been updated, by their indices, which hold until the next activate().
    struct Nodes
    {
        static constexpr std::uint32_t absent = cuda::absent;
        View grid;
        BlockSet::View blocks;

        __device__ std::uint32_t find(Coordinates<d> const& node) const
        {
            Coordinates<d> block;
            std::uint32_t place = 0;
            for (int a = 0; a < d; ++a) {
                int const at = node[a] + Base::reach;
                block[a] = at >> Shape::bits;
                place = place * Shape::extent + static_cast<unsigned>(at & (Shape::extent - 1));
            }
            std::uint32_t const n = blocks.find(block_key<d>(grid.periods.wrapped(block)));
            return n == absent ? absent : n * Shape::cells + place;
        }
        /// The same, if the index of the node before it along the last axis is known.
        __device__ std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t before) const
        {
            if (((node[d - 1] + Base::reach) & (Shape::extent - 1)) == 0) return find(node);
            return before == absent ? absent : before + 1; // in the same block
        }
        __device__ Number sum(std::uint32_t index, int channel) const
        {
            Number sum = 0;
            std::uint32_t const n = index / Shape::cells;
            Coordinates<d> here;
            for (int a = d - 1, place = int(index % Shape::cells); a >= 0; --a, place /= Shape::extent)
                here[a] = place % Shape::extent;
            for (int l = 0; l < layers; ++l) {
                std::uint32_t block[corners]; // loaded together: otherwise each would wait for the one before
#pragma unroll
                for (int corner = 0; corner < corners; ++corner)
                    block[corner] = grid.layer[l].covered_by[n * corners + unsigned(corner)];
#pragma unroll
                for (int corner = 0; corner < corners; ++corner) {
                    Coordinates<d> at; // in the tile of a block that lies `corner` before this one
                    bool covers = block[corner] != absent;
#pragma unroll
                    for (int a = 0; a < d; ++a) {
                        at[a] = here[a] + ((corner >> (d - 1 - a)) & 1) * Shape::extent;
                        covers = covers && at[a] < TileShape::width;
                    }
                    if (covers)
                        sum += grid.layer[l]
                                   .tiles[std::size_t(block[corner]) * TileShape::nodes +
                                          static_cast<std::size_t>(TileShape::at(at))]
                                   .of[channel];
                }
            }
            return sum;
        }
        __device__ Number& value(std::uint32_t index, int channel) const
        {
            return grid.value(index, channel);
        }
    };
    Nodes nodes_by_index() { return {view(), set_.view()}; }
    /// How many indices there are.
    std::size_t node_count() const { return std::size_t(set_.size()) * Shape::cells; }
    /// Changes whenever the indices of nodes do.
    std::uint64_t numbering() const { return numbering_; }

    /// Makes the sums of the next step those of this one.
    void swap()
    {
        for (Tiles& tiles : tiles_) std::swap(tiles.of[0], tiles.of[1]);
    }

    std::size_t memory() const
    {
        std::size_t bytes = set_.memory() + values_.memory() + ungathered_.memory() + node_results_.memory();
        for (Tiles const& tiles : tiles_) bytes += tiles.memory();
        return bytes;
    }

private:
    template <std::size_t... l>
    Grid(Queue const& queue, Periods<d> const& periods, std::index_sequence<l...>)
        : queue_(queue), periods_(periods.in_blocks([](int) { return int{Shape::extent}; })),
          set_(queue), tiles_{(static_cast<void>(l), Tiles(queue))...}, values_(queue), ungathered_(queue),
          node_results_(queue)
    {}

    template <class Order>
    static std::size_t all_blocks(std::array<Order*, layers> const& orders)
    {
        std::size_t blocks = 0;
        for (Order const* const cells : orders) blocks += cells->blocks();
        return blocks;
    }

    /// Where blocks of cells were renumbered, keeps their tiles and rebuilds the blocks of nodes.
    template <class Order>
    void forget_empty_blocks(std::array<Order*, layers> const& orders)
    {
        bool any = false;
        for (std::size_t l = 0; l < layers; ++l) {
            if (orders[l]->generation() == tiles_[l].generation) continue;
            tiles_[l].generation = orders[l]->generation();
            keep_tiles(tiles_[l], orders[l]->blocks_before(), orders[l]->blocks_kept());
            any = true;
        }
        if (!any) return;
        set_.clear();
        set_.reserve(2 * all_blocks(orders) + 64);
        for (Tiles& tiles : tiles_) tiles.blocks = 0;
    }

    /// Moves the tiles of blocks that stay to their new places and clears the others.
    void keep_tiles(Tiles& tiles, std::uint32_t const* blocks_before, std::uint32_t blocks)
    {
        tiles.of[1].renew(std::size_t(blocks) * TileShape::nodes);
        launch_after("keep_tiles", queue_, detail::keep_tiles<Sums>, blocks, 64, blocks_before, tiles.blocks,
                     TileShape::nodes, tiles.of[0].data(), tiles.of[1].data());
        std::swap(tiles.of[0], tiles.of[1]);
    }

    static constexpr unsigned threads = 128;

    /// Numbers the blocks of nodes under new blocks of cells.
    template <class Order>
    void find_nodes(Tiles const& tiles, Order const& cells)
    {
        std::uint32_t const before = tiles.blocks, blocks = cells.blocks();
        if (before == blocks) return;
        for (;;) {
            launch_after("want_nodes", queue_, detail::want_nodes<d>,
                         groups_of(std::size_t(blocks - before) * corners, threads), threads,
                         cells.view().keys, before, blocks, set_.view(), periods_);
            std::uint32_t const births = set_.births();
            if (set_.has_room_for(births)) {
                set_.number(births);
                break;
            }
            set_.reserve_more(births);
        }
    }

    /// Connects a layer's new blocks to those of nodes, and makes room for their tiles.
    template <class Order>
    void tie(Tiles& tiles, Order const& cells)
    {
        std::uint32_t const before = tiles.blocks, blocks = cells.blocks();
        std::size_t const covered_before = before == 0 ? 0 : tiles.covered_by.size();
        tiles.covered_by.resize(std::size_t(set_.size()) *
                                corners); // for blocks of nodes of other layers, too
        tiles.covered_by.fill_bytes(covered_before, tiles.covered_by.size() - covered_before, 0xff);
        if (before == blocks) return;
        tiles.nodes_of.resize(std::size_t(blocks) * corners);
        launch_after("tie", queue_, detail::tie<d>,
                     groups_of(std::size_t(blocks - before) * corners, threads), threads, cells.view().keys,
                     before, blocks, set_.view(), periods_, tiles.nodes_of.data(), tiles.covered_by.data());
        std::size_t const count = std::size_t(blocks) * TileShape::nodes,
                          count_before = std::min(tiles.of[0].size(), count);
        // the next sums are not in use, and what is freed of them may be what the current ones need to grow
        if (count * sizeof(Sums) > tiles.of[0].memory()) tiles.of[1].clear();
        tiles.of[0].resize(count);
        tiles.of[0].fill_bytes(count_before, count - count_before, 0);
        tiles.of[1].resize(tiles.of[0].memory() / sizeof(Sums), 0); // as much room for both: they are swapped
        tiles.of[1].resize(count, 0);
        tiles.blocks = blocks;
    }

protected: // for a grid that several devices share
    /// Which blocks of cells of a layer cover each block of nodes, by corner.
    Array<std::uint32_t> const& covered_by(std::size_t layer) const { return tiles_[layer].covered_by; }
    Array<Sums>& tiles(std::size_t layer) { return tiles_[layer].of[0]; }
    /// Makes room for the tiles of so many blocks, and for an eighth more, where tiles have to grow: all
    /// devices wait while one allocates. If activate() is about to make nodes, also for their values.
    void reserve_tiles(std::size_t layer, std::uint32_t blocks, bool with_values)
    {
        Tiles& tiles = tiles_[layer];
        std::size_t const count = std::size_t(blocks) * TileShape::nodes, before = tiles.of[0].size();
        if (before == 0 || count * sizeof(Sums) <= tiles.of[0].memory()) return;
        tiles.of[1].clear(); // as in tie()
        tiles.of[0].resize(count + count / 8);
        tiles.of[0].resize(before);
        tiles.of[1].resize(tiles.of[0].memory() / sizeof(Sums), 0);
        tiles.of[1].resize(before, 0);
        std::size_t const nodes = values_.size(), corners_before = tiles.covered_by.size();
        tiles.covered_by.resize(corners_before + corners_before / 8);
        tiles.covered_by.resize(corners_before);
        if (!with_values) return;
        values_.renew(nodes + nodes / 8);
        values_.renew(nodes);
    }
    /// The keys of all blocks of nodes.
    std::vector<std::uint64_t> keys_of_nodes() const
    {
        std::vector<std::uint64_t> keys(set_.size());
        set_.download_keys(0, keys);
        return keys;
    }

private:
    Queue queue_;
    Periods<d> periods_; ///< of blocks
    BlockSet set_;
    std::uint64_t numbering_ = 0;
    std::array<Tiles, static_cast<std::size_t>(layers)> tiles_;
    Array<Values> values_;
    Array<Number> ungathered_;
    Results node_results_;
};

} // namespace firn::cuda
