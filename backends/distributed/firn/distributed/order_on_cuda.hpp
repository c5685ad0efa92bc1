// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/strays.hpp>
#include <firn/distributed/cell_order.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/owned_order_on_cuda.hpp>
#include <firn/distributed/swap_on_cuda.hpp>
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
    using Owned::coming, Owned::has, Owned::keys, Owned::next_owner, Owned::owner, Owned::owners,
        Owned::with_room;

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Owned(backend, periods), rooms_here_(backend.queue()), rooms_(backend), left_behind_(backend),
          swap_(backend.queue()), origins_(backend)
    {}

    /// Called when items are queued to move: `fields` are what they will have then. Strays are packed as soon
    /// as they have been found, travel beside what ranks tell each other, and are taken in while the host
    /// learns that. If the step fails, nothing of it is used.
    template <class Fields>
    void will_swap(Fields const& fields)
    {
        will_not_swap();
        std::size_t places = std::size_t(-1);
        fields.by_place([&]<class Array>(Array& array) {
            using Value = typename Array::Value;
            travelling_.push_back({reinterpret_cast<unsigned char*>(array.data()), sizeof(Value)});
            places = std::min(places, array.memory() / sizeof(Value));
        });
        if (!swap_.has_room_for(travelling_.size())) travelling_.clear();
        room_for_places_ = places;
    }
    void will_not_swap() { travelling_.clear(); } ///< they have more than such fields
    /// Called where items change after they have moved: what has been packed of them is old, and they are to
    /// travel once more. All ranks call it.
    void forget_packed()
    {
        if (std::exchange(this->are_swapped_, false) && std::exchange(are_in_, false)) search_anew();
    }

    /// Called when the search for new cells is queued: packs strays for the ranks that have had some of late.
    /// Returns whether any rank does so for this order.
    bool pack_early(std::uint32_t const* told, std::vector<DeviceMessage>& to,
                    std::vector<DeviceMessage>& from)
    {
        are_in_ = false;
        this->are_packed_ = DeviceExchange::is_on_device<C> && !travelling_.empty() && this->blocks() > 0 &&
                            this->room_.is_any();
        if (!this->are_packed_) return false;
        this->room_of_packed_ = this->room_;
        std::vector<std::uint32_t> room_out, room_in;
        int const ranks = communicator_.size(), own = communicator_.rank();
        for (int rank = 0; rank < ranks; ++rank) {
            room_out.push_back(this->room_(own, rank));
            room_in.push_back(this->room_(rank, own));
        }
        swap_.pack_early(strays_, told + Owned::place_of_strays, owners_.data(), this->leavers(), travelling_,
                         room_out, room_in, to, from);
        room_in_ = std::accumulate(room_in.begin(), room_in.end(), std::size_t{0});
        is_next_ = true;
        return true;
    }
    /// Called when a step is queued as a whole, of which all ranks have told this: takes in what has come, if
    /// nothing is left out. It does not wait for the host to know. If the step fails, the next one forgets
    /// it.
    void take_in_early(std::uint32_t const* told, std::size_t stride)
    {
        if (!std::exchange(is_next_, false)) return;
        std::size_t const first = this->size();
        if (first + room_in_ > room_for_places_) return;
        cuda::OnDevice const here(this->queue_);
        auto const ranks = static_cast<std::uint32_t>(communicator_.size());
        tell_rooms();
        left_behind_.renew(1);
        cuda::detail::ToldOfStrays const of{told, stride, ranks,
                                            static_cast<std::uint32_t>(communicator_.rank())};
        cuda::launch_after("look_for_strays_left", this->queue_, cuda::detail::look_for_strays_left, 1, 256,
                           of, rooms_.data(), left_behind_.data());
        this->leavers_.make_room_behind(room_in_, this->channels_);
        origins_.renew_amply(room_in_);
        swap_.take_in_early(left_behind_.data(), of, static_cast<std::uint32_t>(first), travelling_,
                            leavers_from(this->leavers_.most), origins_.data(), this->changes());
        this->find_block_begins();
        are_in_ = true;
    }

    /// Swaps the items that leave for other ranks and come from there, and sorts all of them in, without the
    /// host; fill_holes() completes it. `fields.by_place(use)` calls `use(array)` for each array of the
    /// items. These have room for `first` items that were here and for coming() more; `offset` are some of
    /// them. `fields.by_id(use)` does so for arrays whose elements are found by what fields.ids() have of the
    /// items.
    template <class Fields>
    void swap_items(std::uint32_t first, std::array<Offset*, std::size_t(d)> const& offset,
                    Fields const& fields)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        auto const came = static_cast<std::uint32_t>(coming());
        bool has_more = false; // than has been packed
        fields.by_id([&](auto const&) { has_more = true; });
        if (has_more) forget_packed();
        bool const are_swapped = std::exchange(are_swapped_, false),
                   are_in = std::exchange(are_in_, false) && are_swapped;
        if (are_swapped)
            swap_.accept_packed();
        else {
            swap_.forget();
            if (strays_of_all_ > 0)
                swap_(communicator_, strays_, owners_.data(), this->leavers(), leaving_, coming_, fields);
        }
        if (are_in)
            make_room_for_arrivals(this->leavers_.most, came);
        else {
            expect_arrivals(searched_.leavers, came);
            swap_.unpack(coming_, first, fields, all_leavers(), origins_.data(), this->changes());
            this->find_block_begins();
        }
        std::uint32_t const gone = std::accumulate(leaving_.begin(), leaving_.end(), std::uint32_t{0});
        sort_in(first + came - gone, offset);
        places_ = first + came;
        drop_empty_blocks();
        forget_strays();
    }
    /// All items have moved to their slots, where there are no holes.
    void commit()
    {
        Owned::commit();
        places_ = 0;
    }
    /// Until then the items lie at some of `first + coming()` places, since those that have left leave holes.
    /// Afterwards they lie at the first ones. A step that moves all of them does not ask for it.
    template <class Fields>
    void fill_holes(Fields const& fields)
    {
        auto const count = static_cast<std::uint32_t>(this->size());
        std::uint32_t const places = std::exchange(places_, 0);
        if (places <= count) return;
        cuda::OnDevice const here(this->queue_);
        swap_.fill_holes(places, count, fields, [&](std::uint32_t const* place) {
            if (count > 0)
                cuda::launch_after("relocate", this->queue_, cuda::detail::relocate,
                                   cuda::groups_of(count, std::size_t{256} * cuda::detail::relocated_at_once),
                                   256, this->order_.data(), std::size_t{count}, count, place);
        });
    }

    /// When space has been divided anew by what blocks weigh: finds out what goes where. Then coming() is
    /// known.
    void prepare_to_swap_blocks()
    {
        auto const ranks = static_cast<std::size_t>(communicator_.size());
        int const rank = communicator_.rank();
        blocks_out_.assign(ranks, {});
        blocks_in_.assign(ranks, {});
        leaving_.assign(ranks, 0);
        for (std::uint32_t b = 0; b < this->blocks(); ++b) {
            int const before = owners()[b], after = next_owner(b);
            if (before == after) continue;
            if (before == rank) {
                blocks_out_[std::size_t(after)].push_back(b);
                leaving_[std::size_t(after)] += items_[b];
            }
            if (after == rank) blocks_in_[std::size_t(before)].push_back(b);
        }
        auto const of_all = of_all_ranks(communicator_, leaving_);
        coming_.clear();
        for (std::size_t r = 0; r < ranks; ++r) coming_.push_back(of_all[r * ranks + std::size_t(rank)]);
    }
    /// Then blocks are swapped, with their items, these in their order, and their sums; see swap_items().
    template <class Layer, class Fields>
    void swap_blocks(std::uint32_t first, Layer const& layer, Fields const& fields)
    {
        if (this->blocks() == 0) return;
        cuda::OnDevice const here(this->queue_);
        auto const came = static_cast<std::uint32_t>(coming());
        std::uint32_t const gone = std::accumulate(leaving_.begin(), leaving_.end(), std::uint32_t{0});
        this->stay_all();
        auto tiles = layer.swap_of_tiles(blocks_out_, blocks_in_);
        swap_(communicator_,
              {this->begin_.data(), this->committed_ ? nullptr : this->order_.data(),
               this->changes().block_stay},
              blocks_out_, items_, leaving_, coming_, fields, tiles);
        tiles.unpack();
        expect_arrivals(0, came); // no leavers are listed
        swap_.unpack(coming_, first, fields, all_leavers(), origins_.data(), this->changes());
        this->find_block_begins();
        divide_owners();
        write_order(first + came - gone, {});
        this->stay_all();
        places_ = first + came;
        fill_holes(fields);
        forget_strays();
        knows_live_here_ = false;
        this->queue_.wait(); // lists of tiles are about to be freed
    }
    /// They have been taken with the blocks.
    template <class Layer>
    void take_tiles(Layer const&) const
    {}

    std::size_t memory() const
    {
        return Owned::memory() + origins_.memory() + rooms_.memory() + swap_.memory();
    }

private:
    using Shape = cuda::BlockShape<d>;
    using typename Owned::Searched, typename Owned::Stray;
    using AllLeavers = cuda::detail::LeaversOfDevices<Number>;
    using Owned::are_crowded, Owned::are_swapped_, Owned::coming_, Owned::communicator_, Owned::count_,
        Owned::downloaded, Owned::divide_owners, Owned::forget_strays, Owned::items_, Owned::keep_owners,
        Owned::knows_live_here_, Owned::leaving_, Owned::live_is_known_, Owned::may_be_crowded,
        Owned::owners_, Owned::searched_, Owned::strays_, Owned::strays_of_all_;

    AllLeavers all_leavers() { return leavers_from(first_that_came_); }
    /// Those that have come are listed from `first` on.
    AllLeavers leavers_from(std::size_t first)
    {
        return {this->leavers(), static_cast<std::uint32_t>(first), origins_.data(),
                this->order_before_.data()};
    }
    /// Makes room for what comes from other ranks, and is listed from `first` on.
    void expect_arrivals(std::size_t first, std::uint32_t count)
    {
        this->leavers_.grow(first + count, this->channels_);
        make_room_for_arrivals(first, count);
        if (count > 0) origins_.renew_amply(count);
    }
    /// The same where they are listed already.
    void make_room_for_arrivals(std::size_t first, std::uint32_t count)
    {
        first_that_came_ = static_cast<std::uint32_t>(first);
        // room for as many, so that these grow as seldom
        listed_ = static_cast<std::uint32_t>(std::max(first + count, this->leavers_.most));
        this->order_before_.renew(listed_);
        this->arrived_.renew(listed_);
    }
    /// Lets the device know for how many strays messages have had room.
    void tell_rooms()
    {
        int const ranks = communicator_.size();
        std::vector<std::uint32_t> rooms;
        for (int from = 0; from < ranks; ++from)
            for (int to = 0; to < ranks; ++to) rooms.push_back(this->room_of_packed_(from, to));
        if (rooms == told_rooms_) return;
        told_rooms_ = rooms;
        // The host has not waited yet since they were copied last, but since they were the time before.
        is_first_half_ = !is_first_half_;
        auto* const here =
            rooms_here_.template as<std::uint32_t>(2 * rooms.size()) + (is_first_half_ ? 0 : rooms.size());
        std::ranges::copy(rooms, here);
        rooms_.renew(rooms.size());
        cuda::copy_queued(this->queue_, rooms_.data(), static_cast<std::uint32_t const*>(here), rooms.size());
    }
    /// Forgets what has been taken in: leavers search for their new cells once more.
    void search_anew()
    {
        cuda::OnDevice const here(this->queue_);
        cuda::launch_behind("forget_all_incoming", this->queue_, cuda::detail::forget_all_incoming,
                            this->blocks(), 64, 0, this->signal(),
                            cuda::detail::ArrivalsToForget{this->changes(), this->blocks(), nullptr});
        this->queue_search();
    }

    /// Sorts all items into the new order, of which there are `count`.
    void sort_in(std::uint32_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        this->rate_of_births_.count_step();
        this->rebinned_blocks_ = this->blocks();
        write_order(count, offset);
    }
    /// Writes the new order of those that stay in their cells and those that come in. It is known where
    /// blocks begin.
    void write_order(std::uint32_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
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
        std::vector<unsigned char> holds_items(blocks, 0);
        for (auto const block : of_all_ranks(communicator_, downloaded(this->blocks_before_, here)))
            holds_items[block] = 1;
        std::vector<std::uint32_t> all;
        for (std::uint32_t b = 0; b < blocks; ++b)
            if (holds_items[b] != 0) all.push_back(b);
        this->blocks_before_.upload(0, all);
        this->forget_empty_blocks(static_cast<std::uint32_t>(all.size()));
        this->stay_all(); // loops leave the blocks of other ranks as they are
        keep_owners(all);
    }

    std::uint32_t places_ = 0;          ///< items lie at some of so many places; 0: there are no holes
    std::uint32_t listed_ = 0;          ///< room for leavers and those that came from other ranks
    std::uint32_t first_that_came_ = 0; ///< the first of these among them
    std::vector<std::vector<std::uint32_t>> blocks_out_, blocks_in_;           ///< by rank: what is swapped
    std::vector<typename SwapOfItems<Number, d>::TravellingArray> travelling_; ///< of items that have moved
    std::size_t room_for_places_ = 0;                                          ///< in these
    std::size_t room_in_ = 0; ///< for items in messages that have been packed early and come here
    bool is_next_ = false;    ///< they are to be taken in
    bool are_in_ = false;     ///< that has been queued
    std::vector<std::uint32_t> told_rooms_; ///< of all such messages
    cuda::HostMemory rooms_here_;           ///< on the way to the device: one half, and then the other
    bool is_first_half_ = false;            ///< so was the one that was used last
    cuda::Array<std::uint32_t> rooms_, left_behind_;
    SwapOfItems<Number, d> swap_;
    cuda::Array<std::uint64_t> origins_; ///< of what came
};

} // namespace firn::distributed
