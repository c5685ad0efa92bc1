// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/cell_order.hpp>
#include <firn/openmp/image_lists.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace firn::openmp
{

/// The sizes of what a grid is made of.
///
/// A block of cells sums into a *tile* of its own: its nodes and `degree` more per axis, so that blocks never
/// write to the same place. Node n of the lattice is stored under n + reach: the stencil of cell k begins at
/// node k here.
template <int d, int degree, int lanes>
struct GridShape
{
    using Shape = BlockShape<d, lanes>;
    static constexpr int dimension = d;
    static constexpr int corners = 1 << d;
    static constexpr int reach = stencil_reach(degree);
    static constexpr int row_length = Shape::along + degree;   ///< nodes in a row of a tile
    static constexpr int rows_across = Shape::across + degree; ///< rows of a tile per axis
    static constexpr int rows = d == 3 ? rows_across * rows_across : rows_across;
    static constexpr int tile_channel = rows * row_length;
    static constexpr int block_channel = Shape::cells;
    static_assert(degree <= Shape::across && degree <= Shape::along,
                  "a stencil may reach into the next block only");
    static_assert(rows < 64, "the touched rows of a tile are kept as bits");
    /// One bit beside those of the rows: for the ends of all rows, that is, the nodes beyond the block's own.
    static constexpr std::uint64_t ends = std::uint64_t{1} << 63;

    static constexpr int absent = BlockMap::absent;

    /// The block corner (0 or 1 per axis, first axis highest).
    static Coordinates<d> offset(int corner)
    {
        Coordinates<d> o;
        for (int a = 0; a < d; ++a) o[a] = (corner >> (d - 1 - a)) & 1;
        return o;
    }

    /// The coordinates of a node's block, and the node's place in it.
    static std::pair<Coordinates<d>, Coordinates<d>> block_and_place(Coordinates<d> const& node)
    {
        Coordinates<d> block, place;
        for (int a = 0; a < d; ++a) {
            int const extent = Shape::extent(a), at = node[a] + reach;
            place[a] = (at % extent + extent) % extent;
            block[a] = (at - place[a]) / extent;
        }
        return {block, place};
    }

    /// The coordinates of the node at a place in a row of a block.
    static Coordinates<d> node_at(Coordinates<d> const& block, int row, int place)
    {
        auto const node = [&](int axis, int inside) {
            return block[axis] * Shape::extent(axis) + inside - reach;
        };
        if constexpr (d == 3)
            return {node(0, row / Shape::across), node(1, row % Shape::across), node(2, place)};
        else { // combined in a register: loading as a whole what was just stored in parts would stall
            std::array<int, 2> const parts{node(0, row), node(1, place)};
            Coordinates<d> at;
            std::uint64_t const whole = std::bit_cast<std::uint64_t>(parts);
            std::memcpy(at.data(), &whole, sizeof whole);
            return at;
        }
    }

    /// The rows of a tile that a group's stencils touch.
    static constexpr std::uint64_t rows_of_group(int group)
    {
        std::uint64_t touched = 0;
        for (int i = 0; i < stencil_rows; ++i) touched |= std::uint64_t{1} << tile_row(group, i);
        return touched;
    }

    /// The part of a tile that the items in the cells of a group touch: a bit for each row, and `ends`.
    static std::uint64_t touched_by(std::uint32_t const* counts, int group)
    {
        int const first = group % Shape::groups_per_row * lanes;
        std::uint32_t near_end = 0;
        for (int lane = std::max(0, Shape::along - degree - first); lane < lanes; ++lane)
            near_end |= counts[lane];
        return rows_of_group(group) | (near_end != 0 ? ends : 0);
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

    /// Where in a tile the stencil of the cell at `place` in the block begins.
    static constexpr int tile_place(int place)
    {
        return tile_row(place / lanes, 0) * row_length + place % Shape::along;
    }

    /// The distance in rows of a tile from the first row of a stencil to the i-th.
    static constexpr int stencil_row(int i)
    {
        return d == 2 ? i : i / (degree + 1) * rows_across + i % (degree + 1);
    }

    static constexpr int stencil_rows = d == 3 ? (degree + 1) * (degree + 1) : degree + 1;
};

/// Blocks of nodes under the blocks of cells, created and removed with them.
///
/// Several orders of cells may share the nodes. Each has a *layer* of the grid: the tiles that its blocks sum
/// into. A node adds up the tiles that cover it in a fixed order, layer by layer, which makes the sums
/// independent of the number of threads. All layers share the nodes' values, or each has its own.
template <class Number, int d, int degree, int sums, int values, int lanes, int layer_count = 1,
          bool own_values = false>
class Grid : public GridShape<d, degree, lanes>
{
    using Base = GridShape<d, degree, lanes>;

    /// The tiles of one order of cells.
    struct Tiles
    {
        std::uint64_t version = 0, generation = 0;
        Array<std::array<int, Base::corners>> nodes_of; ///< per cell block: the node blocks at + corner
        std::vector<std::size_t> tile_of;               ///< per cell block, and behind them per ghost
        std::size_t own = 0; ///< tiles of blocks that are here; behind them are those of ghosts
        std::vector<Coordinates<d>> ghosts{};
        std::array<Array<Number>, 2> of; ///< [channel][row][place] of each: of this step and of the next
        std::array<std::vector<std::uint64_t>, 2> touched; ///< per tile

        std::size_t memory() const
        {
            return of[0].memory() + of[1].memory() +
                   (touched[0].capacity() + touched[1].capacity()) * sizeof(std::uint64_t) +
                   tile_of.capacity() * sizeof(std::size_t) + nodes_of.memory();
        }
    };

public:
    using Base::absent, Base::corners, Base::offset, Base::tile_channel, Base::block_channel;
    static constexpr int layers = layer_count;
    static constexpr int node_sums = sums; ///< per layer

    template <class Backend>
    explicit Grid(Backend const&, Periods<d> const& periods = {})
        : periods_(periods.in_blocks(Base::Shape::extent))
    {}

    /// A block of nodes with the blocks of cells that add to it.
    struct NodeBlock
    {
        Coordinates<d> coordinates;
        /// per layer: the cell blocks at coordinates - corner, or absent
        std::array<std::array<int, Base::corners>, std::size_t(layers)> covered_by;
    };

    /// The grid as one order of cells sees it: all nodes, and its own tiles. A light handle, made when
    /// needed.
    class Layer : public Base
    {
    public:
        Layer(Grid& grid, std::size_t number)
            : grid_(&grid), tiles_(&grid.tiles_[number]), number_(own_values ? number : 0)
        {}

        std::array<int, Base::corners> const& nodes_of(std::size_t block) const
        {
            return tiles_->nodes_of[block];
        }
        /// The tile of a block with the sums of this step, and the one that is being filled for the next
        /// step.
        Number* tile(std::size_t block) const { return tile_in(tiles_->of[0], block); }
        Number* next_tile(std::size_t block) const { return tile_in(tiles_->of[1], block); }
        /// One bit for each row of the block's tile that holds sums; other rows are undefined and must not be
        /// read. One more bit for the rows' ends: without it these are zero.
        std::uint64_t& touched(std::size_t block) const { return tiles_->touched[0][tiles_->tile_of[block]]; }
        std::uint64_t& next_touched(std::size_t block) const
        {
            return tiles_->touched[1][tiles_->tile_of[block]];
        }
        Number* node_values(std::size_t node_block) const { return grid_->node_values(node_block, number_); }

    private:
        Number* tile_in(Array<Number>& of, std::size_t block) const
        {
            return &of[tiles_->tile_of[block] * sums * Base::tile_channel];
        }

        Grid* grid_;
        Tiles* tiles_;
        std::size_t number_; ///< of its values
    };
    Layer layer(std::size_t of) { return {*this, of}; }

    /// Updates the blocks to the orders of cells, one per layer; a block that existed before keeps its sums.
    template <class Order>
    void activate(std::array<Order*, std::size_t(layers)> const& orders)
    {
        if (assign_tiles(orders)) connect(orders);
    }

    /// Updates the tiles to the orders of cells. Returns whether the blocks have changed, so that connect()
    /// must follow before nodes are updated.
    template <class Order>
    bool assign_tiles(std::array<Order*, std::size_t(layers)> const& orders)
    {
        bool changed = false;
        for (int l = 0; l < layers; ++l) {
            Order const& cells = *orders[std::size_t(l)];
            Tiles& tiles = tiles_[std::size_t(l)];
            bool const missed_none = cells.generation() <= tiles.generation + 1;
            tiles.generation = cells.generation();
            if (cells.version() == tiles.version) continue;
            tiles.version = cells.version();
            activate_tiles(tiles, cells, missed_none);
            changed = true;
        }
        return changed;
    }

    /// Creates the blocks of nodes under those of cells.
    template <class Order>
    void connect(std::array<Order*, std::size_t(layers)> const& orders)
    {
        std::size_t blocks = 0;
        for (int l = 0; l < layers; ++l)
            blocks += orders[std::size_t(l)]->blocks().size() + tiles_[std::size_t(l)].ghosts.size();
        ++numbering_;
        nodes_.clear();
        map_.clear(blocks * corners);
        for (int l = 0; l < layers; ++l)
            for (auto const& block : orders[std::size_t(l)]->blocks()) node_block(block.coordinates);
        centres_ = nodes_.size();
        std::vector<std::uint32_t> owners(nodes_.size());
        std::iota(owners.begin(), owners.end(), 0);
        for (int l = 0; l < layers; ++l) find_nodes(tiles_[std::size_t(l)], *orders[std::size_t(l)], owners);
        for (int l = 0; l < layers; ++l)
            for (std::size_t b = 0; b < tiles_[std::size_t(l)].nodes_of.size(); ++b)
                for (int corner = 0; corner < corners; ++corner)
                    nodes_[std::size_t(tiles_[std::size_t(l)].nodes_of[b][std::size_t(corner)])]
                        .covered_by[std::size_t(l)][std::size_t(corner)] = int(b);
        if (add_ghosts()) find_owners(owners);
        list_by_owner(owners);
        values_.resize((own_values ? std::size_t(layers) : 1) * nodes_.size() * values * block_channel);
    }

    /// Blocks of cells that are elsewhere, and whose tiles nodes add up here, too: see ghost_tile(). Their
    /// sums are those that nodes add up next; connect() must follow.
    void set_ghosts(std::size_t layer, std::vector<Coordinates<d>> at)
    {
        Tiles& tiles = tiles_[layer];
        tiles.ghosts = std::move(at);
        find_room_for_ghosts(tiles);
    }
    std::span<Coordinates<d> const> ghosts(std::size_t layer) const { return tiles_[layer].ghosts; }
    /// The tile of a ghost with the sums of this step, and the rows of it that hold sums.
    Number* ghost_tile(std::size_t layer, std::size_t ghost)
    {
        return &tiles_[layer].of[0][(tiles_[layer].own + ghost) * sums * tile_channel];
    }
    std::uint64_t& ghost_touched(std::size_t layer, std::size_t ghost)
    {
        return tiles_[layer].touched[0][tiles_[layer].own + ghost];
    }

    std::vector<NodeBlock> const& nodes() const { return nodes_; }
    /// Merges the results of all owners, in their order.
    template <class Result>
    Result merged(std::span<Result const> of_owners) const
    {
        Result all{};
        for (Result const& result : of_owners) all.merge(result);
        return all;
    }
    /// Owners of nodes: coordinates at which a layer has a block of cells. With one layer these are its
    /// blocks in their order, so that a thread that works on some blocks, and then on the nodes they own,
    /// finds most of the sums in its own cache.
    int owners() const { return static_cast<int>(owner_begin_.size()) - 1; }
    /// So many of them are blocks of cells that are here; behind them may be ghosts.
    std::size_t owners_here() const { return centres_; }
    /// The blocks of nodes of an owner: the one at its coordinates, and those beside it that have no other
    /// owner.
    std::span<std::uint32_t const> nodes_at(int owner) const
    {
        return std::span(by_owner_).subspan(owner_begin_[std::size_t(owner)],
                                            owner_begin_[std::size_t(owner + 1)] -
                                                owner_begin_[std::size_t(owner)]);
    }
    /// The values of a block of nodes, and of a layer if each has its own.
    Number* node_values(std::size_t node_block, std::size_t layer = 0)
    {
        return &values_[(layer * nodes_.size() + node_block) * values * block_channel];
    }

    /// The index of the block of nodes with these coordinates, or absent.
    int find(Coordinates<d> const& block) const { return map_.find(block_key<d>(periods_.wrapped(block))); }

    /// The sums of one node, wherever it is: those of its row, or zeros.
    void sums_at(Coordinates<d> const& node, Number (&found)[std::size_t(sums)]) const
    {
        std::fill(found, found + sums, Number(0));
        for (std::size_t l = 0; l < std::size_t(layers); ++l) add_sums_at(node, l, found);
    }
    /// Adds the sums of one layer at a node, wherever it is.
    void add_sums_at(Coordinates<d> const& node, std::size_t layer, Number (&found)[std::size_t(sums)]) const
    {
        auto const [block, place] = Base::block_and_place(node);
        int const n = find(block);
        if (n != absent) add_sums(tiles_[layer], nodes_[std::size_t(n)].covered_by[layer], place, found);
    }

    /// Single nodes that have been updated, by their indices, which hold until the next activate().
    class Nodes
    {
    public:
        static constexpr std::uint32_t absent = ~std::uint32_t(0);

        explicit Nodes(Grid& grid) : grid_(&grid) {}
        std::uint32_t find(Coordinates<d> const& node) const
        {
            auto const [block, place] = Base::block_and_place(node);
            int const n = grid_->find(block);
            if (n == Base::absent) return absent;
            int row = 0;
            for (int a = 0; a < d - 1; ++a) row = row * Base::Shape::across + place[a];
            return static_cast<std::uint32_t>(n) * block_channel +
                   static_cast<std::uint32_t>(row * Base::Shape::along + place[d - 1]);
        }
        /// The same, if the index of the node before it along the last axis is known.
        std::uint32_t find_next(Coordinates<d> const& node, std::uint32_t before) const
        {
            if ((node[d - 1] + Base::reach) % Base::Shape::along == 0) return find(node);
            return before == absent ? absent : before + 1; // in the same block
        }
        /// The coordinates of a node.
        Coordinates<d> node(std::uint32_t index) const
        {
            int const inside = static_cast<int>(index % block_channel);
            return Base::node_at(grid_->nodes_[index / block_channel].coordinates,
                                 inside / Base::Shape::along, inside % Base::Shape::along);
        }
        Number sum(std::uint32_t index, int channel) const
        {
            int row = static_cast<int>(index % block_channel) / Base::Shape::along;
            Coordinates<d> place;
            place[d - 1] = static_cast<int>(index) % Base::Shape::along;
            for (int a = d - 2; a >= 0; --a, row /= Base::Shape::across) place[a] = row % Base::Shape::across;
            Number sum = 0;
            for (std::size_t l = 0; l < std::size_t(layers); ++l)
                sum += grid_->sum_of(grid_->tiles_[l], grid_->nodes_[index / block_channel].covered_by[l],
                                     place, channel);
            return sum;
        }
        Number& value(std::uint32_t index, int channel) const
        {
            std::size_t const block = index / block_channel, place = index % block_channel;
            return grid_->values_[(block * values + std::size_t(channel)) * block_channel + place];
        }

    private:
        Grid* grid_;
    };
    Nodes nodes_by_index() { return Nodes(*this); }
    /// How many indices there are.
    std::size_t node_count() const { return nodes_.size() * std::size_t(block_channel); }
    /// Changes whenever the indices of nodes do.
    std::uint64_t numbering() const { return numbering_; }
    /// Of loops that ask for them: see list_images().
    ImageLists& images() { return images_; }
    ImageLists const& images() const { return images_; }

    /// Makes the sums of the next step those of this one.
    void swap()
    {
        for (Tiles& tiles : tiles_) {
            tiles.of[0].swap(tiles.of[1]);
            std::swap(tiles.touched[0], tiles.touched[1]);
        }
    }

    std::size_t memory() const
    {
        std::size_t bytes = values_.memory() + map_.memory() + images_.memory() +
                            nodes_.capacity() * sizeof(NodeBlock) +
                            (by_owner_.capacity() + owner_begin_.capacity()) * sizeof(std::uint32_t);
        for (Tiles const& tiles : tiles_) bytes += tiles.memory();
        return bytes;
    }

private:
    /// Adds up the tiles of a layer that cover a place of a block of nodes.
    void add_sums(Tiles const& tiles, std::array<int, corners> const& covered_by, Coordinates<d> const& place,
                  Number (&found)[std::size_t(sums)]) const
    {
        for_each_tile(tiles, covered_by, place, [&](Number const* from) {
            for (int c = 0; c < sums; ++c) found[c] += from[c * tile_channel];
        });
    }

    /// One of these sums.
    Number sum_of(Tiles const& tiles, std::array<int, corners> const& covered_by, Coordinates<d> const& place,
                  int channel) const
    {
        Number sum = 0;
        for_each_tile(tiles, covered_by, place,
                      [&](Number const* from) { sum += from[channel * tile_channel]; });
        return sum;
    }

    /// Calls `use(first sum)` for the tiles of a layer that cover a place of a block of nodes.
    template <class Use>
    void for_each_tile(Tiles const& tiles, std::array<int, corners> const& covered_by,
                       Coordinates<d> const& place, Use const& use) const
    {
        for (int corner = 0; corner < corners; ++corner) {
            int const b = covered_by[std::size_t(corner)];
            if (b == absent) continue;
            Coordinates<d> at = place; // in the tile of a block that lies `corner` before this one
            int row = 0;
            bool covers = true;
            for (int a = 0; a < d; ++a) {
                at[a] += offset(corner)[a] * Base::Shape::extent(a);
                covers = covers && at[a] < (a == d - 1 ? Base::row_length : Base::rows_across);
                if (a < d - 1) row = row * Base::rows_across + at[a];
            }
            std::size_t const tile = tiles.tile_of[std::size_t(b)];
            if (!covers || ((tiles.touched[0][tile] >> row) & 1) == 0) continue;
            use(tiles.of[0].data() + tile * sums * tile_channel + row * Base::row_length + at[d - 1]);
        }
    }

    /// Assigns a tile to each block: the one it had, or a free one.
    template <class Order>
    void activate_tiles(Tiles& tiles, Order const& cells, bool have_history)
    {
        std::size_t const blocks = cells.blocks().size();
        std::vector<std::size_t> next(blocks, blocks);
        auto& touched = tiles.touched[0];
        std::vector<char> taken(std::max(blocks, touched.size()), 0);
        for (std::size_t b = 0; b < blocks; ++b)
            if (int const old = cells.old_block(b); have_history && old != absent)
                taken[next[b] = tiles.tile_of[static_cast<std::size_t>(old)]] = 1;
        std::size_t free = 0, count = 0;
        touched.resize(taken.size());
        for (std::size_t b = 0; b < blocks; ++b) {
            bool const is_new = !have_history || cells.old_block(b) == absent;
            if (is_new) {
                while (taken[free]) ++free;
                touched[free] = 0;
                next[b] = free++;
            }
            count = std::max(count, next[b] + 1);
        }
        tiles.tile_of = std::move(next);
        tiles.own = count;
        find_room_for_ghosts(tiles);
    }

    /// Ghosts have the tiles behind those of the blocks that are here.
    static void find_room_for_ghosts(Tiles& tiles)
    {
        std::size_t const count = tiles.own + tiles.ghosts.size();
        for (auto& of_tiles : tiles.touched) of_tiles.resize(count);
        for (auto& of : tiles.of) of.resize(count * sums * tile_channel);
    }

    /// Lets ghosts add to the nodes. Nodes that are under ghosts alone are not updated, but their neighbours
    /// may look at them. Returns whether there are ghosts.
    bool add_ghosts()
    {
        bool any = false;
        for (std::size_t l = 0; l < tiles_.size(); ++l) {
            Tiles& tiles = tiles_[l];
            std::size_t const blocks = tiles.nodes_of.size();
            tiles.tile_of.resize(blocks + tiles.ghosts.size());
            for (std::size_t g = 0; g < tiles.ghosts.size(); ++g) {
                tiles.tile_of[blocks + g] = tiles.own + g;
                any = true;
                for (int corner = 0; corner < corners; ++corner) {
                    Coordinates<d> const at = tiles.ghosts[g] + offset(corner);
                    int const n = node_block(periods_.wrapped(at));
                    nodes_[std::size_t(n)].covered_by[l][std::size_t(corner)] = int(blocks + g);
                }
            }
        }
        return any;
    }

    /// Finds the owners of nodes where there are ghosts: the block of cells at the nodes' coordinates, or the
    /// first of those that add to them, as if all blocks were here. `owners` has one element for each block
    /// of nodes under cells that are here.
    void find_owners(std::vector<std::uint32_t>& owners) const
    {
        for (std::size_t n = 0; n < owners.size(); ++n) {
            auto const covered = [&](auto const& of_layer) { return of_layer[0] != absent; };
            auto const& by = nodes_[n].covered_by;
            owners[n] = static_cast<std::uint32_t>(n);
            if (std::ranges::any_of(by, covered)) continue;
            for (std::size_t l = 0; l < by.size(); ++l)
                if (int const first = first_covering(n, l); first != absent) {
                    owners[n] = static_cast<std::uint32_t>(first);
                    break;
                }
        }
    }
    /// The block of nodes at the first block of cells of a layer that adds to this one, or absent.
    int first_covering(std::size_t n, std::size_t l) const
    {
        int first = absent;
        for (int corner = 0; corner < corners; ++corner) {
            if (nodes_[n].covered_by[l][std::size_t(corner)] == absent) continue;
            int const at = find(nodes_[n].coordinates - offset(corner));
            if (first == absent || key_of(at) < key_of(first)) first = at;
        }
        return first;
    }
    std::uint64_t key_of(int n) const { return block_key<d>(nodes_[std::size_t(n)].coordinates); }

    /// Finds the blocks of nodes under those of an order of cells, and the owners of new ones.
    template <class Order>
    void find_nodes(Tiles& tiles, Order const& cells, std::vector<std::uint32_t>& owners)
    {
        tiles.nodes_of.resize(cells.blocks().size());
        for (std::size_t b = 0; b < cells.blocks().size(); ++b)
            for (int corner = 0; corner < corners; ++corner) {
                Coordinates<d> at = cells.blocks()[b].coordinates;
                for (int a = 0; a < d; ++a) at[a] += offset(corner)[a];
                tiles.nodes_of[b][std::size_t(corner)] = node_block(periods_.wrapped(at));
                owners.resize(nodes_.size(), static_cast<std::uint32_t>(tiles.nodes_of[b][0]));
            }
    }

    /// Sorts the blocks of nodes by owner.
    void list_by_owner(std::vector<std::uint32_t> const& owners)
    {
        std::size_t const count = owners.empty() ? 0 : *std::max_element(owners.begin(), owners.end()) + 1;
        owner_begin_.assign(count + 2, 0); // those of owner o begin at o + 1 until they are sorted
        for (std::uint32_t const owner : owners) ++owner_begin_[owner + 2];
        std::partial_sum(owner_begin_.begin(), owner_begin_.end(), owner_begin_.begin());
        by_owner_.resize(owners.size());
        for (std::uint32_t n = 0; n < owners.size(); ++n) by_owner_[owner_begin_[owners[n] + 1]++] = n;
        owner_begin_.pop_back();
    }

    int node_block(Coordinates<d> const& coordinates)
    {
        auto const key = block_key<d>(coordinates);
        int index = map_.find(key);
        if (index != absent) return index;
        index = static_cast<int>(nodes_.size());
        NodeBlock block{coordinates, {}};
        for (auto& covered_by : block.covered_by) covered_by.fill(absent);
        nodes_.push_back(block);
        map_.insert(key, index);
        return index;
    }

    Periods<d> periods_; ///< of blocks
    std::vector<NodeBlock> nodes_;
    std::size_t centres_ = 0; ///< of these so many, the first ones, are at the coordinates of blocks of cells
    std::vector<std::uint32_t> by_owner_, owner_begin_{0};
    BlockMap map_;
    std::uint64_t numbering_ = 0;
    ImageLists images_;
    std::array<Tiles, std::size_t(layers)> tiles_;
    Array<Number> values_; ///< [layer, if each has its own][node block][channel][row][place]
};

} // namespace firn::openmp
