// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/openmp/block_list.hpp>
#include <firn/openmp/block_map.hpp>
#include <firn/openmp/compress.hpp>
#include <firn/openmp/migration.hpp>
#include <firn/openmp/new_order.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/partition.hpp>
#include <firn/openmp/ranks.hpp>
#include <firn/openmp/tuning.hpp>
#include <firn/openmp/workspace.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace firn::openmp
{

/// The order of cells: items by block, in a block by group of `lanes` cells, in a group interleaved by rank.
///
/// First come the first items of the group's cells, then the second ones, and so on, so that lane l of a pack
/// can work on cell l and the pack reads contiguous memory. Items are not moved: `source` says where the item
/// of each slot lies. No result depends on the number of threads.
template <class Number, int d, int lanes>
class CellOrder
{
public:
    using Shape = BlockShape<d, lanes>;
    using Offset = typename CellOffset<Number>::Stored;
    using Leaver = openmp::Leaver<Number>;
    using LeaverNotes = openmp::LeaverNotes<Number>;
    using Block = typename BlockList<d>::Block;

    /// Cells beyond this coordinate have no key (see block_key); one more is kept in reserve for items about
    /// to leave.
    static constexpr double largest_coordinate = d == 3 ? 4.0e6 : 1.0e9;
    /// Bytes per item: its source in the current order and in the one being written.
    static constexpr std::size_t bytes_per_item = 2 * sizeof(std::uint32_t);

    /// `backend` says how many threads work.
    template <class Backend>
    explicit CellOrder(Backend const& backend, Periods<d> const& periods = {})
        : threads_(backend.all_threads()), periods_(periods.in_blocks(Shape::extent))
    {}

    /// The cells of a block along an axis, of which a period is a multiple.
    static constexpr int extent(int axis) { return Shape::extent(axis); }
    /// Those of blocks.
    Periods<d> const& periods() const { return periods_; }

    std::size_t size() const { return blocks().empty() ? 0 : blocks().back().end; }
    std::span<Block const> blocks() const { return blocks_.now(); }
    /// The blocks of each thread, for parallel_for(): items are divided as evenly as blocks allow.
    std::span<std::uint32_t const> partitions() const { return partitions_; }
    /// Changes whenever the set of blocks does.
    std::uint64_t version() const { return blocks_.version(); }
    /// How many times the order has been rewritten.
    std::uint64_t generation() const { return generation_; }
    /// The number of items in each cell of a group.
    std::uint32_t const* counts(std::size_t block, int group) const
    {
        return &order_.counts[block * Shape::cells + std::size_t(group * lanes)];
    }
    /// The first slot of a group.
    std::uint32_t group_begin(std::size_t block, int group) const
    {
        return order_.group_begin[block * Shape::groups + std::size_t(group)];
    }
    /// The slot behind the last of a group.
    std::uint32_t group_end(std::size_t block, int group) const
    {
        return group + 1 < Shape::groups ? group_begin(block, group + 1) : blocks()[block].end;
    }
    /// The items that came to a block in the last rebin() and have not scattered yet, in the order of their
    /// cells.
    std::span<Leaver const> leavers(std::size_t block) const { return migration_.incoming(block); }
    /// What threads work with in loops that change something; such loops must be called one at a time.
    Workspace& workspace() const { return workspace_; }
    /// Before it replaces another order: goes on with what that one's threads work with.
    void take_workspace(CellOrder& other) noexcept { workspace_ = std::move(other.workspace_); }
    /// The block's index before the last rebin(), or absent.
    int old_block(std::size_t block) const { return blocks_.old(block); }
    /// The cells of consecutive slots of a block, counted along the last axis first.
    void find_places(std::size_t block, std::size_t slot, int count, int* places) const
    {
        auto const begins = order_.group_begin.data() + block * Shape::groups;
        std::size_t const end = slot + static_cast<std::size_t>(count);
        int group = static_cast<int>(std::upper_bound(begins, begins + Shape::groups, slot) - begins) - 1;
        for (; group < Shape::groups && group_begin(block, group) < end; ++group)
            for_each_rank(block, group, [&](std::uint32_t at, std::uint32_t, std::uint64_t pattern) {
                for (; pattern != 0; pattern &= pattern - 1, ++at)
                    if (at >= slot && at < end) places[at - slot] = group * lanes + std::countr_zero(pattern);
            });
    }
    /// The end of the groups, from this one on, whose items share packs: as many groups as fit into one pack,
    /// or one group.
    int end_of_groups(std::size_t block, int group) const
    {
        std::uint32_t const begin = group_begin(block, group);
        int end = group + 1;
        while (end < Shape::groups && group_end(block, end) - begin <= lanes) ++end;
        return end;
    }
    /// Where the items of consecutive slots, from `slot` on, lie.
    std::uint32_t const* sources(std::size_t slot) const
    {
        assert(!is_incomplete_ && "the order of cells has been completed");
        return &order_.source[slot];
    }
    std::size_t memory() const
    {
        return blocks_.memory() + migration_.memory() + order_.memory() + new_order_.memory() +
               partitions_.capacity() * sizeof(partitions_[0]);
    }

    /// The coordinates of a place in a block.
    static Coordinates<d> cell_at(Coordinates<d> const& block, int place)
    {
        Coordinates<d> cell;
        for (int a = d - 1; a >= 0; --a) {
            cell[a] = block[a] * Shape::extent(a) + place % Shape::extent(a);
            place /= Shape::extent(a);
        }
        return cell;
    }

    /// Adds items that lie at first, first + 1, … in the given cells.
    void insert(Coordinates<d> const* where, std::size_t count, std::uint32_t first)
    {
        std::span const cells(where, count);
        migration_.forget(blocks().size());
        std::vector<Leaver> leavers;
        leavers.reserve(cells.size());
        for (std::size_t i = 0; i < cells.size(); ++i) {
            auto const [block, place] = block_and_place(cells[i]);
            migration_.insert(block_key<d>(periods_.wrapped(block)), leavers.data() + i);
            leavers.push_back({static_cast<std::uint32_t>(first + i), place, here<d>, nullptr});
        }
        rearrange(size() + cells.size());
        migration_.free_incoming(blocks().size()); // every new item was in these lists
    }

    /// Erases the items for which `gone[where it lies]` is not 0. The other `kept` ones will lie at
    /// `place[where it lies]`. They keep the order of ranks, except that the last item of a cell fills each
    /// hole.
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        migration_.forget(blocks().size());
        for (std::size_t b = 0; b < blocks().size(); ++b)
            for (int group = 0; group < Shape::groups; ++group)
                for_each_rank(b, group, [&](std::uint32_t slot, std::uint32_t rank, std::uint64_t pattern) {
                    for (; pattern != 0; pattern &= pattern - 1, ++slot)
                        if (gone[source(slot)])
                            migration_.erase(b,
                                             {slot, rank * lanes + std::uint32_t(std::countr_zero(pattern))});
                });
        rearrange(kept);
        for (std::size_t slot = 0; slot < kept; ++slot) order_.source[slot] = place[order_.source[slot]];
    }

    /// Moves the leavers to their new cells, and wraps their offsets. An item lies at its slot (see commit).
    void rebin(std::array<Offset*, std::size_t(d)> const& offset)
    {
        begin_rebin(offset);
        complete();
    }

    /// The leavers that rebin() would move, by the blocks that they leave and come to. It follows after
    /// divert() and admit(), if at all.
    using Flow = typename Migration<Number, d, lanes>::Flow;
    /// How many numbers a leaver's contribution has.
    std::size_t contribution_size() const { return migration_.contribution_size(); }
    /// Lists the leavers, and hands those for which `goes_elsewhere(flow)` is true to `take(flow)`:
    /// rebin_rest() will not move them.
    template <class GoesElsewhere, class Take>
    void divert(GoesElsewhere const& goes_elsewhere, Take const& take)
    {
        migration_.list_flows(blocks(), periods_);
        migration_.divert(goes_elsewhere, take);
    }
    /// rebin() of the leavers that were not diverted, and of others that come from elsewhere; `count` items
    /// are then here.
    void rebin_rest(std::array<Offset*, std::size_t(d)> const& offset, std::span<Flow const> from_elsewhere,
                    std::size_t count)
    {
        migration_.admit(from_elsewhere);
        find_blocks(count, offset);
        complete();
    }
    /// Items that lay at places from `first` on lie elsewhere now: at `place[where it lay - first]`.
    void relocate(std::uint32_t first, std::span<std::uint32_t const> place)
    {
        for_each_index(size(), [&](std::size_t slot) {
            std::uint32_t& source = order_.source[slot];
            if (source >= first) source = place[source - first];
        });
    }

    /// A block with the order of its items, which may come from elsewhere.
    struct WholeBlock
    {
        std::uint64_t key;
        std::vector<std::uint32_t> counts;  ///< of the items in each cell
        std::vector<std::uint32_t> sources; ///< where they lie, by slot
    };
    /// A block that is here.
    WholeBlock whole_block(std::size_t b) const
    {
        auto const& [coordinates, begin, end] = blocks()[b];
        return {block_key<d>(coordinates),
                {counts(b, 0), counts(b, 0) + Shape::cells},
                {order_.source.data() + begin, order_.source.data() + end}};
    }
    /// Replaces all blocks by these, in the order of their keys. Items have not moved.
    void replace_blocks(std::span<WholeBlock const> whole)
    {
        assert((!committed_ || blocks().empty()) && !is_incomplete_ && "the order refers to where items lie");
        std::size_t items = 0;
        for (auto const& block : whole) items += block.sources.size();
        new_order_.resize(items, whole.size());
        std::vector<Block> blocks;
        std::uint32_t slot = 0;
        for (std::size_t b = 0; b < whole.size(); ++b) {
            std::ranges::copy(whole[b].counts, new_order_.counts.data() + b * Shape::cells);
            std::ranges::copy(whole[b].sources, new_order_.source.data() + slot);
            blocks.push_back({block_of_key<d>(whole[b].key), slot, slot});
            for (int group = 0; group < Shape::groups; ++group) {
                new_order_.group_begin[b * Shape::groups + std::size_t(group)] = slot;
                for (int lane = 0; lane < lanes; ++lane)
                    slot += whole[b].counts[std::size_t(group * lanes + lane)];
            }
            blocks.back().end = slot;
        }
        blocks_.replace(std::move(blocks));
        order_.swap(new_order_);
        committed_ = false;
        ++generation_;
        migration_.forget(whole.size());
        migration_.free_incoming(whole.size());
        find_partitions(this->blocks(), threads_for(items, threads_.count), partitions_);
    }

    /// The host's part of rebin(): afterwards blocks(), old_block(), version() and generation() are those of
    /// the new order. The contents of blocks must not be read before complete().
    void begin_rebin(std::array<Offset*, std::size_t(d)> const& offset)
    {
        migration_.list_flows(blocks(), periods_);
        find_blocks(size(), offset);
    }

    /// The threads' part. Each block is then passed to what `make(thread)` returned, once its new order is
    /// written; also if no order had to be completed.
    template <class Make>
    void complete(Make const& make)
    {
        int const threads = threads_for(size(), threads_.count);
        workspace_.for_threads(threads);
        parallel_for(threads_.limited_to(threads), static_cast<int>(blocks().size()), partitions(),
                     [&](int thread) {
                         return [&, &ranks = workspace_.template of<Ranks<lanes>>(thread),
                                 then = make(thread)](int b) {
                             if (is_incomplete_) {
                                 if (int const old = old_block(std::size_t(b)); old != BlockMap::absent)
                                     migration_.wrap(std::size_t(old), offset_);
                                 sort_block(b, ranks);
                             }
                             then(b);
                         };
                     });
        if (!std::exchange(is_incomplete_, false)) return;
        order_.swap(new_order_);
        committed_ = false;
    }
    void complete()
    {
        if (is_incomplete_) complete([](int) { return [](int) {}; });
    }

    /// Lists the position of each item of a group within it, see OutgoingSlot.
    void list_places(std::size_t block, int group, std::vector<std::uint32_t>& at) const
    {
        std::uint32_t const begin = group_begin(block, group);
        at.resize(std::max<std::size_t>(at.size(), group_end(block, group) - begin));
        for_each_rank(block, group, [&](std::uint32_t slot, std::uint32_t rank, std::uint64_t pattern) {
            std::uint32_t of_lanes[std::size_t(lanes)];
            count_up<lanes>(rank * lanes, of_lanes);
            compress<lanes>(of_lanes, pattern, &at[slot - begin]);
        });
    }

    /// Records the leavers of a block. Returns those that must scatter at once, see Migration::note.
    std::span<Leaver const> note_outgoing(std::size_t b, LeaverNotes& notes)
    {
        return migration_.note(b, blocks()[b].end - blocks()[b].begin, notes);
    }
    /// Makes room for the leavers: a loop that moves items records them block by block.
    void expect_outgoing() { migration_.expect(blocks().size()); }
    /// Says that all items now lie at their slots.
    void commit() { committed_ = true; }

    /// Merges the results of all blocks, in their order.
    template <class Result>
    Result merged(std::span<Result const> of_blocks) const
    {
        Result all{};
        for (Result const& result : of_blocks) all.merge(result);
        return all;
    }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        for (std::size_t b = 0; b < blocks().size(); ++b)
            for (int group = 0; group < Shape::groups; ++group)
                for_each_rank(b, group, [&](std::uint32_t slot, std::uint32_t, std::uint64_t pattern) {
                    for (; pattern != 0; pattern &= pattern - 1, ++slot)
                        visit(std::size_t{source(slot)},
                              cell_at(blocks()[b].coordinates, group * lanes + std::countr_zero(pattern)));
                });
    }

    /// Visits a group rank by rank: `use(first slot of the rank, rank, one bit for each cell that has so many
    /// items)`.
    template <class Use>
    void for_each_rank(std::size_t block, int group, Use const& use) const
    {
        openmp::for_each_rank<lanes>(counts(block, group), group_begin(block, group), group_end(block, group),
                                     use);
    }

private:
    std::uint32_t source(std::size_t slot) const
    {
        return committed_ ? static_cast<std::uint32_t>(slot) : order_.source[slot];
    }

    template <class Body>
    void for_each_index(std::size_t count, Body const& body) const
    {
        openmp::for_each(threads_, count, body);
    }

public:
    /// The coordinates of a cell's block, and the cell's place in it.
    static std::pair<Coordinates<d>, std::uint16_t> block_and_place(Coordinates<d> const& cell)
    {
        Coordinates<d> block = zeros<Coordinates<d>>();
        int place = 0;
        for (int a = 0; a < d; ++a) {
            int const extent = Shape::extent(a), inside = ((cell[a] % extent) + extent) % extent;
            block[a] = (cell[a] - inside) / extent;
            place = place * extent + inside;
        }
        return {block, static_cast<std::uint16_t>(place)};
    }

private:
    /// Finds the blocks of the new order, and what comes to each from others; complete() then writes the
    /// order.
    void find_blocks(std::size_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        offset_ = offset;
        auto const lost = [&](std::size_t b) { return migration_.lost(b); };
        if (blocks_.update(migration_.flows(), lost))
            for (std::size_t b = 0; b < blocks_.before().size(); ++b) // complete() sees only blocks that stay
                if (!blocks_.stays(b)) migration_.wrap(b, offset_);
        ++generation_;
        migration_.deal_incoming(blocks().size());
        blocks_.find_slots([&](std::size_t b) { return migration_.incoming(b).size(); });
        new_order_.resize(count, blocks().size());
        find_partitions(blocks(), threads_for(count, threads_.count), partitions_);
        is_incomplete_ = true;
    }

    /// Writes the new order of `count` items at once, after an insertion or an erasure.
    void rearrange(std::size_t count)
    {
        find_blocks(count, {});
        complete();
    }

    /// Writes the new order of a block.
    void sort_block(int b, Ranks<lanes>& ranks)
    {
        OldBlock<Shape> before;
        ChangesOfBlock<Number> changes;
        if (int const index = old_block(std::size_t(b)); index != BlockMap::absent) {
            auto const old = static_cast<std::size_t>(index);
            before = {counts(old, 0), &order_.group_begin[old * Shape::groups], blocks_.before()[old].end,
                      committed_ ? nullptr : order_.source.data()};
            changes.outgoing = migration_.outgoing(old);
            changes.inside = migration_.scattered_inside(old);
        }
        std::array<std::uint32_t, Shape::cells> came;
        came.fill(0);
        for (Leaver const& leaver : changes.inside) ++came[leaver.place];
        migration_.sort_incoming(std::size_t(b), came);
        changes.incoming = leavers(std::size_t(b));
        NewBlock const now{&new_order_.counts[std::size_t(b) * Shape::cells],
                           &new_order_.group_begin[std::size_t(b) * Shape::groups], new_order_.source.data(),
                           blocks()[std::size_t(b)].begin};
        for (int cell = 0; cell < Shape::cells; ++cell)
            now.counts[cell] = before.counts[cell] + came[std::size_t(cell)];
        write_block(before, changes, now, ranks);
    }

    Threads threads_;
    Periods<d> periods_;
    mutable Workspace workspace_;
    bool committed_ = true, is_incomplete_ = false;
    std::array<Offset*, std::size_t(d)> offset_{}; ///< of the items being rebinned
    std::uint64_t generation_ = 0;
    BlockList<d> blocks_;
    OrderTable<Shape> order_, new_order_;
    Migration<Number, d, lanes> migration_;
    std::vector<std::uint32_t> partitions_; ///< see partitions()
};

} // namespace firn::openmp
