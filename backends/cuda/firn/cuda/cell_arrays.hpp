// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_begins.hpp>
#include <firn/cuda/block_set.hpp>
#include <firn/cuda/empty_blocks.hpp>
#include <firn/cuda/host_signal.hpp>
#include <firn/cuda/migration_arrays.hpp>
#include <firn/cuda/new_order.hpp>
#include <firn/cuda/tuning.hpp>

#include <algorithm>
#include <limits>
#include <utility>

namespace firn::cuda
{

/// What an order of cells has on a device: its arrays, how blocks come and go, and how a new order is
/// written.
template <class Number, int d>
class CellArrays
{
public:
    using Shape = BlockShape<d>;
    using Offset = typename CellOffset<Number>::Stored;
    using Leavers = detail::Leavers<Number>;

    explicit CellArrays(Queue const& queue, Periods<d> const& periods)
        : queue_(queue), periods_(periods), set_(queue_), begin_(queue_), new_begin_(queue_), order_(queue_),
          order_before_(queue_), left_(queue_), changes_(queue_), block_begin_(queue_), chunks_(queue_),
          arrived_begin_(queue_), arrived_(queue_), leavers_(queue_), blocks_before_(queue_), signal_(queue_)
    {}

    Queue const& queue() const { return queue_; }
    std::size_t size() const { return size_; }
    std::uint32_t blocks() const { return set_.size(); }

    std::size_t memory() const
    {
        return set_.memory() + begin_.memory() + new_begin_.memory() + order_.memory() +
               order_before_.memory() + left_.memory() + changes_.memory() + block_begin_.memory() +
               arrived_begin_.memory() + arrived_.memory() + leavers_.memory() + blocks_before_.memory();
    }

    /// How many times empty blocks were removed, and the previous indices of the blocks that stayed.
    std::uint32_t generation() const { return generation_; }
    std::uint32_t const* blocks_before() const { return blocks_before_.data(); }
    std::uint32_t blocks_kept() const
    {
        return blocks_kept_;
    } ///< how many of these there are; later blocks are new

    unsigned char* left() { return left_.data(); }
    detail::Changes changes() { return changes_.view(); }

    /// The signal by which loops know whether they have work to do.
    detail::Signal signal() { return signal_.view(); }
    detail::Signal signal() const { return signal_.view(); } ///< once there are items

    /// Says that all items now lie at their slots.
    void commit() { committed_ = true; }
    bool committed() const { return committed_; }

protected:
    using LeaverArrays = detail::LeaverArrays<Number>;

    /// Where the device stores the blocks' beginnings.
    detail::BlockBegins begins()
    {
        block_begin_.resize(blocks());
        return {blocks(), block_begin_.data()};
    }

    void find_block_begins() { detail::find_begins_of_all_blocks(queue_, begins(), changes(), chunks_); }

    void stay_all()
    {
        std::uint32_t const cells = blocks() * Shape::cells;
        if (cells == 0) return;
        launch_after("stay_all", queue_, detail::stay_all, groups_of(cells, 256), 256, begin_.data(), cells,
                     changes());
    }

    /// Numbers the blocks that a loop found missing, or makes room for them; clears the incoming items.
    void add_blocks(std::uint32_t births)
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
        new_begin_.renew(begin_.size()); // stopped loops load from it before they see that they are stopped
        new_begin_.fill_bytes(0, new_begin_.size(), 0);
        changes_.resize(blocks());
        launch_after("clear_cells", queue_, detail::clear_cells, groups_of(cells, 256), 256,
                     before * Shape::cells, cells, static_cast<std::uint32_t>(size_), begin_.data(),
                     changes());
    }

    /// Makes room for so many blocks, and for an eighth more, where the arrays of cells have to grow.
    void reserve_blocks(std::uint32_t all)
    {
        std::size_t const before = begin_.size();
        if (before == 0 || (std::size_t(all) * Shape::cells + 1) * sizeof(std::uint32_t) <= begin_.memory())
            return;
        std::uint32_t const more = all + all / 8, now = blocks();
        std::size_t const cells = std::size_t(more) * Shape::cells + 1;
        begin_.resize(cells);
        begin_.resize(before);
        for (auto* const array : {&new_begin_, &arrived_begin_}) array->renew(cells);
        changes_.resize(more);
        changes_.resize(now);
        block_begin_.renew(more);
    }

    /// Lists the blocks that hold items in `blocks_before_`, in their order. Returns how many there are.
    std::uint32_t list_live_blocks()
    {
        return detail::list_live_blocks(queue_, begin_.data(), blocks(), blocks_before_);
    }
    /// Renumbers the `count` blocks that are listed so, and drops the others.
    void forget_empty_blocks(std::uint32_t count)
    {
        new_begin_.renew(std::size_t(count) * Shape::cells + 1);
        auto& new_arrived_begin =
            changes_.first_incoming; // no longer needed: this step's incoming items are in the order
        may_have_arrived_ = true;
        new_arrived_begin.renew(new_begin_.size());
        launch_after("keep_blocks", queue_, detail::keep_blocks, count, 64, blocks_before_.data(),
                     begin_.data(), arrived_begin_.data(), new_begin_.data(), new_arrived_begin.data());
        std::swap(begin_, new_begin_);
        std::swap(arrived_begin_, new_arrived_begin);
        changes_.first_incoming.renew(std::size_t(count) * Shape::cells);
        set_.keep(blocks_before_.data(), count);
        blocks_kept_ = count;
        ++generation_;
    }

    /// Writes the new order of `items` items once the beginnings of blocks are known: those that stay in
    /// their cells, and at most `count` that come. If the device has a part of the blocks, `part` says which.
    template <class AnyLeavers>
    void rearrange(AnyLeavers const& leavers, std::uint32_t count, unsigned char const* left,
                   std::array<Offset*, d> const& offset, std::size_t items,
                   detail::PartOfBlocks const* part = nullptr)
    {
        bool const comes_in = left == nullptr;
        new_begin_.renew(blocks() * Shape::cells + 1);
        arrived_begin_.renew(new_begin_.size());
        arrived_.renew(count);
        Array<std::uint32_t> next(queue_);
        bool const in_place = committed_;
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
                                  leavers.scratch()};
        if (part == nullptr)
            launch_behind("rearrange", queue_, detail::rearrange<d, AnyLeavers>, blocks(), 64, 0, signal(),
                          begin_.data(), changes(), block_begin_.data(), leavers, to, offset);
        else
            launch_behind("rearrange", queue_, detail::rearrange_part<d, AnyLeavers>, part->groups(), 64, 0,
                          signal(), begin_.data(), changes(), block_begin_.data(), leavers, to, offset,
                          *part);
        std::swap(begin_, new_begin_);
        if (!in_place) std::swap(order_, next);
        size_ = items;
        if (comes_in || !in_place) queue_.wait(); // buffers in use are about to be freed
        committed_ = false;
    }

    Queue queue_;
    Periods<d> periods_; ///< of blocks
    std::size_t size_ = 0;
    bool committed_ = true;
    BlockSet set_;
    Array<std::uint32_t> begin_, new_begin_, order_, order_before_;
    Array<unsigned char> left_; ///< per slot: whether the item left its cell
    detail::ChangeArrays changes_;
    Array<std::uint64_t> block_begin_, chunks_;
    Array<std::uint32_t> arrived_begin_, arrived_;
    LeaverArrays leavers_;
    std::uint32_t generation_ = 0, blocks_kept_ = 0;
    Array<std::uint32_t> blocks_before_;
    detail::HostSignal signal_;
    bool may_have_arrived_ = true; ///< the counts of incoming items may not all be zero
};

} // namespace firn::cuda
