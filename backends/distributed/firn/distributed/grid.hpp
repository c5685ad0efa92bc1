// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/near_ranks.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// Which nodes a loop updates: those whose results are this rank's, the others under its cells, or both.
enum class Nodes
{
    all,
    own,
    others
};

/// The nodes under the cells that this rank has. Where cells of other ranks add to them, the tiles of these
/// come as ghosts, not reduced: nodes then add up the same tiles in the same order on every rank, and for any
/// number of ranks.
template <class Local, class Order, int d, int sums>
class Grid : public Local
{
    using Orders = std::array<Order*, std::size_t(Local::layers)>;
    static constexpr int row_numbers = Local::row_length;
    static constexpr std::size_t count_of_layers = std::size_t(Local::layers);
    using Number = std::remove_pointer_t<decltype(std::declval<Local&>().ghost_tile(0, 0))>;

    /// A part of a tile: some rows, and of these the places from `begin` to `end`.
    struct Window
    {
        std::uint64_t rows = ~std::uint64_t(0);
        std::uint32_t begin = 0, end = static_cast<std::uint32_t>(row_numbers);
    };
    /// A part of a tile as it is sent: `rows` are those that hold sums.
    struct Begin
    {
        std::uint64_t key; ///< of the block
        Window window;
    };

public:
    template <class Backend, class Periods>
    explicit Grid(Backend const& backend, Periods const& periods) : Local(backend.local, periods)
    {}
    template <class Backend>
    explicit Grid(Backend const& backend) : Local(backend.local)
    {}

    /// The same, and whether the sums of this step, or of the next one, have changed since their ghosts came
    /// last.
    class Layer : public Local::Layer
    {
    public:
        Layer(Grid& grid, std::size_t number) : Local::Layer(grid, number), ghosts_are_old_(&grid.are_old_) {}
        void change_sums() const { (*ghosts_are_old_)[0] = true; }
        void change_next_sums() const { (*ghosts_are_old_)[1] = true; }

        /// Appends a part of a block's tile to a parcel.
        void put_tile(std::size_t block, std::uint64_t key, Window const& window, Parcel& to) const
        {
            Begin const begin{key, {this->touched(block) & window.rows, window.begin, window.end}};
            put(to, begin);
            for_each_part(this->tile(block), begin.window,
                          [&](Number* part, std::size_t count) { put(to, part, count); });
        }
        /// All of it.
        void put_tile(std::size_t block, Parcel& to) const { put_tile(block, 0, {}, to); }
        /// Takes what that appended from a parcel, for set_tile().
        Parcel copied_tile(Reader& from) const
        {
            auto const begin = from.template get<Begin>();
            Parcel tile;
            put(tile, begin);
            std::size_t const before = tile.size(), bytes = bytes_of(begin.window);
            tile.resize(before + bytes);
            from.get(tile.data() + before, bytes);
            return tile;
        }
        /// Makes it the tile of a block.
        void set_tile(std::size_t block, Parcel const& tile) const
        {
            Reader from(tile);
            auto const begin = from.template get<Begin>();
            this->touched(block) = begin.window.rows;
            for_each_part(this->tile(block), begin.window,
                          [&](Number* part, std::size_t count) { from.get(part, count); });
        }

    private:
        std::array<bool, 2>* ghosts_are_old_;
    };
    Layer layer(std::size_t of) { return {*this, of}; }

    /// Updates the tiles; nodes follow in exchange().
    void activate(Orders const& orders)
    {
        if (Local::assign_tiles(orders)) blocks_have_changed_ = true;
        are_old_ = {true, true};
    }
    void swap()
    {
        Local::swap();
        std::swap(are_old_[0], are_old_[1]);
    }

    /// Lets ghosts come from other ranks, unless they have, for nodes that look at others up to `reach`
    /// blocks away. To be called before nodes are updated.
    void exchange(Orders const& orders, int distance)
    {
        communicator_ = &orders[0]->communicator();
        if (!are_old_[0] && distance <= looks_) return;
        are_old_[1] = are_old_[1] || distance > looks_; // there are other ghosts then
        if (blocks_have_changed_ || distance > looks_) {
            looks_ = std::max(distance, looks_);
            find_borders(orders);
        }
        take_in(communicator_->exchange(packed(orders)), orders);
        are_old_[0] = false;
    }

    /// Lets the next loop over nodes see these.
    void show(Nodes which) { shown_ = which; }
    int owners() const
    {
        auto const here = static_cast<int>(this->owners_here());
        return shown_ == Nodes::own ? here : Local::owners() - first_owner();
    }
    std::span<std::uint32_t const> nodes_at(int owner) const
    {
        return Local::nodes_at(owner + first_owner());
    }

    /// What this rank has of the node with an index: see Local::nodes_by_index(). It holds as long as
    /// indices.
    NodeShare share_of(std::uint32_t index)
    {
        if (shares_at_ != this->numbering()) find_shares();
        return shares_[index / static_cast<std::uint32_t>(Local::block_channel)];
    }

    /// Calls `use(rank, first index, count)` for nodes for which this rank speaks: those that another rank
    /// may have cells so few nodes away from.
    template <class Use>
    void for_each_near(Orders const& orders, int distance, Use const& use)
    {
        constexpr auto count = static_cast<std::uint32_t>(Local::block_channel);
        if (shares_at_ != this->numbering()) find_shares();
        for (std::uint32_t n = 0; n < shares_.size(); ++n) {
            if (shares_[n] != NodeShare::results) continue;
            for (std::size_t const rank :
                 ranks_near<Local>(*orders[0], this->nodes()[n].coordinates, distance))
                use(rank, n * count, count);
        }
    }
    /// The rank that has the cell which begins at a node.
    static int rank_of(Orders const& orders, Coordinates<d> const& node)
    {
        return orders[0]->owner(Local::block_and_place(node).first);
    }

    /// See distributed::exchange_near().
    template <class T, class NodeOf>
    std::vector<T> exchange_near(Orders const& orders, std::vector<T> const& own, int distance,
                                 NodeOf const& node_of) const
    {
        return distributed::exchange_near<Local>(*orders[0], own, distance, node_of);
    }

    /// Merges the results of the nodes of all ranks, each node's once.
    template <class Result>
    Result merged(std::span<Result const> of_owners) const
    {
        if constexpr (std::is_same_v<Result, NothingFound>)
            return {};
        else {
            if (shown_ == Nodes::others) return {}; // they are other ranks'
            std::vector<Part<Result>> parts;
            parts.reserve(of_owners.size());
            for (std::size_t o = 0; o < of_owners.size(); ++o) {
                auto const& block = this->nodes()[o];
                std::size_t layer = 0; // the first one that has a block here
                while (block.covered_by[layer][0] == Local::absent) ++layer;
                parts.push_back({layer, block_key<d>(block.coordinates), of_owners[o]});
            }
            return merge_over_ranks(*communicator_, std::move(parts));
        }
    }

private:
    void find_shares()
    {
        shares_at_ = this->numbering();
        shares_.assign(this->nodes().size(), NodeShare::none);
        for (int owner = 0; owner < Local::owners(); ++owner)
            for (auto const n : Local::nodes_at(owner))
                shares_[n] =
                    owner < static_cast<int>(this->owners_here()) ? NodeShare::results : NodeShare::values;
    }

    int first_owner() const { return shown_ == Nodes::others ? static_cast<int>(this->owners_here()) : 0; }

    /// A block with the part of its tile that another rank needs.
    struct Border
    {
        std::size_t block;
        Window window;
    };

    /// Lists the blocks whose tiles other ranks need: those with a neighbour that another rank has.
    void find_borders(Orders const& orders)
    {
        int const rank = communicator_->rank(), width = 2 * looks_ + 1;
        int steps = 1;
        for (int a = 0; a < d; ++a) steps *= width;
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            border_[l].assign(static_cast<std::size_t>(communicator_->size()), {});
            auto const blocks = orders[l]->blocks();
            for (std::size_t b = 0; b < blocks.size(); ++b)
                for (int step = 0; step < steps; ++step) {
                    Coordinates<d> at = blocks[b].coordinates;
                    for (int a = 0, rest = step; a < d; ++a, rest /= width) at[a] += rest % width - looks_;
                    int const owner = orders[l]->owner(at);
                    if (owner == rank) continue;
                    auto& list = border_[l][static_cast<std::size_t>(owner)];
                    Coordinates<d> const way = at - blocks[b].coordinates;
                    Window const window = looks_ > 1 ? Window{} : shared_with(way);
                    if (list.empty() || list.back().block != b)
                        list.push_back({b, window});
                    else {
                        auto& all = list.back().window;
                        all = {all.rows | window.rows, std::min(all.begin, window.begin),
                               std::max(all.end, window.end)};
                    }
                }
        }
    }

    /// The part of a tile in the blocks of nodes that are under a neighbour of the tile's block, too.
    static Window shared_with(Coordinates<d> const& way)
    {
        auto const is_shared = [](int steps, int at, int extent) {
            return steps == 0 || (steps < 0 ? at < extent : at >= extent);
        };
        Window window{Local::ends};
        for (int row = 0; row < Local::rows; ++row) {
            bool shared = true;
            for (int a = d - 2, rest = row; a >= 0; --a, rest /= Local::rows_across)
                shared = shared && is_shared(way[a], rest % Local::rows_across, Local::Shape::across);
            if (shared) window.rows |= std::uint64_t{1} << row;
        }
        constexpr auto along = static_cast<std::uint32_t>(Local::Shape::along);
        if (way[d - 1] < 0) window.end = along;
        if (way[d - 1] > 0) window.begin = along;
        return window;
    }

    /// The tiles for each rank: how many there are of each layer, and of each its block, and the rows of it
    /// that hold sums.
    std::vector<Parcel> packed(Orders const& orders)
    {
        std::vector<Parcel> to(static_cast<std::size_t>(communicator_->size()));
        for (std::size_t r = 0; r < to.size(); ++r) {
            if (r == static_cast<std::size_t>(communicator_->rank())) continue;
            for (std::size_t l = 0; l < count_of_layers; ++l) {
                put(to[r], std::uint64_t{border_[l][r].size()});
                auto const of_layer = layer(l);
                for (auto const& [b, window] : border_[l][r])
                    of_layer.put_tile(b, block_key<d>(orders[l]->blocks()[b].coordinates), window, to[r]);
            }
        }
        return to;
    }

    /// Calls `use(first number, how many)` for a part of a tile, row by row.
    template <class Use>
    static void for_each_part(Number* tile, Window const& window, Use const& use)
    {
        for (int row = 0; row < Local::rows; ++row)
            if ((window.rows >> row) & 1)
                for (int c = 0; c < sums; ++c)
                    use(tile + c * Local::tile_channel + row * row_numbers + window.begin,
                        static_cast<std::size_t>(window.end - window.begin));
    }
    static std::size_t bytes_of(Window const& window)
    {
        constexpr std::uint64_t all = (std::uint64_t{1} << Local::rows) - 1;
        auto const rows = static_cast<std::size_t>(std::popcount(window.rows & all));
        return rows * sums * (window.end - window.begin) * sizeof(Number);
    }

    void take_in(std::vector<Parcel> const& came, Orders const& orders)
    {
        std::vector<Reader> from;
        for (Parcel const& parcel : came) from.emplace_back(parcel);
        bool are_others = blocks_have_changed_;
        for (std::size_t l = 0; l < count_of_layers; ++l) {
            std::vector<Coordinates<d>> at;
            std::size_t ghost = 0;
            // a first look at which ghosts there are: room for their tiles must be there before they are read
            std::vector<Reader> look = from;
            for (Reader& parcel : look)
                for_each_ghost(parcel, [&](Begin const& begin) {
                    at.push_back(block_of_key<d>(begin.key));
                    parcel.skip(bytes_of(begin.window));
                });
            auto const before = Local::ghosts(l);
            bool const same = std::equal(at.begin(), at.end(), before.begin(), before.end());
            are_others = are_others || !same;
            if (!same) Local::set_ghosts(l, std::move(at));
            for (Reader& parcel : from)
                for_each_ghost(parcel, [&](Begin const& begin) {
                    Local::ghost_touched(l, ghost) = begin.window.rows;
                    for_each_part(Local::ghost_tile(l, ghost), begin.window,
                                  [&](Number* part, std::size_t count) { parcel.get(part, count); });
                    ++ghost;
                });
        }
        if (are_others) Local::connect(orders);
        blocks_have_changed_ = false;
    }

    /// Calls `use(begin)` for the ghosts of a layer that come next in a parcel.
    template <class Use>
    static void for_each_ghost(Reader& from, Use const& use)
    {
        if (from.at_end()) return;
        for (auto count = from.template get<std::uint64_t>(); count > 0; --count)
            use(from.template get<Begin>());
    }

    typename std::remove_cvref_t<decltype(std::declval<Order&>().communicator())> const* communicator_ =
        nullptr;
    std::array<std::vector<std::vector<Border>>, count_of_layers>
        border_;                    ///< [layer][rank]: blocks that it needs
    std::vector<NodeShare> shares_; ///< by block of nodes
    std::uint64_t shares_at_ = 0;   ///< the numbering for which they are
    int looks_ = 0;
    Nodes shown_ = Nodes::all;
    bool blocks_have_changed_ = true;
    std::array<bool, 2> are_old_{true, true}; ///< ghosts of the sums of this step, and of the next one
};

} // namespace firn::distributed
