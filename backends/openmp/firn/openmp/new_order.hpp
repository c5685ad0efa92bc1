// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/array.hpp>
#include <firn/openmp/compress.hpp>
#include <firn/openmp/leavers.hpp>
#include <firn/openmp/ranks.hpp>
#include <firn/openmp/tuning.hpp>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>

// How the order of a block's items is written anew after some have left and others have come.
namespace firn::openmp
{

/// Visits a group of cells rank by rank, from its first slot to its end: `use(first slot of the rank, rank,
/// one bit for each cell that has so many items)`.
template <int lanes, class Use>
void for_each_rank(std::uint32_t const* counts, std::uint32_t slot, std::uint32_t end, Use const& use)
{
    for (std::uint32_t rank = 0; slot < end; ++rank) {
        std::uint64_t const pattern = lanes_above<lanes>(counts, rank);
        use(slot, rank, pattern);
        slot += static_cast<std::uint32_t>(std::popcount(pattern));
    }
}

/// The order of items in all blocks.
template <class Shape>
struct OrderTable
{
    Array<std::uint32_t> source;      ///< where the item of each slot lies
    Array<std::uint32_t> counts;      ///< of items in each cell, by block
    Array<std::uint32_t> group_begin; ///< the first slot of each group of cells, by block

    void resize(std::size_t items, std::size_t blocks)
    {
        source.resize(items);
        counts.resize(blocks * Shape::cells);
        group_begin.resize(blocks * Shape::groups);
    }
    void swap(OrderTable& other)
    {
        source.swap(other.source);
        counts.swap(other.counts);
        group_begin.swap(other.group_begin);
    }
    std::size_t memory() const { return source.memory() + counts.memory() + group_begin.memory(); }
};

/// A block in an order that is being replaced. A block that is new has no items in it.
template <class Shape>
struct OldBlock
{
    static constexpr std::array<std::uint32_t, Shape::cells> none{};

    std::uint32_t const* counts = none.data();      ///< of items in each cell
    std::uint32_t const* group_begin = none.data(); ///< the first slot of each group
    std::uint32_t end = 0;                          ///< the slot behind the last
    std::uint32_t const* source = nullptr;          ///< by slot; null if items lie at their slots
};

/// Where the new order of a block is written.
struct NewBlock
{
    std::uint32_t* counts;      ///< of items in each cell; those that leave still count
    std::uint32_t* group_begin; ///< the first slot of each group
    std::uint32_t* source;      ///< by slot
    std::uint32_t first_slot;
};

/// What changes in a block.
template <class Number>
struct ChangesOfBlock
{
    std::span<OutgoingSlot const> outgoing;   ///< the items that leave their cells, by slot
    std::span<Leaver<Number> const> inside;   ///< those that came to other cells of the block, by cell
    std::span<Leaver<Number> const> incoming; ///< those that come and have not scattered yet, by cell
};

/// Orders a block's items by cell and rank, interleaved by rank within groups.
///
/// An item that stays in a cell keeps its rank, so that sources are nearly consecutive. The hole of a leaver
/// is filled by an incoming item, or else by the last item of the cell.
template <class Shape, int lanes, class Number>
void write_block(OldBlock<Shape> const& old, ChangesOfBlock<Number> const& changes, NewBlock const& to,
                 Ranks<lanes>& ranks)
{
    auto outgoing = changes.outgoing.begin();
    auto inside = changes.inside.begin();
    auto incoming = changes.incoming.begin();
    std::uint32_t slot = to.first_slot;
    for (int group = 0; group < Shape::groups; ++group) {
        int const first = group * lanes;
        to.group_begin[group] = slot;
        auto const comes_here = [&](auto next, auto const& list) {
            return next != list.end() && next->place < first + lanes;
        };
        std::uint32_t const begin = old.group_begin[group],
                            end = group + 1 < Shape::groups ? old.group_begin[group + 1] : old.end;
        bool const stays_as_it_is =
            old.source == nullptr && (outgoing == changes.outgoing.end() || outgoing->slot >= end) &&
            !comes_here(inside, changes.inside) && !comes_here(incoming, changes.incoming);
        if (stays_as_it_is) {
            std::iota(to.source + slot, to.source + slot + (end - begin), begin);
            slot += end - begin;
            continue;
        }
        ranks.start(old.counts + first, to.counts + first);
        for_each_rank<lanes>(old.counts + first, begin, end,
                             [&](std::uint32_t from, std::uint32_t rank, std::uint64_t pattern) {
                                 std::uint32_t sources[std::size_t(lanes)];
                                 count_up<lanes>(from, sources);
                                 expand<lanes>(old.source == nullptr ? sources : old.source + from, pattern,
                                               ranks.row(rank));
                             });
        for (; outgoing != changes.outgoing.end() && outgoing->slot < end; ++outgoing) {
            ranks.leave(outgoing->at);
            --to.counts[std::uint32_t(first) + outgoing->at % lanes];
        }
        for (; comes_here(inside, changes.inside); ++inside)
            ranks.fill(inside->place - first, inside->source);
        for (; comes_here(incoming, changes.incoming); ++incoming)
            ranks.fill(incoming->place - first, incoming->source);
        ranks.close_holes();
        for (std::uint32_t rank = 0;; ++rank) {
            std::uint64_t const pattern = lanes_above<lanes>(to.counts + first, rank);
            if (pattern == 0) break;
            compress<lanes>(ranks.row(rank), pattern, to.source + slot);
            slot += static_cast<std::uint32_t>(std::popcount(pattern));
        }
    }
}

} // namespace firn::openmp
