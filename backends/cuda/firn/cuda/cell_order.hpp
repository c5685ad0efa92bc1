// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/order.hpp>

#include <algorithm>
#include <bit>
#include <chrono>
#include <limits>
#include <span>
#include <utility>
#include <vector>

namespace firn::cuda
{

/// The order of cells on a device: items by block, in a block by group of 32 cells, in a group interleaved by
/// rank.
///
/// First come the first items of the group's cells, then the second ones, and so on, so that lane l of a warp
/// can work on cell l and read one run of memory. Items are not moved: `order` says, cell by cell, where they
/// lie. Blocks that have lost all of their items stay until there are too many of them.
template <class Number, int d>
class CellOrder
{
public:
    using Shape = BlockShape<d>;
    using Offset = typename CellOffset<Number>::Stored;
    using Leavers = detail::Leavers<Number>;

    /// Cells beyond this coordinate have no key (see block_key); one is kept in reserve for what is about to
    /// leave.
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
    };

    template <class Backend>
    explicit CellOrder(Backend const& backend)
        : queue_(backend.queue()), set_(queue_), begin_(queue_), new_begin_(queue_), order_(queue_),
          order_before_(queue_), left_(queue_), stay_(queue_), incoming_(queue_), first_incoming_(queue_),
          group_left_(queue_), block_stay_(queue_), block_arrived_(queue_), block_begin_(queue_),
          arrived_begin_(queue_), arrived_(queue_), leavers_(queue_), blocks_before_(queue_),
          stopped_(queue_), told_(queue_)
    {}

    Queue const& queue() const { return queue_; }
    std::size_t size() const { return size_; }
    std::uint32_t blocks() const { return set_.size(); }
    View view() const { return {set_.keys(), begin_.data(), order_.data()}; }

    std::size_t memory() const
    {
        return set_.memory() + begin_.memory() + new_begin_.memory() + order_.memory() +
               order_before_.memory() + left_.memory() + stay_.memory() + incoming_.memory() +
               first_incoming_.memory() + group_left_.memory() + block_stay_.memory() +
               block_arrived_.memory() + block_begin_.memory() + arrived_begin_.memory() + arrived_.memory() +
               leavers_.memory() + blocks_before_.memory();
    }

    /// Adds items that lie at first, first + 1, … in the given cells.
    void insert(std::span<Coordinates<d> const> cells, std::uint32_t first)
    {
        OnDevice const here(queue_);
        auto const count = static_cast<std::uint32_t>(cells.size());
        using Place = std::array<int, d>;
        static_assert(sizeof(Place) == sizeof(Coordinates<d>));
        Array<Place> where(queue_);
        where.resize(cells.size());
        where.upload(0, {reinterpret_cast<Place const*>(cells.data()), cells.size()});
        MoverArrays fresh(queue_);
        fresh.renew(count, 0);
        signal();
        if (blocks() == 0) set_.reserve(BlockSet::few);
        may_have_arrived_ = true;
        for (;;) { // once more if there are blocks to be born
            stay_all();
            launch_after("find_cells", queue_, detail::find_cells<d, Number>, groups_of(count, 256), 256,
                         fresh.view(0), where.data(), first, count, changes(), set_.view());
            std::uint32_t const births = set_.births();
            if (births == 0) break;
            bear_blocks(births);
        }
        find_block_begins();
        rearrange(fresh.view(0), count, nullptr, {});
        arrived_.clear(); // every new item was in this list; it need not stay so large
    }

    /// Forgets the items for which `gone[where it lies]` is not 0, `kept` being the others, which will lie at
    /// `place[where it lies]`; they keep their order.
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        if (blocks() == 0) return;
        OnDevice const here(queue_);
        signal();
        launch_after("leave", queue_, detail::leave, blocks(), 64, begin_.data(),
                     settled_ ? nullptr : order_.data(), gone, changes(), left_.data());
        find_block_begins();
        MoverArrays none(queue_);
        none.renew(0, 0);
        rearrange(none.view(0), 0, left_.data(), {});
        if (kept > 0) {
            auto const count = static_cast<std::uint32_t>(kept);
            launch_after("renumber", queue_, detail::renumber, groups_of(count, 256), 256, order_.data(),
                         count, place);
        }
        size_ = kept;
        queue_.wait(); // for what is about to be given back
    }

    /// Moves the items that departed to their new cells, and wraps their offsets. An item lies at its slot
    /// (see settle).
    void rebin(std::array<Offset*, d> const& offset)
    {
        if (blocks() == 0) return;
        OnDevice const here(queue_);
        offset_ = offset;
        followed_blocks_ = blocks();
        rearrange(leavers_.view(channels_), leavers_.most, left_.data(), offset);
        kept_order_ = false;
        if (crowded_) forget_empty_blocks();
        crowded_ = false;
    }

    /// The same: who queues loops need not leave any of it to the next one.
    void begin_rebin(std::array<Offset*, d> const& offset) { rebin(offset); }

    /// How many blocks there were when items were followed, and empty ones not yet forgotten.
    std::uint32_t followed_blocks() const { return followed_blocks_; }

    /// Whether a step takes less time than the host that listens: few blocks, most of them well filled. Then
    /// blocks are born ahead of those that are wanted, three deep, and more empty ones are kept.
    bool is_small() const { return blocks() <= 128 && size_ >= std::size_t(32) * blocks(); }

    /// Whether there are so few blocks that a device has them all at work at once: then who departs finds its
    /// new cell at once, and items are followed while it is yet to be found out how the step went.
    bool rebins_early() const { return blocks() <= 1024; }

    /// The same while one group of threads calls `conclude`. What `give(cells, arrived)` returns is called
    /// for each block by so many teams (see detail::conclude_and_rearrange) with so much shared memory. The
    /// order before is kept, for take_back().
    template <class Finish, class Give>
    void rebin_early(std::array<Offset*, d> const& offset, Finish const& finish, Give const& scatter,
                     unsigned teams, std::size_t shared)
    {
        OnDevice const here(queue_);
        offset_ = offset;
        followed_blocks_ = blocks();
        order_before_.renew(size_);
        new_begin_.renew(blocks() * Shape::cells + 1);
        arrived_begin_.renew(new_begin_.size());
        arrived_.renew(leavers_.most);
        detail::NewOrder const to{
            nullptr,         left_.data(),         new_begin_.data(),   arrived_begin_.data(),
            arrived_.data(), order_before_.data(), leavers_.cell.data()};
        auto const then = scatter(view(), arrived());
        using Then = std::remove_cv_t<decltype(then)>;
        std::uint32_t const number = early_ = early_ % (1u << 31) + 1;
        launch_behind("finish_and_rearrange", queue_, detail::finish_and_rearrange<d, Number, Finish, Then>,
                      1 + blocks(), teams * 64, std::max(shared, Finish::bytes), moved(), number,
                      begin_.data(), to, offset, finish, then);
        std::swap(begin_, new_begin_);
        std::swap(order_, order_before_);
        kept_order_ = true;
        settled_ = false;
    }
    /// Undoes the last calls of follow(), on the host, where it was queued and then not done, or done early;
    /// and says whether items lie at their slots. Then the first of these calls was for items of which these
    /// are the offsets. (Else it was for items of a step that went wrong, which nobody looks at.)
    void rollback(int follows, bool settled, std::array<Offset*, d> const& offset)
    {
        if (follows % 2 != 0) {
            std::swap(begin_, new_begin_);
            if (kept_order_) std::swap(order_, order_before_);
        }
        settled_ = settled;
        if (!settled || !kept_order_) return;
        OnDevice const here(queue_);
        launch_after("unwrap", queue_, detail::unwrap<d, Number>, groups_of(leavers_.most, 256), 256,
                     leavers_.view(channels_), offset);
        find_block_begins(); // for the next follow(): each block had found its own
    }

    /// How many times empty blocks were forgotten, and which blocks were there before: by their new numbers.
    std::uint32_t generation() const { return generation_; }
    std::uint32_t const* blocks_before() const { return blocks_before_.data(); }
    std::uint32_t blocks_kept() const { return blocks_kept_; } ///< so many have one; others are younger

    /// Makes room for items that depart, and forgets those before: the loop that follows notes them, and
    /// finds their cells.
    Leavers expect_outgoing(int channels)
    {
        OnDevice const here(queue_);
        channels_ = channels;
        crowded_ = false; // if it was said of a step that was then not made
        leavers_.renew(std::max<std::size_t>(leavers_.most, size_ / 32 + 256), channels);
        if (may_have_arrived_)
            launch_behind("forget_all_incoming", queue_, detail::forget_all_incoming, blocks(), 64, 0,
                          signal(), detail::ArrivalsToForget{changes(), blocks(), leavers_.meet.data()});
        may_have_arrived_ = true;
        is_to_find_ = !destinations().at_once;
        return leavers_.view(channels);
    }
    unsigned char* left() { return left_.data(); }
    detail::Changes changes()
    {
        return {stay_.data(),       incoming_.data(),   first_incoming_.data(),
                group_left_.data(), block_stay_.data(), block_arrived_.data()};
    }
    detail::Destinations destinations()
    {
        return {changes(), set_.view(), set_.keys(), is_small() ? 3 : 0, rebins_early()};
    }

    /// Who came into cells is to be forgotten before others do: what a loop of so many groups of threads is
    /// to know that does so on its way. It is expected to be queued. (Blocks that are born in a step that
    /// then goes wrong have no nodes yet: a loop over those has too few groups.)
    detail::ArrivalsToForget forget_incoming_on_the_way(std::uint32_t groups)
    {
        bool const does = groups >= blocks() && std::exchange(may_have_arrived_, false);
        return {changes(), does ? blocks() : 0, leavers_.meet.data()};
    }

    /// What the loop that ends a step is to know. It is expected to be queued.
    detail::MovedOrder<d, Number> moved()
    {
        OnDevice const here(queue_);
        return {signal(),       leavers_.view(channels_),
                destinations(), std::exchange(is_to_find_, false),
                begins(),       is_small()};
    }
    /// How many groups of threads it takes to find what is then to be found.
    unsigned groups_that_find() const
    {
        return is_to_find_ ? std::min(groups_of(leavers_.most, detail::scanning_threads), 256u) : 1;
    }

    /// Says to loops whether they have something to do.
    detail::Signal signal()
    {
        if (stopped_.size() == 0) {
            OnDevice const here(queue_);
            stopped_.renew(detail::Signal::count);
            stopped_.fill_bytes(0, detail::Signal::count, 0);
            told_.template as<detail::Told>();
        }
        return std::as_const(*this).signal();
    }
    detail::Signal signal() const ///< once there are items
    {
        return {const_cast<std::uint32_t*>(stopped_.data()), told_.template get<detail::Told>()};
    }

    /// Waits until no more than a few of the steps that were queued are still to come, for which
    /// follow_early() was called; false if they have stopped: what is queued behind that is queued in vain.
    /// After a hundredth of a second it is not worth while to wait: steps are long, or a device has failed,
    /// which the next call of it tells.
    bool throttle() const
    {
        constexpr std::uint32_t few = 2;
        using Clock = std::chrono::steady_clock;
        auto const* const told = told_.template get<detail::Told>();
        auto const now = [](std::uint32_t const& word) { // others write it
            return *static_cast<std::uint32_t const volatile*>(&word);
        };
        Clock::time_point end{};
        for (unsigned tries = 1; now(told->stop.stopped) == 0; ++tries) {
            if (early_ - now(told->chosen) <= few) return true;
            if (tries % 1024 != 0) continue;
            if (tries == 1024) end = Clock::now() + std::chrono::milliseconds(10);
            if (Clock::now() >= end) return true;
        }
        return false;
    }

    /// When the host has waited: lets loops work again if they have stopped, and says whether they did so
    /// because there was no room for all that moved.
    bool poll()
    {
        auto* const told = told_.template as<detail::Told>();
        told->chosen = early_; // what was stopped did not
        short_ = told->stop;
        if (short_.stopped == 0) return false;
        told->stop = {};
        may_have_arrived_ = true; // whatever was queued to forget them
        stopped_.fill_bytes(0, detail::Signal::count, 0);
        crowded_ = short_.crowded != 0;
        return short_.births > 0 || short_.departed > leavers_.most;
    }

    /// Makes room for what lacked it; those that departed are to find their cells once more, if there are new
    /// ones. True if the loop that moves items is to be repeated.
    bool make_room()
    {
        OnDevice const here(queue_);
        if (short_.departed > leavers_.most) {
            leavers_.most = short_.departed + short_.departed / 32;
            return true;
        }
        if (short_.births == 0) return false;
        bear_blocks(short_.births);
        is_to_find_ = true;
        return false;
    }

    /// The items that came into each cell when the order was written: as movers, and their list.
    struct Arrived
    {
        std::uint32_t const* begin;    ///< of those of each cell, in the list
        std::uint32_t const* arrived;  ///< numbers of movers
        std::array<Offset*, d> offset; ///< of all items
    };
    Arrived arrived() const { return {arrived_begin_.data(), arrived_.data(), offset_}; }
    Leavers leavers() const { return leavers_.view(channels_); }

    /// Says that all items now lie at their slots.
    void commit() { settled_ = true; }
    bool settled() const { return settled_; }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item, on the host.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        if (size_ == 0) return;
        std::vector<std::uint32_t> begin(blocks() * Shape::cells + 1), order(settled_ ? 0 : size_);
        std::vector<std::uint64_t> keys(blocks());
        begin_.download(0, begin);
        order_.download(0, order);
        set_.download_keys(keys);
        std::size_t slot = 0;
        for (std::size_t group = 0; group < keys.size() * Shape::groups; ++group) {
            Coordinates<d> const block = block_of_key<d>(keys[group / Shape::groups]);
            std::uint32_t const* const first = &begin[group * Shape::lanes];
            std::size_t const end = first[Shape::lanes];
            for (std::uint32_t rank = 0; slot < end; ++rank)
                for (int lane = 0; lane < Shape::lanes; ++lane) {
                    if (first[lane] + rank >= first[lane + 1]) continue;
                    int const place = static_cast<int>(group % Shape::groups) * Shape::lanes + lane;
                    visit(settled_ ? slot : std::size_t{order[first[lane] + rank]},
                          Coordinates<d>(block * Shape::extent + Shape::cell(place)));
                    ++slot;
                }
        }
    }

private:
    struct MoverArrays
    {
        std::size_t most = 0;
        Array<detail::LeaverCounters> meet;
        Array<std::uint32_t> slot, cell, next;
        Array<std::uint8_t> way;
        Array<Number> contribution;

        explicit MoverArrays(Queue queue)
            : meet(queue), slot(queue), cell(queue), next(queue), way(queue), contribution(queue)
        {}

        void renew(std::size_t room, int channels)
        {
            most = room;
            if (meet.size() == 0) {
                meet.renew(1);
                meet.fill_bytes(0, 1, 0);
            }
            for (auto* const array : {&slot, &cell, &next}) make_room(*array, room);
            make_room(way, channels > 0 ? room : 0);
            make_room(contribution, room * static_cast<std::size_t>(channels));
        }

        /// For so many and not more: who asks has added what there is to spare.
        template <class T>
        static void make_room(Array<T>& array, std::size_t room)
        {
            if (room <= array.size()) return;
            array.clear();
            array.resize(room);
        }

        Leavers view(int channels) const
        {
            auto const at = []<class T>(Array<T> const& array) { return const_cast<T*>(array.data()); };
            return {const_cast<detail::LeaverCounters*>(meet.data()),
                    static_cast<std::uint32_t>(most),
                    channels,
                    at(slot),
                    at(cell),
                    at(way),
                    at(next),
                    const_cast<Number*>(contribution.data())};
        }

        std::size_t memory() const
        {
            return slot.memory() + cell.memory() + way.memory() + next.memory() + contribution.memory();
        }
    };

    /// Where the device writes where blocks begin.
    detail::BlockBegins begins()
    {
        block_begin_.resize(blocks());
        return {blocks(), block_begin_.data()};
    }

    void find_block_begins()
    {
        launch_after("find_all_block_begins", queue_, detail::find_all_block_begins, 1,
                     detail::scanning_threads, begins(), changes());
    }

    void stay_all()
    {
        std::uint32_t const cells = blocks() * Shape::cells;
        if (cells == 0) return;
        launch_after("stay_all", queue_, detail::stay_all, groups_of(cells, 256), 256, begin_.data(), cells,
                     changes());
    }

    /// Numbers the blocks that a loop found to be missing, or makes room for so many; forgets who arrived.
    void bear_blocks(std::uint32_t births)
    {
        std::uint32_t const before = blocks();
        require(births < (std::numeric_limits<std::uint32_t>::max() - 1) / Shape::cells - before,
                "there would have been more than 67 million blocks of cells that hold items", "CUDA",
                "Use larger cells, or several solvers.");
        if (set_.has_room_for(births))
            set_.number(births);
        else
            set_.reserve_more(births);
        std::uint32_t const cells = blocks() * Shape::cells;
        if (cells == 0) return;
        begin_.resize(std::size_t(cells) + 1);
        new_begin_.renew(begin_.size()); // loops that are stopped read it, too, but do not look at it
        new_begin_.fill_bytes(0, new_begin_.size(), 0);
        stay_.resize(cells);
        incoming_.resize(cells);
        first_incoming_.resize(cells);
        group_left_.resize(blocks() * Shape::groups);
        block_stay_.resize(blocks());
        block_arrived_.resize(blocks());
        launch_after("clear_cells", queue_, detail::clear_cells, groups_of(cells, 256), 256,
                     before * Shape::cells, cells, static_cast<std::uint32_t>(size_), begin_.data(),
                     changes());
    }

    /// Numbers the blocks that hold items anew, in the order in which they are.
    void forget_empty_blocks()
    {
        std::uint32_t const before = blocks();
        blocks_before_.renew(std::size_t(before) + 1); // and how many there are
        launch_after("find_live_blocks", queue_, detail::find_live_blocks, 1, detail::scanning_threads,
                     begin_.data(), before, blocks_before_.data(), blocks_before_.data() + before);
        std::uint32_t count = 0;
        blocks_before_.download(before, {&count, 1});
        new_begin_.renew(std::size_t(count) * Shape::cells + 1);
        auto& new_arrived_begin = first_incoming_; // those of this step have come
        may_have_arrived_ = true;
        new_arrived_begin.renew(new_begin_.size());
        launch_after("keep_blocks", queue_, detail::keep_blocks, count, 64, blocks_before_.data(),
                     begin_.data(), arrived_begin_.data(), new_begin_.data(), new_arrived_begin.data());
        std::swap(begin_, new_begin_);
        std::swap(arrived_begin_, new_arrived_begin);
        first_incoming_.renew(std::size_t(count) * Shape::cells);
        set_.keep(blocks_before_.data(), count);
        blocks_kept_ = count;
        ++generation_;
    }

    /// Writes the new order where blocks are known to begin: those that stay in their cells, and those that
    /// come, `count` at most.
    void rearrange(Leavers const& leavers, std::uint32_t count, unsigned char const* left,
                   std::array<Offset*, d> const& offset)
    {
        bool const comes_in = left == nullptr;
        std::size_t const items = size_ + (comes_in ? count : 0);
        new_begin_.renew(blocks() * Shape::cells + 1);
        arrived_begin_.renew(new_begin_.size());
        arrived_.renew(count);
        Array<std::uint32_t> next(queue_);
        bool const in_place = settled_;
        if (in_place)
            order_.resize(items);
        else
            next.resize(items);
        if (comes_in) left_.renew(items);

        detail::NewOrder const to{in_place ? nullptr : order_.data(),
                                  left,
                                  new_begin_.data(),
                                  arrived_begin_.data(),
                                  arrived_.data(),
                                  in_place ? order_.data() : next.data(),
                                  leavers.cell};
        launch_behind("rearrange", queue_, detail::rearrange<d, Number>, blocks(), 64, 0, signal(),
                      begin_.data(), changes(), block_begin_.data(), leavers, to, offset);
        std::swap(begin_, new_begin_);
        if (!in_place) std::swap(order_, next);
        size_ = items;
        if (comes_in || !in_place) queue_.wait(); // for what is about to be given back
        settled_ = false;
    }

    Queue queue_;
    std::size_t size_ = 0;
    bool settled_ = true;
    bool kept_order_ = false; ///< the last follow() kept the order before
    std::uint32_t early_ = 0; ///< number of the last that did
    std::uint32_t followed_blocks_ = 0;
    std::array<Offset*, d> offset_{}; ///< as they were last followed
    BlockSet set_;
    Array<std::uint32_t> begin_, new_begin_, order_, order_before_;
    Array<unsigned char> left_; ///< per slot: whether the item left its cell
    Array<std::uint32_t> stay_, incoming_, first_incoming_, group_left_, block_stay_, block_arrived_;
    Array<std::uint64_t> block_begin_;
    Array<std::uint32_t> arrived_begin_, arrived_;
    MoverArrays leavers_;
    int channels_ = 0;
    std::uint32_t generation_ = 0, blocks_kept_ = 0;
    Array<std::uint32_t> blocks_before_;
    Array<std::uint32_t> stopped_; ///< whether loops have nothing to do until the host has listened
    HostMemory told_;              ///< why, and how far they are
    detail::Stop short_{};         ///< what it said last
    bool crowded_ = false;         ///< many blocks hold no items
    bool is_to_find_ = false;      ///< who departed has yet to find its new cell
    bool may_have_arrived_ = true; ///< what is counted of arrivals is not all zero
};

} // namespace firn::cuda
