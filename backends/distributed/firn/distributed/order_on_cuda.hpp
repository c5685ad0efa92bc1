// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/strays.hpp>
#include <firn/distributed/cell_order.hpp>
#include <firn/distributed/fill_holes.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/owned_order_on_cuda.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/swap_on_cuda.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// The order of cells of a device that shares them with other ranks, and swaps items with these.
template <class C, class Number, int d>
class CellOrder<cuda::CellOrder<Number, d>, C, Number, d> : public OwnedOrder<C, Number, d>
{
    using Owned = OwnedOrder<C, Number, d>;

public:
    using typename cuda::CellOrder<Number, d>::Offset;
    using Owned::coming, Owned::has, Owned::keys, Owned::owner, Owned::owners, Owned::with_room;

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Owned(backend, periods), list_(backend), swap_(backend.queue()), origins_(backend)
    {}

    /// See the primary template.
    struct Departure
    {
        std::vector<std::uint32_t> places{};
        Parcel notes{};
    };
    std::vector<Departure> depart(std::array<Offset*, std::size_t(d)> const& /*offset*/)
    {
        gone_.clear();
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        if (this->blocks() == 0) return by_rank;
        cuda::OnDevice const here(this->queue_);
        auto const strays = downloaded(strays_, searched_.strays);
        auto const contributions = contributions_of(strays);
        auto const channels = static_cast<std::size_t>(this->channels_);
        for (std::size_t i = 0; i < strays.size(); ++i) {
            auto const& stray = strays[i];
            auto& to = by_rank[static_cast<std::size_t>(owners()[stray.block])];
            WayOut const out(stray.cell % Shape::cells, stray.way);
            put(to.notes,
                Arrival{AllLeavers::origin_of(stray.cell / Shape::cells, stray.slot),
                        static_cast<std::uint32_t>(stray.block * std::uint32_t{Shape::cells} + out.place)});
            put(to.notes, contributions.data() + i * channels, channels);
            to.places.push_back(stray.slot);
            gone_.push_back(stray.slot);
        }
        return by_rank;
    }
    template <class Move>
    void arrive(std::span<Parcel const> notes, std::uint32_t first,
                std::array<Offset*, std::size_t(d)> const& offset, Move const& move)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        std::size_t const came = admit(notes, first);
        auto const count = static_cast<std::uint32_t>(first - gone_.size() + came);
        sort_in(count, offset);
        fill_holes(*this, gone_, first + came, count, move);
        drop_empty_blocks();
        forget_strays();
    }
    /// Both in one, without the host, where nothing else has to travel with items. `fields(use)` calls
    /// `use(array)` for each array of the items. These have room for `first` items that were here and for
    /// coming() more; `offset` are some of them.
    template <class Fields>
    void swap_items(std::uint32_t first, std::array<Offset*, std::size_t(d)> const& offset,
                    Fields const& fields)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        auto const came = static_cast<std::uint32_t>(coming());
        if (strays_of_all_ > 0)
            swap_(communicator_, strays_, owners_.data(), this->leavers(), leaving_, coming_, fields);
        expect_arrivals(came, first);
        swap_.unpack(coming_, first, fields,
                     {origins_.data(), list_.data(),
                      this->leavers_.contribution.data() +
                          searched_.leavers * static_cast<std::size_t>(this->channels_)});
        let_in(came);
        std::uint32_t const gone = std::accumulate(leaving_.begin(), leaving_.end(), std::uint32_t{0});
        sort_in(first + came - gone, offset);
        swap_.fill_holes(first + came, first + came - gone, fields,
                         [&](std::uint32_t const* place) { relocate(first + came - gone, place); });
        drop_empty_blocks();
        forget_strays();
    }
    /// Items that lay at places from `first` on lie at `place[where it lay - first]` now.
    void relocate(std::uint32_t first, std::vector<std::uint32_t> const& place)
    {
        list_.renew(place.size());
        list_.upload(0, place);
        relocate(first, list_.data());
    }
    void relocate(std::uint32_t first, std::uint32_t const* place)
    {
        for (auto const& [where, count] : {std::pair{this->order_.data(), this->size()},
                                           std::pair{this->leavers_.slot.data(), std::size_t{listed_}}})
            if (count > 0)
                cuda::launch_after("relocate", this->queue_, cuda::detail::relocate,
                                   cuda::groups_of(count, 256), 256, where, count, first, place);
    }

    /// See the primary template.
    template <class Layer>
    std::vector<Departure> hand_over(Layer const& layer)
    {
        std::vector<Departure> by_rank(static_cast<std::size_t>(communicator_.size()));
        gone_.clear();
        if (this->blocks() == 0) return by_rank;
        begin_here_ = downloaded(this->begin_, keys().size() * Shape::cells + 1);
        order_here_ = downloaded(this->order_, this->size());
        if (this->committed_) std::iota(order_here_.begin(), order_here_.end(), std::uint32_t(0));
        std::vector<std::uint32_t> blocks;
        for (std::uint32_t b = 0; b < keys().size(); ++b)
            if (has(b) && owner(block_of_key<d>(keys()[b])) != communicator_.rank()) blocks.push_back(b);
        auto const tiles = layer.tiles(blocks);
        for (std::size_t i = 0; i < blocks.size(); ++i) {
            std::uint32_t const b = blocks[i], *const begin = &begin_here_[std::size_t(b) * Shape::cells];
            auto& to = by_rank[static_cast<std::size_t>(owner(block_of_key<d>(keys()[b])))];
            put(to.notes, b);
            put(to.notes, begin, Shape::cells + 1);
            put(to.notes, tiles.data() + i * Layer::TileShape::nodes, Layer::TileShape::nodes);
            std::span const items = std::span(order_here_).subspan(*begin, begin[Shape::cells] - *begin);
            to.places.insert(to.places.end(), items.begin(), items.end());
            gone_.insert(gone_.end(), items.begin(), items.end());
        }
        return by_rank;
    }
    template <class Layer, class Move>
    void take_over(std::span<Parcel const> notes, std::uint32_t first, Layer const& layer, Move const& move)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        std::vector<std::vector<std::uint32_t>> came(keys().size()); // beginnings of the cells of each block
        std::vector<std::uint32_t> place(keys().size()), blocks;
        std::vector<typename Layer::Sums> tiles;
        std::uint32_t next = first;
        for (Parcel const& parcel : notes)
            for (Reader from(parcel); !from.at_end();) {
                auto const b = from.template get<std::uint32_t>();
                came[b].resize(Shape::cells + 1);
                from.get(came[b].data(), came[b].size());
                place[b] = next;
                next += came[b].back() - came[b].front();
                blocks.push_back(b);
                tiles.resize(tiles.size() + Layer::TileShape::nodes);
                from.get(&tiles[tiles.size() - Layer::TileShape::nodes], Layer::TileShape::nodes);
            }
        layer.set_tiles(blocks, tiles);
        std::vector<std::uint32_t> begin{0}, order;
        for (std::size_t b = 0; b < keys().size(); ++b) {
            bool const stays = has(b) && owner(block_of_key<d>(keys()[b])) == communicator_.rank();
            std::uint32_t const* const before = stays ? &begin_here_[b * Shape::cells] : came[b].data();
            for (int c = 0; c < Shape::cells; ++c) {
                std::uint32_t const items = before == nullptr ? 0 : before[c + 1] - before[c];
                for (std::uint32_t i = 0; i < items; ++i)
                    order.push_back(stays ? order_here_[before[c] + i] : place[b]++);
                begin.push_back(static_cast<std::uint32_t>(order.size()));
            }
        }
        find_owners();
        this->begin_.upload(0, begin);
        this->order_.resize(order.size());
        this->order_.upload(0, order);
        this->left_.renew(std::max(order.size(), this->left_.size()));
        this->stay_all();
        this->size_ = order.size();
        this->committed_ = false;
        searched_ = {};
        knows_live_here_ = false;
        listed_ = 0;
        fill_holes(*this, gone_, next, static_cast<std::uint32_t>(this->size()), move);
    }
    /// They have been taken with the blocks.
    template <class Layer>
    void take_tiles(Layer const&) const
    {}

    std::size_t memory() const
    {
        return Owned::memory() + list_.memory() + origins_.memory() + swap_.memory();
    }

private:
    using Shape = cuda::BlockShape<d>;
    using typename Owned::Searched, typename Owned::Stray;
    using WayOut = cuda::detail::WayOut<d>;
    using AllLeavers = cuda::detail::LeaversOfDevices<Number>;
    using Owned::are_crowded, Owned::coming_, Owned::communicator_, Owned::count_, Owned::downloaded,
        Owned::find_owners, Owned::forget_strays, Owned::knows_live_here_, Owned::leaving_,
        Owned::live_is_known_, Owned::may_be_crowded, Owned::owners_, Owned::searched_, Owned::strays_,
        Owned::strays_of_all_;

    /// An item that comes from another rank.
    struct Arrival
    {
        std::uint64_t origin;
        std::uint32_t cell;
    };

    std::vector<Number> contributions_of(std::vector<Stray> const& strays)
    {
        std::vector<Number> contributions;
        auto const channels = static_cast<std::size_t>(this->channels_);
        if (strays.empty() || channels == 0) return contributions;
        auto const all = downloaded(this->leavers_.contribution, searched_.leavers * channels);
        for (auto const& stray : strays) {
            auto const* const own = all.data() + stray.leaver * channels;
            contributions.insert(contributions.end(), own, own + channels);
        }
        return contributions;
    }

    AllLeavers all_leavers()
    {
        return {this->leavers(), searched_.leavers, origins_.data(), this->order_before_.data()};
    }
    /// Lists what came, and lets it into its cells; returns how many items.
    std::size_t admit(std::span<Parcel const> notes, std::uint32_t first)
    {
        std::vector<std::uint64_t> origins;
        std::vector<std::uint32_t> cells;
        std::vector<Number> contributions;
        auto const channels = static_cast<std::size_t>(this->channels_);
        for (Parcel const& parcel : notes)
            for (Reader from(parcel); !from.at_end();) {
                auto const item = from.template get<Arrival>();
                origins.push_back(item.origin);
                cells.push_back(item.cell);
                contributions.resize(contributions.size() + channels);
                from.get(contributions.data() + contributions.size() - channels, channels);
            }
        auto const count = static_cast<std::uint32_t>(cells.size());
        expect_arrivals(count, first);
        if (count == 0) return 0;
        this->leavers_.contribution.upload(searched_.leavers * channels, contributions);
        origins_.upload(0, origins);
        list_.upload(0, cells);
        let_in(count);
        return count;
    }
    /// Makes room for what comes from other ranks, from place `first` on.
    void expect_arrivals(std::uint32_t count, std::uint32_t first)
    {
        listed_ = searched_.leavers + count;
        this->order_before_.renew(listed_);
        if (count == 0) return;
        this->leavers_.grow(listed_, this->channels_);
        origins_.renew_amply(count);
        list_.renew_amply(count);
        cuda::launch_after("number_from", this->queue_, cuda::detail::number_from,
                           cuda::groups_of(count, 256), 256, first, count,
                           this->leavers_.slot.data() + searched_.leavers);
    }
    /// Lets that into its cells, which are listed.
    void let_in(std::uint32_t count)
    {
        if (count == 0) return;
        cuda::launch_after("admit", this->queue_, cuda::detail::admit<Number>, cuda::groups_of(count, 256),
                           256, all_leavers(), count, list_.data(), this->changes());
    }
    /// Sorts all items into the new order, of which there are `count`.
    void sort_in(std::uint32_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        this->rate_of_births_.count_step();
        this->find_block_begins();
        this->offset_ = offset;
        this->rebinned_blocks_ = this->blocks();
        // all ranks wait while one allocates
        if (this->committed_ && count * sizeof(std::uint32_t) > this->order_.memory())
            this->order_.resize(with_room(count));
        cuda::detail::PartOfBlocks const part = this->part();
        this->rearrange(all_leavers(), listed_, this->left_.data(), offset, count,
                        this->has_all() ? nullptr : &part);
        if (count > this->left_.memory()) this->left_.renew(with_room(count));
        this->left_.renew(std::max<std::size_t>(count, this->left_.size()));
    }

    /// Drops empty blocks where there are too many, as one device would.
    void drop_empty_blocks()
    {
        std::uint32_t const blocks = this->blocks();
        if (live_is_known_ && !may_be_crowded()) return;
        count_.renew(1);
        count_.fill_bytes(0, 1, 0);
        cuda::launch_after("count_live_blocks", this->queue_, cuda::detail::count_live_blocks,
                           cuda::groups_of(blocks, 128), 128, this->begin_.data(), blocks, count_.data());
        std::size_t const live = sum_of_ranks(communicator_, downloaded(count_, 1)[0]);
        if (!are_crowded(live)) return;
        std::uint32_t const here = this->list_live_blocks();
        auto all = of_all_ranks(communicator_, downloaded(this->blocks_before_, here));
        std::ranges::sort(all);
        this->blocks_before_.upload(0, all);
        this->forget_empty_blocks(static_cast<std::uint32_t>(all.size()));
        this->stay_all(); // loops leave the blocks of other ranks as they are
        find_owners();
    }

    std::uint32_t listed_ = 0;                           ///< leavers, and those that came from other ranks
    std::vector<std::uint32_t> gone_;                    ///< where items lay that have left for other ranks
    std::vector<std::uint32_t> begin_here_, order_here_; ///< copies, while blocks are handed over
    cuda::Array<std::uint32_t> list_;
    SwapOfItems<Number, d> swap_;
    cuda::Array<std::uint64_t> origins_; ///< of what came
};

} // namespace firn::distributed
