// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/block_map.hpp>
#include <firn/openmp/lanes.hpp>
#include <firn/openmp/leavers.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/ranks.hpp>
#include <firn/openmp/tuning.hpp>
#include <firn/openmp/workspace.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstdint>
#include <numeric>
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
    using Outgoing = openmp::Outgoing<Number>;
    using LeaverNotes = openmp::LeaverNotes<Number>;

    /// Cells beyond this coordinate have no key (see block_key); one more is kept in reserve for items about
    /// to leave.
    static constexpr double largest_coordinate = d == 3 ? 4.0e6 : 1.0e9;
    /// Bytes per item: its source in the current order and in the one being written.
    static constexpr std::size_t bytes_per_item = 2 * sizeof(std::uint32_t);

    /// A block of cells with the items in it.
    struct Block
    {
        Coordinates<d> coordinates;
        std::uint32_t begin = 0, end = 0; ///< its slots
    };

    /// `backend` says how many threads work.
    template <class Backend>
    explicit CellOrder(Backend const& backend) : threads_(backend.all_threads())
    {}

    std::size_t size() const { return blocks_.empty() ? 0 : blocks_.back().end; }
    std::span<Block const> blocks() const { return blocks_; }
    /// The blocks of each thread, for parallel_for(): items are divided as evenly as blocks allow.
    std::span<std::uint32_t const> partitions() const { return partitions_; }
    /// Changes whenever the set of blocks does.
    std::uint64_t version() const { return version_; }
    /// How many times the order has been rewritten.
    std::uint64_t generation() const { return generation_; }
    /// The number of items in each cell of a group.
    std::uint32_t const* counts(std::size_t block, int group) const
    {
        return &counts_[block * Shape::cells + std::size_t(group * lanes)];
    }
    /// The first slot of a group.
    std::uint32_t group_begin(std::size_t block, int group) const
    {
        return group_begin_[block * Shape::groups + std::size_t(group)];
    }
    /// The slot behind the last of a group.
    std::uint32_t group_end(std::size_t block, int group) const
    {
        return group + 1 < Shape::groups ? group_begin(block, group + 1) : blocks_[block].end;
    }
    /// The items that came to a block in the last rebin() and have not scattered yet, in the order of their
    /// cells.
    std::span<Leaver const> leavers(std::size_t block) const
    {
        return std::span(incoming_).subspan(incoming_begin_[block],
                                            incoming_begin_[block + 1] - incoming_begin_[block]);
    }
    /// What threads work with in loops that change something; such loops must be called one at a time.
    Workspace& workspace() const { return workspace_; }
    /// The block's index before the last rebin(), or absent.
    int old_block(std::size_t block) const { return old_block_[block]; }
    /// The cells of consecutive slots of a block, counted along the last axis first.
    void find_places(std::size_t block, std::size_t slot, int count, int* places) const
    {
        auto const begins = group_begin_.data() + block * Shape::groups;
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
        return &source_[slot];
    }
    std::size_t memory() const
    {
        auto const of = [](auto const& list) { return list.capacity() * sizeof(list[0]); };
        std::size_t lists = of(blocks_) + of(old_blocks_) + of(fresh_) + of(partitions_) + of(incoming_) +
                            of(stay_) + of(old_block_) + of(incoming_begin_) + of(outgoing_) + of(outflows_) +
                            of(flows_) + of(flow_begin_) + of(flow_order_);
        for (auto const& of_block : outgoing_)
            lists += of(of_block.from) + of(of_block.scattered_inside) + of(of_block.leavers) +
                     of(of_block.contribution);
        return lists + source_.memory() + new_source_.memory() + counts_.memory() + new_counts_.memory() +
               group_begin_.memory() + new_group_begin_.memory() + map_.memory();
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
    void insert(std::span<Coordinates<d> const> cells, std::uint32_t first)
    {
        forget_outgoing();
        std::vector<Leaver> leavers;
        leavers.reserve(cells.size());
        for (std::size_t i = 0; i < cells.size(); ++i) {
            auto const [block, place] = block_and_place(cells[i]);
            auto const key = block_key<d>(block);
            if (flows_.empty() || flows_.back().key != key)
                flows_.push_back({key, leavers.data() + i, 0, BlockMap::absent});
            ++flows_.back().count;
            leavers.push_back({static_cast<std::uint32_t>(first + i), place, here<d>, nullptr});
        }
        rearrange(size() + cells.size());
        // Every new item was in these lists; free them.
        decltype(flows_)().swap(flows_);
        decltype(flow_order_)().swap(flow_order_);
        decltype(incoming_)().swap(incoming_);
        incoming_begin_.assign(blocks_.size() + 1, 0);
    }

    /// Erases the items for which `gone[where it lies]` is not 0. The other `kept` ones will lie at
    /// `place[where it lies]`. They keep the order of ranks, except that the last item of a cell fills each
    /// hole.
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        forget_outgoing();
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            for (int group = 0; group < Shape::groups; ++group)
                for_each_rank(b, group, [&](std::uint32_t slot, std::uint32_t rank, std::uint64_t pattern) {
                    for (; pattern != 0; pattern &= pattern - 1, ++slot)
                        if (gone[source(slot)]) {
                            outgoing_[b].from.push_back(
                                {slot, rank * lanes + std::uint32_t(std::countr_zero(pattern))});
                            ++outflows_[b].outgoing;
                        }
                });
        rearrange(kept);
        for (std::size_t slot = 0; slot < kept; ++slot) source_[slot] = place[source_[slot]];
    }

    /// Moves the leavers to their new cells, and wraps their offsets. An item lies at its slot (see commit).
    void rebin(std::array<Offset*, std::size_t(d)> const& offset)
    {
        begin_rebin(offset);
        complete();
    }

    /// The host's part of rebin(): afterwards blocks(), old_block(), version() and generation() are those of
    /// the new order. The contents of blocks must not be read before complete().
    void begin_rebin(std::array<Offset*, std::size_t(d)> const& offset)
    {
        list_flows();
        find_blocks(size(), offset);
    }

    /// The threads' part. Each block is then passed to what `make(thread)` returned, once its new order is
    /// written; also if no order had to be completed.
    template <class Make>
    void complete(Make const& make)
    {
        int const threads = threads_for(size(), threads_.count);
        workspace_.for_threads(threads);
        parallel_for(threads_.limited_to(threads), static_cast<int>(blocks_.size()), partitions(),
                     [&](int thread) {
                         return [&, &ranks = workspace_.template of<Ranks<lanes>>(thread),
                                 then = make(thread)](int b) {
                             if (is_incomplete_) {
                                 if (int const old = old_block_[std::size_t(b)]; old != BlockMap::absent)
                                     wrap(outgoing_[std::size_t(old)]);
                                 sort_block(b, ranks);
                             }
                             then(b);
                         };
                     });
        if (!std::exchange(is_incomplete_, false)) return;
        source_.swap(new_source_);
        counts_.swap(new_counts_);
        group_begin_.swap(new_group_begin_);
        committed_ = false;
    }
    void complete()
    {
        if (is_incomplete_) complete([](int) { return [](int) {}; });
    }

    /// Lists the position of each item of a group within it, see Departure.
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

    /// An item of a block that moves from the cell at `place` by `steps` cells along the axes: less than a
    /// block.
    static Leaver moved(std::uint32_t source, int place, std::array<int, std::size_t(d)> const& steps)
    {
        int to = 0, direction = 0, stride = 1, turn = 1;
        for (int a = d - 1; a >= 0; --a) {
            int const extent = Shape::extent(a), at = place % extent + steps[std::size_t(a)];
            int const beyond = int(at >= extent) - int(at < 0);
            to += (at - beyond * extent) * stride;
            direction += (beyond + 1) * turn;
            place /= extent;
            stride *= extent;
            turn *= 3;
        }
        return {source, static_cast<std::uint16_t>(to), static_cast<std::uint16_t>(direction), nullptr};
    }

    /// Records the leavers of a block. Returns those that must scatter at once, in the order of their cells:
    /// those that go to other cells of the same block, if they are many. Only their new cells need then be
    /// stored. If they are few, it is faster to scatter them later, with those that come from other blocks.
    std::span<Leaver const> note_outgoing(std::size_t b, LeaverNotes& notes)
    {
        Outgoing& outgoing = outgoing_[b];
        auto& outflow = outflows_[b];
        outgoing.clear();
        outflow = {};
        if (notes.count == 0) return {};
        std::size_t const channels = notes.channels;
        std::span<Leaver> const all(notes.leavers.data(), notes.count);
        append(notes.from.data(), notes.count, outgoing.from);
        outflow.outgoing = static_cast<std::uint32_t>(notes.count);
        for (Leaver const& leaver : all) ++outflow.to[leaver.direction];
        bool const are_many = outflow.to[here<d>] * most_listed_share > blocks_[b].end - blocks_[b].begin;
        Number const* contribution = notes.contribution.data();
        if (are_many) {
            outflow.inside = std::exchange(outflow.to[here<d>], 0);
            notes.inside.clear();
        }
        else {
            append(contribution, notes.count * channels, outgoing.contribution);
            contribution = outgoing.contribution.data();
        }
        std::array<std::uint32_t, directions<d>> next;
        std::exclusive_scan(outflow.to.begin(), outflow.to.end(), next.begin(), std::uint32_t(0));
        std::size_t const listed = notes.count - outflow.inside;
        append(all.data(), listed, outgoing.leavers); // as many as will be overwritten below
        outflow.leavers = outgoing.leavers.data();
        for (Leaver const& leaver : all) {
            // built from its parts: loading as a whole what was just stored in parts would stall
            Leaver const scattering{leaver.source, leaver.place, leaver.direction, contribution};
            contribution += channels;
            if (are_many && leaver.direction == here<d>)
                notes.inside.push_back(scattering);
            else
                outgoing.leavers[next[leaver.direction]++] = scattering;
        }
        if (!are_many) return {};

        make_room(outgoing.contribution, listed * channels);
        for (Leaver& leaver : outgoing.leavers) {
            append(leaver.contribution, channels, outgoing.contribution);
            leaver.contribution = outgoing.contribution.data() + outgoing.contribution.size() - channels;
        }
        std::array<std::uint32_t, Shape::cells> counts{};
        notes.in_order.resize(notes.inside.size());
        sort_by_cell(std::array{std::span<Leaver const>(notes.inside)}, notes.in_order.data(), counts);
        append(notes.in_order.data(), notes.in_order.size(), outgoing.scattered_inside);
        return notes.in_order;
    }

    /// Makes room for the leavers: a loop that moves items records them block by block.
    void expect_outgoing()
    {
        outgoing_.resize(blocks_.size());
        outflows_.resize(blocks_.size());
    }

    /// Says that all items now lie at their slots.
    void commit() { committed_ = true; }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            for (int group = 0; group < Shape::groups; ++group)
                for_each_rank(b, group, [&](std::uint32_t slot, std::uint32_t, std::uint64_t pattern) {
                    for (; pattern != 0; pattern &= pattern - 1, ++slot)
                        visit(std::size_t{source(slot)},
                              cell_at(blocks_[b].coordinates, group * lanes + std::countr_zero(pattern)));
                });
    }

    /// Visits a group rank by rank: `use(first slot of the rank, rank, one bit for each cell that has so many
    /// items)`.
    template <class Use>
    void for_each_rank(std::size_t block, int group, Use const& use) const
    {
        for_each_rank(counts(block, group), group_begin(block, group), group_end(block, group), use);
    }

private:
    /// Consecutive leavers in a list that come to the same block.
    struct Flow
    {
        std::uint64_t key; ///< of the block
        Leaver const* first;
        std::uint32_t count;
        int to; ///< the block's index
    };

    template <class Use>
    static void for_each_rank(std::uint32_t const* counts, std::uint32_t slot, std::uint32_t end,
                              Use const& use)
    {
        for (std::uint32_t rank = 0; slot < end; ++rank) {
            std::uint64_t const pattern = lanes_above<lanes>(counts, rank);
            use(slot, rank, pattern);
            slot += static_cast<std::uint32_t>(std::popcount(pattern));
        }
    }
    /// The end of a group while the new order is not complete.
    std::uint32_t old_group_end(int block, int group) const
    {
        return group + 1 < Shape::groups ? group_begin(static_cast<std::size_t>(block), group + 1)
                                         : old_blocks_[std::size_t(block)].end;
    }

    std::uint32_t source(std::size_t slot) const
    {
        return committed_ ? static_cast<std::uint32_t>(slot) : source_[slot];
    }

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

    /// Sorts the items of some lists by cell, stably, and adds the number of items of each cell to `counts`.
    template <class Lists>
    static void sort_by_cell(Lists const& lists, Leaver* sorted,
                             std::array<std::uint32_t, Shape::cells>& counts)
    {
        std::array<std::uint32_t, Shape::cells> next;
        next.fill(0);
        bool any = false;
        for (std::span<Leaver const> const list : lists)
            for (Leaver const& item : list) ++next[item.place], any = true;
        if (!any) return;
        std::uint32_t before = 0;
        for (int cell = 0; cell < Shape::cells; ++cell) {
            counts[std::size_t(cell)] += next[std::size_t(cell)];
            before += std::exchange(next[std::size_t(cell)], before);
        }
        for (std::span<Leaver const> const list : lists)
            for (Leaver const& item : list) sorted[next[item.place]++] = item;
    }

    void forget_outgoing()
    {
        expect_outgoing();
        for (auto& of_block : outgoing_) of_block.clear();
        outflows_.assign(blocks_.size(), {});
        flows_.clear();
    }

    /// Lists the leavers by the blocks that they come to; those of each block are already sorted by
    /// direction.
    void list_flows()
    {
        flows_.clear();
        for (std::size_t b = 0; b < outflows_.size(); ++b) {
            Leaver const* first = outflows_[b].leavers;
            if (first == nullptr) continue;
            for (int direction = 0; direction < directions<d>; ++direction) {
                std::uint32_t const count = outflows_[b].to[std::size_t(direction)];
                if (count == 0) continue;
                flows_.push_back({block_key<d>(neighbour<d>(blocks_[b].coordinates, direction)), first, count,
                                  BlockMap::absent});
                first += count;
            }
        }
    }

    /// Finds the blocks of the new order, and what comes to each from others; complete() then writes the
    /// order.
    void find_blocks(std::size_t count, std::array<Offset*, std::size_t(d)> const& offset)
    {
        offset_ = offset;
        std::swap(blocks_, old_blocks_);
        stay_.resize(old_blocks_.size());
        for (std::size_t b = 0; b < old_blocks_.size(); ++b)
            stay_[b] =
                old_blocks_[b].end - old_blocks_[b].begin - outflows_[b].outgoing + outflows_[b].inside;
        list_blocks_with_items();
        bool same = blocks_.size() == old_blocks_.size();
        for (std::size_t b = 0; same && b < blocks_.size(); ++b)
            same = is_same_block<d>(blocks_[b].coordinates, old_blocks_[b].coordinates);
        old_block_.assign(blocks_.size(), BlockMap::absent);
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            old_block_[b] = same ? int(b) : map_.find(block_key<d>(blocks_[b].coordinates));
        if (!same) {
            map_.clear(blocks_.size());
            for (std::size_t b = 0; b < blocks_.size(); ++b)
                map_.insert(block_key<d>(blocks_[b].coordinates), int(b));
            for (Flow& flow : flows_) flow.to = map_.find(flow.key);
            // complete() does not see blocks that are gone
            for (std::size_t b = 0; b < old_blocks_.size(); ++b)
                if (stay_[b] == 0) wrap(outgoing_[b]);
            ++version_;
        }
        ++generation_;
        deal_incoming();
        new_source_.resize(count);
        new_counts_.resize(blocks_.size() * Shape::cells);
        new_group_begin_.resize(blocks_.size() * Shape::groups);
        find_parts(threads_for(count, threads_.count));
        is_incomplete_ = true;
    }

    /// Wraps the offsets of a block's leavers into their new cells. There are no offsets if items were
    /// inserted or erased and none moved (see rearrange).
    void wrap(Outgoing const& outgoing) const
    {
        if (offset_[0] == nullptr) return;
        for (auto const& from : outgoing.from)
            for (int a = 0; a < d; ++a) CellOffset<Number>::wrap(offset_[std::size_t(a)][from.slot]);
    }

    /// Writes the new order of `count` items at once, after an insertion or an erasure.
    void rearrange(std::size_t count)
    {
        find_blocks(count, {});
        complete();
    }

    /// Divides the blocks among threads: each partition ends at the block boundary nearest to its share of
    /// items.
    void find_parts(int threads)
    {
        partitions_.assign(1, 0);
        std::uint64_t const of = static_cast<std::uint64_t>(threads);
        for (std::uint64_t part = 1; part < of; ++part) {
            auto const lies_before = [&](Block const& block) { // its middle
                return (std::uint64_t{block.begin} + block.end) * of < 2 * size() * part;
            };
            auto const at =
                std::partition_point(blocks_.begin() + partitions_.back(), blocks_.end(), lies_before);
            partitions_.push_back(static_cast<std::uint32_t>(at - blocks_.begin()));
        }
        partitions_.push_back(static_cast<std::uint32_t>(blocks_.size()));
    }

    /// Lists all blocks that will hold items, in the order of their keys; adds incoming items to `stay_` for
    /// blocks that exist already.
    void list_blocks_with_items()
    {
        auto& fresh = fresh_;
        fresh.clear();
        for (Flow& flow : flows_) {
            flow.to = map_.find(flow.key);
            if (flow.to == BlockMap::absent)
                fresh.push_back(flow.key);
            else
                stay_[std::size_t(flow.to)] += flow.count;
        }
        std::sort(fresh.begin(), fresh.end());
        fresh.erase(std::unique(fresh.begin(), fresh.end()), fresh.end());
        auto const& before = old_blocks_;
        blocks_.clear();
        blocks_.reserve(before.size() + fresh.size());
        // both lists are sorted; merged by hand, since std::inplace_merge takes long to compile
        auto added = fresh.begin();
        for (std::size_t b = 0; b < before.size(); ++b) {
            if (stay_[b] == 0) continue;
            auto const key = block_key<d>(before[b].coordinates);
            for (; added != fresh.end() && *added < key; ++added)
                blocks_.push_back({block_of_key<d>(*added)});
            blocks_.push_back({before[b].coordinates});
        }
        for (; added != fresh.end(); ++added) blocks_.push_back({block_of_key<d>(*added)});
    }

    /// Sorts flows by the block that they come to, and finds the slots of blocks and the places of incoming
    /// items.
    void deal_incoming()
    {
        incoming_begin_.assign(blocks_.size() + 1, 0);
        flow_begin_.assign(blocks_.size() + 2, 0); // those of block b begin at b + 1 until they are sorted
        for (Flow const& flow : flows_) {
            incoming_begin_[std::size_t(flow.to + 1)] += flow.count;
            ++flow_begin_[std::size_t(flow.to + 2)];
        }
        std::uint32_t slot = 0;
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            std::uint32_t const total = old_block_[b] == BlockMap::absent ? incoming_begin_[b + 1]
                                                                          : stay_[std::size_t(old_block_[b])];
            blocks_[b].begin = slot;
            blocks_[b].end = slot += total;
            incoming_begin_[b + 1] += incoming_begin_[b];
            flow_begin_[b + 2] += flow_begin_[b + 1];
        }
        flow_order_.resize(flows_.size());
        for (Flow const& flow : flows_)
            flow_order_[flow_begin_[std::size_t(flow.to + 1)]++] = std::span(flow.first, flow.count);
        incoming_.clear();
        make_room(incoming_, incoming_begin_.back());
        incoming_.resize(incoming_begin_.back());
    }

    /// Orders a block's items by cell and rank, interleaved by rank within groups.
    ///
    /// An item that stays in a cell keeps its rank, so that sources are nearly consecutive. The hole of a
    /// leaver is filled by an incoming item, or else by the last item of the cell.
    void sort_block(int b, Ranks<lanes>& ranks)
    {
        int const old = old_block_[std::size_t(b)];
        bool const is_new = old == BlockMap::absent;
        static constexpr std::array<std::uint32_t, Shape::cells> none{};
        std::uint32_t const* const before = is_new ? none.data() : &counts_[std::size_t(old) * Shape::cells];
        std::uint32_t* const counts = &new_counts_[std::size_t(b) * Shape::cells];
        std::span<Departure const> gone;
        std::span<Leaver const> inside;
        if (!is_new)
            gone = outgoing_[std::size_t(old)].from, inside = outgoing_[std::size_t(old)].scattered_inside;
        std::array<std::uint32_t, Shape::cells> came;
        came.fill(0);
        for (Leaver const& leaver : inside) ++came[leaver.place];
        sort_by_cell(std::span(flow_order_)
                         .subspan(flow_begin_[std::size_t(b)],
                                  flow_begin_[std::size_t(b + 1)] - flow_begin_[std::size_t(b)]),
                     incoming_.data() + incoming_begin_[std::size_t(b)], came);
        for (int cell = 0; cell < Shape::cells; ++cell) counts[cell] = before[cell] + came[std::size_t(cell)];

        auto left = gone.begin();
        std::span<Leaver const> const incoming = leavers(std::size_t(b));
        auto leaver = inside.begin();
        auto arrival = incoming.begin();
        std::uint32_t slot = blocks_[std::size_t(b)].begin;
        for (int group = 0; group < Shape::groups; ++group) {
            int const first = group * lanes;
            new_group_begin_[std::size_t(b) * Shape::groups + std::size_t(group)] = slot;
            auto const comes_here = [&](auto next, auto const& list) {
                return next != list.end() && next->place < first + lanes;
            };
            std::uint32_t const begin = is_new ? 0 : group_begin(std::size_t(old), group),
                                end = is_new ? 0 : old_group_end(old, group);
            bool const stays_as_it_is = committed_ && (left == gone.end() || left->slot >= end) &&
                                        !comes_here(leaver, inside) && !comes_here(arrival, incoming);
            if (stays_as_it_is) {
                std::iota(new_source_.data() + slot, new_source_.data() + slot + (end - begin), begin);
                slot += end - begin;
                continue;
            }
            ranks.start(before + first, counts + first);
            if (!is_new)
                for_each_rank(before + first, begin, end,
                              [&](std::uint32_t from, std::uint32_t rank, std::uint64_t pattern) {
                                  std::uint32_t sources[std::size_t(lanes)];
                                  count_up<lanes>(from, sources);
                                  expand<lanes>(committed_ ? sources : &source_[from], pattern,
                                                ranks.row(rank));
                              });
            for (; left != gone.end() && left->slot < end; ++left) {
                ranks.leave(left->at);
                --counts[std::uint32_t(first) + left->at % lanes];
            }
            for (; comes_here(leaver, inside); ++leaver) ranks.fill(leaver->place - first, leaver->source);
            for (; comes_here(arrival, incoming); ++arrival)
                ranks.fill(arrival->place - first, arrival->source);
            ranks.close_holes();
            for (std::uint32_t rank = 0;; ++rank) {
                std::uint64_t const pattern = lanes_above<lanes>(counts + first, rank);
                if (pattern == 0) break;
                compress<lanes>(ranks.row(rank), pattern, &new_source_[slot]);
                slot += static_cast<std::uint32_t>(std::popcount(pattern));
            }
        }
    }

    Threads threads_;
    mutable Workspace workspace_;
    bool committed_ = true, is_incomplete_ = false;
    std::array<Offset*, std::size_t(d)> offset_{}; ///< of the items being rebinned
    std::uint64_t version_ = 0, generation_ = 0;
    std::vector<Block> blocks_, old_blocks_;
    std::vector<std::uint64_t> fresh_; ///< keys of blocks that were not there before
    BlockMap map_;
    Array<std::uint32_t> source_, new_source_, counts_, new_counts_, group_begin_, new_group_begin_;
    std::vector<Outgoing> outgoing_;                  ///< per old block
    std::vector<Outflow<Number, d>> outflows_;        ///< per old block
    std::vector<Flow> flows_;                         ///< by old block
    std::vector<std::span<Leaver const>> flow_order_; ///< the leavers of the flows, by new block
    std::vector<std::uint32_t> stay_;                 ///< per old block
    std::vector<int> old_block_;                      ///< per new block
    std::vector<Leaver> incoming_;                    ///< by new block, and cell
    std::vector<std::uint32_t> incoming_begin_, flow_begin_;
    std::vector<std::uint32_t> partitions_; ///< see partitions()
};

} // namespace firn::openmp
