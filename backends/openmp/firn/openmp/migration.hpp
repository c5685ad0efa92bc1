// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/openmp/block_map.hpp>
#include <firn/openmp/leavers.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace firn::openmp
{

/// What moves between the cells of an order: from the leavers that a loop records, block by block, to the
/// lists of what comes to each block of the new order.
template <class Number, int d, int lanes>
class Migration
{
public:
    using Shape = BlockShape<d, lanes>;
    using Offset = typename CellOffset<Number>::Stored;
    using Leaver = openmp::Leaver<Number>;
    using Outgoing = openmp::Outgoing<Number>;
    using LeaverNotes = openmp::LeaverNotes<Number>;

    /// Consecutive leavers in a list that come to the same block.
    struct Flow
    {
        std::uint64_t from; ///< the key of the block that they leave; of new items not set
        std::uint64_t key;  ///< of the block that they come to
        Leaver const* first;
        std::uint32_t count;
        int to; ///< the index of the block that they come to
    };

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

    /// Makes room for the leavers: a loop that moves items records them block by block.
    void expect(std::size_t blocks)
    {
        outgoing_.resize(blocks);
        outflows_.resize(blocks);
    }

    /// Forgets all leavers: nothing has moved.
    void forget(std::size_t blocks)
    {
        expect(blocks);
        for (auto& of_block : outgoing_) of_block.clear();
        outflows_.assign(blocks, {});
        flows_.clear();
    }

    /// Records the leavers of a block of so many items. Returns those that must scatter at once, in the order
    /// of their cells: those that go to other cells of the same block, if they are many. Only their new cells
    /// need then be stored. If they are few, it is faster to scatter them later, with those that come from
    /// other blocks.
    std::span<Leaver const> note(std::size_t b, std::size_t items, LeaverNotes& notes)
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
        bool const are_many = outflow.to[here<d>] * most_listed_share > items;
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

    /// Records that an item leaves its block and goes nowhere.
    void erase(std::size_t b, OutgoingSlot const& from)
    {
        outgoing_[b].from.push_back(from);
        ++outflows_[b].outgoing;
    }
    /// Lists an item that comes to the block with this key. Consecutive ones lie side by side in memory.
    void insert(std::uint64_t key, Leaver const* item)
    {
        if (flows_.empty() || flows_.back().key != key) flows_.push_back({0, key, item, 0, BlockMap::absent});
        ++flows_.back().count;
    }

    /// Lists the leavers by the blocks that they come to; those of each block are already sorted by
    /// direction.
    template <class Blocks>
    void list_flows(Blocks const& blocks, Periods<d> const& periods)
    {
        flows_.clear();
        for (std::size_t b = 0; b < outflows_.size(); ++b) {
            Leaver const* first = outflows_[b].leavers;
            if (first == nullptr) continue;
            for (int direction = 0; direction < directions<d>; ++direction) {
                std::uint32_t const count = outflows_[b].to[std::size_t(direction)];
                if (count == 0) continue;
                auto const there = periods.wrapped(neighbour<d>(blocks[b].coordinates, direction));
                flows_.push_back({block_key<d>(blocks[b].coordinates), block_key<d>(there), first, count,
                                  BlockMap::absent});
                first += count;
            }
        }
    }

    std::span<Flow> flows() { return flows_; }
    /// How many numbers a leaver's contribution has; 0 if there are no leavers that have not scattered.
    std::size_t contribution_size() const
    {
        for (auto const& of_block : outgoing_)
            if (!of_block.leavers.empty()) return of_block.contribution.size() / of_block.leavers.size();
        return 0;
    }
    /// Hands the flows for which `goes_elsewhere(flow)` is true to `take(flow)`, and forgets them.
    template <class GoesElsewhere, class Take>
    void divert(GoesElsewhere const& goes_elsewhere, Take const& take)
    {
        std::erase_if(flows_, [&](Flow const& flow) {
            bool const goes = goes_elsewhere(flow);
            if (goes) take(flow);
            return goes;
        });
    }
    /// Adds flows from elsewhere. Those to one block are then in the order of the blocks that they left, as
    /// if these were all here.
    void admit(std::span<Flow const> from_elsewhere)
    {
        if (from_elsewhere.empty()) return;
        flows_.insert(flows_.end(), from_elsewhere.begin(), from_elsewhere.end());
        std::stable_sort(flows_.begin(), flows_.end(),
                         [](Flow const& a, Flow const& b) { return a.from < b.from; });
    }
    /// How many items leave an old block for others.
    std::uint32_t lost(std::size_t b) const { return outflows_[b].outgoing - outflows_[b].inside; }
    /// The items that leave their cells of an old block, in the order of slots.
    std::span<OutgoingSlot const> outgoing(std::size_t b) const { return outgoing_[b].from; }
    /// Those that came to other cells of the same block and have scattered, by cell.
    std::span<Leaver const> scattered_inside(std::size_t b) const { return outgoing_[b].scattered_inside; }
    /// The items that come to a new block and have not scattered, by cell.
    std::span<Leaver const> incoming(std::size_t b) const
    {
        return std::span(incoming_).subspan(incoming_begin_[b], incoming_begin_[b + 1] - incoming_begin_[b]);
    }

    /// Wraps the offsets of an old block's leavers into their new cells. There are no offsets if items were
    /// inserted or erased and none moved (see CellOrder::rearrange).
    void wrap(std::size_t b, std::array<Offset*, std::size_t(d)> const& offset) const
    {
        if (offset[0] == nullptr) return;
        for (auto const& from : outgoing_[b].from)
            for (int a = 0; a < d; ++a) CellOffset<Number>::wrap(offset[std::size_t(a)][from.slot]);
    }

    /// Sorts the flows by the block that they come to, and finds the places of incoming items. There are now
    /// so many blocks.
    void deal_incoming(std::size_t blocks)
    {
        incoming_begin_.assign(blocks + 1, 0);
        flow_begin_.assign(blocks + 2, 0); // those of block b begin at b + 1 until they are sorted
        for (Flow const& flow : flows_) {
            incoming_begin_[std::size_t(flow.to + 1)] += flow.count;
            ++flow_begin_[std::size_t(flow.to + 2)];
        }
        for (std::size_t b = 0; b < blocks; ++b) {
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

    /// Sorts what comes to a block by cell, and adds the number of items of each cell to `came`.
    void sort_incoming(std::size_t b, std::array<std::uint32_t, Shape::cells>& came)
    {
        sort_by_cell(std::span(flow_order_).subspan(flow_begin_[b], flow_begin_[b + 1] - flow_begin_[b]),
                     incoming_.data() + incoming_begin_[b], came);
    }

    /// Frees the lists of what has come, where every item was in them. There are now so many blocks.
    void free_incoming(std::size_t blocks)
    {
        decltype(flows_)().swap(flows_);
        decltype(flow_order_)().swap(flow_order_);
        decltype(incoming_)().swap(incoming_);
        incoming_begin_.assign(blocks + 1, 0);
    }

    std::size_t memory() const
    {
        auto const of = [](auto const& list) { return list.capacity() * sizeof(list[0]); };
        std::size_t lists = of(incoming_) + of(incoming_begin_) + of(outgoing_) + of(outflows_) + of(flows_) +
                            of(flow_begin_) + of(flow_order_);
        for (auto const& of_block : outgoing_)
            lists += of(of_block.from) + of(of_block.scattered_inside) + of(of_block.leavers) +
                     of(of_block.contribution);
        return lists;
    }

private:
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

    std::vector<Outgoing> outgoing_;                  ///< per old block
    std::vector<Outflow<Number, d>> outflows_;        ///< per old block
    std::vector<Flow> flows_;                         ///< by old block
    std::vector<std::span<Leaver const>> flow_order_; ///< the leavers of the flows, by new block
    std::vector<Leaver> incoming_;                    ///< by new block, and cell
    std::vector<std::uint32_t> incoming_begin_, flow_begin_;
};

} // namespace firn::openmp
