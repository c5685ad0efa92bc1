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
        : Owned(backend, periods), list_(backend), swap_(backend.queue()), origins_(backend)
    {}

    /// Swaps the items that leave for other ranks and come from there, and sorts all of them in, without the
    /// host. `fields.by_place(use)` calls `use(array)` for each array of the items. These have room for
    /// `first` items that were here and for coming() more; `offset` are some of them. `fields.by_id(use)`
    /// does so for arrays whose elements are found by what fields.ids() have of the items.
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
    void relocate(std::uint32_t first, std::uint32_t const* place)
    {
        for (auto const& [where, count] : {std::pair{this->order_.data(), this->size()},
                                           std::pair{this->leavers_.slot.data(), std::size_t{listed_}}})
            if (count > 0)
                cuda::launch_after("relocate", this->queue_, cuda::detail::relocate,
                                   cuda::groups_of(count, std::size_t{256} * cuda::detail::relocated_at_once),
                                   256, where, count, first, place);
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
        searched_ = {}; // no leavers are listed
        this->stay_all();
        auto tiles = layer.swap_of_tiles(blocks_out_, blocks_in_);
        swap_(communicator_,
              {this->begin_.data(), this->committed_ ? nullptr : this->order_.data(),
               this->changes().block_stay},
              blocks_out_, items_, leaving_, coming_, fields, tiles);
        tiles.unpack();
        expect_arrivals(came, first);
        swap_.unpack(coming_, first, fields, {origins_.data(), list_.data(), nullptr});
        let_in(came);
        divide_owners();
        write_order(first + came - gone, {});
        this->stay_all();
        swap_.fill_holes(first + came, first + came - gone, fields,
                         [&](std::uint32_t const* place) { relocate(first + came - gone, place); });
        listed_ = 0;
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
        return Owned::memory() + list_.memory() + origins_.memory() + swap_.memory();
    }

private:
    using Shape = cuda::BlockShape<d>;
    using typename Owned::Searched, typename Owned::Stray;
    using AllLeavers = cuda::detail::LeaversOfDevices<Number>;
    using Owned::are_crowded, Owned::coming_, Owned::communicator_, Owned::count_, Owned::downloaded,
        Owned::divide_owners, Owned::forget_strays, Owned::items_, Owned::keep_owners,
        Owned::knows_live_here_, Owned::leaving_, Owned::live_is_known_, Owned::may_be_crowded,
        Owned::owners_, Owned::searched_, Owned::strays_, Owned::strays_of_all_;

    AllLeavers all_leavers()
    {
        return {this->leavers(), searched_.leavers, origins_.data(), this->order_before_.data()};
    }
    /// Makes room for what comes from other ranks, from place `first` on.
    void expect_arrivals(std::uint32_t count, std::uint32_t first)
    {
        listed_ = searched_.leavers + count;
        first_that_came_ = first;
        this->leavers_.grow(listed_, this->channels_);
        // room for as many, so that these grow as seldom
        this->order_before_.renew(this->leavers_.most);
        this->arrived_.renew(this->leavers_.most);
        if (count == 0) return;
        origins_.renew_amply(count);
        list_.renew_amply(count);
    }
    /// Lets that into its cells, which are listed.
    void let_in(std::uint32_t count)
    {
        if (count == 0) return;
        cuda::launch_after("admit", this->queue_, cuda::detail::admit<Number>, cuda::groups_of(count, 256),
                           256, all_leavers(), count, first_that_came_, list_.data(), this->changes());
    }
    /// Sorts all items into the new order, of which there are `count`.
    void sort_in(std::uint32_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        this->rate_of_births_.count_step();
        this->rebinned_blocks_ = this->blocks();
        write_order(count, offset);
    }
    /// Writes the new order of those that stay in their cells and those that come in.
    void write_order(std::uint32_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        this->find_block_begins();
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

    std::uint32_t listed_ = 0;          ///< leavers, and those that came from other ranks
    std::uint32_t first_that_came_ = 0; ///< where the first of these lies
    std::vector<std::vector<std::uint32_t>> blocks_out_, blocks_in_; ///< by rank: what is swapped
    cuda::Array<std::uint32_t> list_;
    SwapOfItems<Number, d> swap_;
    cuda::Array<std::uint64_t> origins_; ///< of what came
};

} // namespace firn::distributed
