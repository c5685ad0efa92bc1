// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn::distributed
{

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

public:
    template <class Backend, class Periods>
    explicit Grid(Backend const& backend, Periods const& periods) : Local(backend.local, periods)
    {}
    template <class Backend>
    explicit Grid(Backend const& backend) : Local(backend.local)
    {}

    /// The same, and whether the sums have changed since ghosts came last.
    class Layer : public Local::Layer
    {
    public:
        Layer(Grid& grid, std::size_t number) : Local::Layer(grid, number), ghosts_are_old_(&grid.are_old_) {}
        void change_sums() const { *ghosts_are_old_ = true; }

        /// Appends the tile of a block to a parcel: which rows hold sums, and these.
        void put_tile(std::size_t block, Parcel& to) const
        {
            std::uint64_t const touched = this->touched(block);
            put(to, touched);
            for_each_row(this->tile(block), touched, [&](Number* row) { put(to, row, row_numbers); });
        }
        /// The tile that comes next in a parcel, and set_tile() makes that of a block.
        Parcel copied_tile(Reader& from) const
        {
            auto const touched = from.template get<std::uint64_t>();
            Parcel tile;
            put(tile, touched);
            for_each_row(nullptr, touched, [&](Number*) {
                std::array<Number, std::size_t(row_numbers)> row;
                from.get(row.data(), row.size());
                put(tile, row.data(), row.size());
            });
            return tile;
        }
        void set_tile(std::size_t block, Parcel const& tile) const
        {
            Reader from(tile);
            auto const touched = this->touched(block) = from.template get<std::uint64_t>();
            for_each_row(this->tile(block), touched, [&](Number* row) { from.get(row, row_numbers); });
        }

    private:
        bool* ghosts_are_old_;
    };
    Layer layer(std::size_t of) { return {*this, of}; }

    /// Updates the tiles; nodes follow in exchange().
    void activate(Orders const& orders)
    {
        if (Local::assign_tiles(orders)) blocks_have_changed_ = true;
        are_old_ = true;
    }
    void swap()
    {
        Local::swap();
        are_old_ = true;
    }

    /// Lets ghosts come from other ranks, unless they have, for nodes that look at others up to `reach`
    /// blocks away. To be called before nodes are updated.
    void exchange(Orders const& orders, int distance)
    {
        communicator_ = &orders[0]->communicator();
        if (!are_old_ && distance <= looks_) return;
        if (blocks_have_changed_ || distance > looks_) {
            looks_ = std::max(distance, looks_);
            find_borders(orders);
        }
        take_in(communicator_->exchange(packed(orders)), orders);
        are_old_ = false;
    }

    /// Merges the results of the nodes of all ranks, each node's once.
    template <class Result>
    Result merged(std::span<Result const> of_owners) const
    {
        if constexpr (std::is_same_v<Result, NothingFound>)
            return {};
        else {
            std::vector<Part<Result>> parts;
            std::size_t const count = std::min(of_owners.size(), this->owners_here());
            parts.reserve(count);
            for (std::size_t o = 0; o < count; ++o) {
                auto const& block = this->nodes()[o];
                std::size_t layer = 0; // the first one that has a block here
                while (block.covered_by[layer][0] == Local::absent) ++layer;
                parts.push_back({layer, block_key<d>(block.coordinates), of_owners[o]});
            }
            return merge_over_ranks(*communicator_, std::move(parts));
        }
    }

private:
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
                    auto& list = border_[l][static_cast<std::size_t>(owner)];
                    if (owner != rank && (list.empty() || list.back() != b)) list.push_back(b);
                }
        }
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
                for (std::size_t const b : border_[l][r]) {
                    put(to[r], block_key<d>(orders[l]->blocks()[b].coordinates));
                    of_layer.put_tile(b, to[r]);
                }
            }
        }
        return to;
    }

    /// Calls `use(first number)` for the rows of a tile that hold sums.
    template <class Use>
    static void for_each_row(Number* tile, std::uint64_t touched, Use const& use)
    {
        for (int row = 0; row < Local::rows; ++row)
            if ((touched >> row) & 1)
                for (int c = 0; c < sums; ++c) use(tile + c * Local::tile_channel + row * row_numbers);
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
                for_each_ghost(parcel, [&](std::uint64_t key, std::uint64_t touched, Reader& rest) {
                    at.push_back(block_of_key<d>(key));
                    for_each_row(nullptr, touched, [&](Number*) { rest.skip(row_numbers * sizeof(Number)); });
                });
            auto const before = Local::ghosts(l);
            bool const same = std::equal(at.begin(), at.end(), before.begin(), before.end());
            are_others = are_others || !same;
            if (!same) Local::set_ghosts(l, std::move(at));
            for (Reader& parcel : from)
                for_each_ghost(parcel, [&](std::uint64_t, std::uint64_t touched, Reader& rest) {
                    Local::ghost_touched(l, ghost) = touched;
                    for_each_row(Local::ghost_tile(l, ghost), touched,
                                 [&](Number* row) { rest.get(row, row_numbers); });
                    ++ghost;
                });
        }
        if (are_others) Local::connect(orders);
        blocks_have_changed_ = false;
    }

    /// Calls `use(key, touched rows, reader)` for the ghosts of a layer that come next in a parcel.
    template <class Use>
    static void for_each_ghost(Reader& from, Use const& use)
    {
        if (from.at_end()) return;
        for (auto count = from.template get<std::uint64_t>(); count > 0; --count) {
            auto const key = from.template get<std::uint64_t>(), touched = from.template get<std::uint64_t>();
            use(key, touched, from);
        }
    }

    typename std::remove_cvref_t<decltype(std::declval<Order&>().communicator())> const* communicator_ =
        nullptr;
    std::array<std::vector<std::vector<std::size_t>>, count_of_layers>
        border_; ///< [layer][rank]: blocks that it needs
    int looks_ = 0;
    bool blocks_have_changed_ = true, are_old_ = true;
};

} // namespace firn::distributed
