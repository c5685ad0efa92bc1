// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_begins.hpp>
#include <firn/cuda/block_set.hpp>
#include <firn/cuda/cell_arrays.hpp>
#include <firn/cuda/empty_blocks.hpp>
#include <firn/cuda/finish_step.hpp>
#include <firn/cuda/host_signal.hpp>
#include <firn/cuda/migration_arrays.hpp>
#include <firn/cuda/new_order.hpp>
#include <firn/cuda/tuning.hpp>

#include <algorithm>
#include <utility>
#include <vector>

namespace firn::cuda
{

/// The order of cells on a device: items by block, in a block cell by cell.
///
/// Items are not moved: `order` says where they lie. Blocks that have lost all of their items stay until
/// there are too many of them.
template <class Number, int d>
class CellOrder : public CellArrays<Number, d>
{
    using Arrays = CellArrays<Number, d>;

public:
    using Arrays::blocks, Arrays::signal, Arrays::changes;
    using typename Arrays::Offset, typename Arrays::Leavers;
    using Shape = BlockShape<d>;

    /// Cells beyond this coordinate have no key (see block_key); one more is kept in reserve for items about
    /// to leave.
    static constexpr double largest_coordinate = d == 3 ? 4.0e6 : 1.0e9;
    /// Bytes per item: where it lies, and whether it left its cell.
    static constexpr std::size_t bytes_per_item = sizeof(std::uint32_t) + 1;

    /// The cells as loops see them.
    struct View
    {
        std::uint64_t const* keys;  ///< of blocks
        std::uint32_t const* begin; ///< of the items of each cell, in the order
        std::uint32_t const* order; ///< where the items of a cell lie

        __device__ Coordinates<d> cell(std::uint32_t c) const
        {
            Coordinates<d> const block = block_of_key<d>(keys[c / Shape::cells]);
            return block * int{Shape::extent} + Shape::cell(static_cast<int>(c % Shape::cells));
        }
        /// The block on whose items a group of threads works. Where several devices share the cells, each has
        /// its part.
        __device__ static constexpr std::uint32_t block(std::uint32_t group) { return group; }
        /// Whether the loop that moves items forgets those that came last: if none come in until it ends.
        static constexpr bool forgets_incoming = false;
    };

    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : Arrays(backend.queue(), periods.in_blocks(extent))
    {}

    /// The cells of a block along an axis, of which a period is a multiple.
    static constexpr int extent(int) { return Shape::extent; }

    /// How many groups of threads work on the items of the first so many blocks.
    static std::uint32_t groups(std::uint32_t of_blocks) { return of_blocks; }
    View view() const { return {set_.keys(), begin_.data(), order_.data()}; }

    /// Adds items that lie at first, first + 1, … in the given cells.
    void insert(Coordinates<d> const* cells, std::size_t number, std::uint32_t first)
    {
        insert(cells, number, first, [&] { return set_.births(); });
    }
    /// The same, where `births()` returns how many blocks have been found missing.
    template <class Births>
    void insert(Coordinates<d> const* cells, std::size_t number, std::uint32_t first, Births const& births_of)
    {
        OnDevice const here(queue_);
        auto const count = static_cast<std::uint32_t>(number);
        LeaverArrays fresh(queue_);
        fresh.renew(count, 0);
        signal();
        if (blocks() == 0) set_.reserve(BlockSet::few);
        may_have_arrived_ = true;
        for (;;) { // again if blocks were missing
            stay_all();
            if (count > 0)
                launch_after("find_cells", queue_, detail::find_cells<d, Number>, groups_of(count, 256), 256,
                             fresh.view(0), cells, first, count, changes(), set_.view(), periods_);
            std::uint32_t const births = births_of();
            if (births == 0) break;
            add_blocks(births);
        }
        if (blocks() == 0) return;
        find_block_begins();
        rearrange(fresh.view(0), count, nullptr, {}, size_ + count);
        arrived_.clear(); // every new item was in this list; free it
    }

    /// Erases the items for which `gone[where it lies]` is not 0. The other `kept` ones will lie at
    /// `place[where it lies]` and keep their order.
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        if (blocks() == 0) return;
        OnDevice const here(queue_);
        signal();
        launch_after("leave", queue_, detail::leave, blocks(), 64, begin_.data(),
                     committed_ ? nullptr : order_.data(), gone, changes(), left_.data());
        find_block_begins();
        LeaverArrays none(queue_);
        none.renew(0, 0);
        rearrange(none.view(0), 0, left_.data(), {}, size_);
        if (kept > 0) {
            auto const count = static_cast<std::uint32_t>(kept);
            launch_after("renumber", queue_, detail::renumber, groups_of(count, 256), 256, order_.data(),
                         count, place);
        }
        size_ = kept;
        queue_.wait(); // buffers in use are about to be freed
    }

    /// Moves the leavers to their new cells, and wraps their offsets. An item lies at its slot (see commit).
    void rebin(std::array<Offset*, d> const& offset)
    {
        if (blocks() == 0) return;
        OnDevice const here(queue_);
        rate_of_births_.count_step();
        rebinned_blocks_ = blocks();
        rearrange(leavers_.view(channels_), static_cast<std::uint32_t>(leavers_.most), left_.data(), offset,
                  size_);
        kept_order_ = false;
        if (crowded_) forget_empty_blocks(list_live_blocks());
        crowded_ = false;
    }

    /// The same: since loops are queued, no part of it need be left to the next loop.
    void begin_rebin(std::array<Offset*, d> const& offset) { rebin(offset); }

    /// How many blocks there were at the last rebin, before empty ones were removed.
    std::uint32_t rebinned_blocks() const { return rebinned_blocks_; }

    /// Whether a step takes less time than a round trip to the host: few blocks, most of them well filled.
    /// Then blocks are created ahead of the missing ones, three deep, and more empty ones are kept.
    bool is_small() const { return blocks() <= 128 && size_ >= std::size_t(32) * blocks(); }

    /// Whether a device works on all blocks at once, because they are few. Then leavers find their new cells
    /// as they leave, and items are rebinned before it is known whether the step succeeded.
    bool rebins_early() const { return !compiled_soon && !has_many_blocks(); }
    bool has_many_blocks() const { return blocks() > 1024; }

    /// Whether the host creates the blocks around those that were missing, too: in a scene that spreads, and
    /// has so many blocks that a few more do not change how many teams work on each.
    bool spreads() const { return rate_of_births_.spreads() && has_many_blocks(); }

    /// The same while one group of threads calls `finish`. What `scatter(cells, arrived)` returns is called
    /// for each block by `teams` teams (see detail::finish_and_rearrange) with so much shared memory. Keeps
    /// the previous order for rollback().
    template <class Finish, class Scatter>
    void rebin_early(std::array<Offset*, d> const& offset, Finish const& finish, Scatter const& scatter,
                     unsigned teams, std::size_t shared)
    {
        OnDevice const here(queue_);
        rate_of_births_.count_step();
        rebinned_blocks_ = blocks();
        order_before_.renew(size_);
        new_begin_.renew(blocks() * Shape::cells + 1);
        arrived_begin_.renew(new_begin_.size());
        arrived_.renew(leavers_.most);
        detail::NewOrder const to{
            nullptr,         left_.data(),         new_begin_.data(),   arrived_begin_.data(),
            arrived_.data(), order_before_.data(), leavers_.cell.data()};
        auto const then = scatter(view(), arrived());
        using Then = std::remove_cv_t<decltype(then)>;
        std::uint32_t const number = signal_.next_number();
        launch_behind("finish_and_rearrange", queue_, detail::finish_and_rearrange<d, Number, Finish, Then>,
                      1 + blocks(), teams * 64, std::max(shared, Finish::bytes), moved(), number,
                      begin_.data(), to, offset, finish, then);
        std::swap(begin_, new_begin_);
        std::swap(order_, order_before_);
        kept_order_ = true;
        committed_ = false;
    }
    /// Undoes so many `commits` and `rebins` on the host, for steps that were queued and then not run, or
    /// rebinned early. If there is one rebin more, items then lie at their slots, and the first of the rebins
    /// wrapped the leavers' offsets in `offset`, which are unwrapped. If there are as many of both, the
    /// offsets that it wrapped belong to a failed step and are not read again.
    void rollback(int commits, int rebins, std::array<Offset*, d> const& offset)
    {
        rate_of_births_.undo_steps(rebins);
        if (rebins % 2 != 0) {
            std::swap(begin_, new_begin_);
            if (kept_order_) std::swap(order_, order_before_);
        }
        committed_ = rebins > commits;
        if (!committed_ || !kept_order_) return;
        OnDevice const here(queue_);
        launch_after("unwrap", queue_, detail::unwrap<d, Number>, groups_of(leavers_.most, 256), 256,
                     leavers_.view(channels_), offset);
        find_block_begins(); // for the next rebin(): when rebinning early each block found its own
    }

    /// Makes room for leavers, and forgets the last ones. The loop behind this call lists leavers, and finds
    /// their cells.
    Leavers expect_outgoing(int channels)
    {
        OnDevice const here(queue_);
        channels_ = channels;
        crowded_ = false; // it may stem from a step that was not taken
        leavers_.renew(std::max<std::size_t>(leavers_.most, size_ / 32 + 256), channels);
        if (may_have_arrived_)
            launch_behind("forget_all_incoming", queue_, detail::forget_all_incoming, blocks(), 64, 0,
                          signal(), detail::ArrivalsToForget{changes(), blocks(), leavers_.counters.data()});
        may_have_arrived_ = true;
        is_to_find_ = !destinations().at_once;
        return leavers_.view(channels);
    }
    detail::Destinations<d> destinations()
    {
        return {changes(), set_.view(), set_.keys(), periods_, is_small() ? 3 : 0, rebins_early()};
    }

    /// What a loop of `groups` groups of threads needs in order to clear the incoming items on its way,
    /// before new ones are listed. The caller must queue that loop. Blocks that were created in a step that
    /// then failed have no nodes yet, so a loop over nodes may have too few groups and clears nothing.
    detail::ArrivalsToForget forget_incoming_on_the_way(std::uint32_t groups)
    {
        bool const does = groups >= blocks() && std::exchange(may_have_arrived_, false);
        return {changes(), does ? blocks() : 0, leavers_.counters.data()};
    }

    /// What the loop that ends a step needs. The caller must queue that loop.
    detail::MovedOrder<d, Number> moved()
    {
        OnDevice const here(queue_);
        return {signal(),       leavers_.view(channels_),
                destinations(), std::exchange(is_to_find_, false),
                begins(),       is_small(),
                spreads()};
    }
    /// How many groups of threads that loop takes to find new cells.
    unsigned groups_that_find() const
    {
        return is_to_find_ ? std::min(groups_of(leavers_.most, detail::scanning_threads), 256u) : 1;
    }

    /// Waits until at most two of the queued steps, those of rebin_early(), are still to come; false if steps
    /// have stopped (see HostSignal).
    bool throttle() const { return signal_.throttle(); }

    /// Called when the host has waited: lets loops work again if they have stopped; true if they stopped
    /// because there was no room for all leavers.
    bool poll()
    {
        short_ = signal_.poll();
        if (short_.stopped == 0) return false;
        may_have_arrived_ = true; // even if the loop that clears them was queued
        crowded_ = short_.crowded != 0;
        return short_.births > 0 || short_.leavers > leavers_.most;
    }

    /// Makes room where it lacked; if blocks were created, all leavers search for their cells again. True if
    /// the loop that moves items must be repeated.
    bool make_room()
    {
        OnDevice const here(queue_);
        if (short_.leavers > leavers_.most) {
            leavers_.most = short_.leavers + short_.leavers / 32;
            return true;
        }
        if (short_.births == 0) return false;
        add_blocks(with_those_around(short_.births));
        is_to_find_ = true;
        return false;
    }

    /// The items that came into each cell at the last rebin: the list of leavers by cell.
    struct Arrived
    {
        std::uint32_t const* begin;   ///< of each cell's range in the list
        std::uint32_t const* arrived; ///< indices of leavers
    };
    Arrived arrived() const { return {arrived_begin_.data(), arrived_.data()}; }
    Leavers leavers() const { return leavers_.view(channels_); }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item, on the host.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        if (size_ == 0) return;
        std::vector<std::uint32_t> begin(blocks() * Shape::cells + 1), order(committed_ ? 0 : size_);
        std::vector<std::uint64_t> keys(blocks());
        begin_.download(0, begin);
        order_.download(0, order);
        set_.download_keys(keys);
        detail::for_each_item<d>(keys, begin, order, visit);
    }

protected: // for an order that several devices share
    using typename Arrays::LeaverArrays;

    /// Where blocks were missing in a step of a scene that spreads, requests those around, too. Returns how
    /// many there are in all.
    std::uint32_t with_those_around(std::uint32_t births)
    {
        rate_of_births_.count_births();
        if (!spreads()) return births;
        return detail::missing_around<d>(queue_, set_, begin_.data(), periods_);
    }

    using Arrays::begin_, Arrays::new_begin_, Arrays::order_, Arrays::order_before_, Arrays::committed_,
        Arrays::size_, Arrays::queue_, Arrays::periods_, Arrays::set_, Arrays::left_, Arrays::changes_,
        Arrays::arrived_begin_, Arrays::arrived_, Arrays::leavers_, Arrays::signal_,
        Arrays::may_have_arrived_;
    using Arrays::begins, Arrays::find_block_begins, Arrays::stay_all, Arrays::add_blocks,
        Arrays::list_live_blocks, Arrays::forget_empty_blocks, Arrays::rearrange;

    bool kept_order_ = false; ///< the last rebin kept the previous order
    std::uint32_t rebinned_blocks_ = 0;
    int channels_ = 0;
    detail::Stop short_{}; ///< what was reported last
    detail::RateOfBirths rate_of_births_;
    bool crowded_ = false;    ///< many blocks hold no items
    bool is_to_find_ = false; ///< the leavers have yet to find their new cells
};

} // namespace firn::cuda
