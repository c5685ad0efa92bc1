// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/block_map.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <omp.h>
#include <span>
#include <vector>

namespace firn::openmp
{

/// The order of cells: items by block, in a block by group of `lanes` cells, in a group interleaved by rank.
///
/// First come the first items of the group's cells, then the second ones, and so on, so that lane l of a pack
/// can work on cell l and read one run of memory. Items are not moved: `source` says where the item of each
/// slot lies. Within a cell the order is stable, and no result depends on the number of threads.
template <class Number, int d, int lanes>
class Cells
{
public:
    using Shape = BlockShape<d, lanes>;
    using Offset = typename CellOffset<Number>::Stored;

    /// Cells beyond this coordinate have no key (see block_key); one is kept in reserve for what is about to
    /// leave.
    static constexpr double largest_coordinate = d == 3 ? 4.0e6 : 1.0e9;
    /// Bytes per item: source and place in its block, of the order that holds and of the one being written.
    static constexpr std::size_t bytes_per_item = 2 * sizeof(std::uint32_t) + 3 * sizeof(std::uint16_t);

    struct Block
    {
        Coordinates<d> coordinates;
        std::uint32_t begin = 0, end = 0; ///< its slots
    };

    /// `backend` says how many threads work.
    template <class Backend>
    explicit Cells(Backend const& backend) : threads_(backend.thread_count())
    {}

    std::size_t size() const { return blocks_.empty() ? 0 : blocks_.back().end; }
    std::span<Block const> blocks() const { return blocks_; }
    BlockMap const& map() const { return map_; }
    /// Changes whenever the set of blocks does.
    std::uint64_t version() const { return version_; }
    /// The number of items in each cell of a group.
    std::uint32_t const* counts(std::size_t block, int group) const
    {
        return &counts_[block * Shape::cells + group * lanes];
    }
    /// The first slot of a group.
    std::uint32_t group_begin(std::size_t block, int group) const
    {
        return group_begin_[block * Shape::groups + group];
    }
    /// Where the items of the slots from `slot` on lie.
    std::uint32_t const* sources(std::size_t slot) const { return &source_[slot]; }
    std::size_t memory() const
    {
        return source_.memory() + new_source_.memory() + place_.memory() + new_place_.memory() +
               counts_.memory() + group_begin_.memory() + map_.memory() + blocks_.capacity() * sizeof(Block);
    }

    /// Adds items that lie at first, first + 1, … in the given cells.
    void insert(std::span<Coordinates<d> const> cells, std::uint32_t first)
    {
        leavers_.resize(blocks_.size() + 1);
        for (auto& list : leavers_) list.clear();
        for (std::size_t i = 0; i < cells.size(); ++i)
            leavers_.back().push_back(item_in(cells[i], static_cast<std::uint32_t>(first + i)));
        for (std::size_t slot = 0; slot < size(); ++slot) new_place_[slot] = place_[slot];
        stay_.assign(blocks_.size(), 0);
        for (std::size_t b = 0; b < blocks_.size(); ++b) stay_[b] = blocks_[b].end - blocks_[b].begin;
        rearrange(size() + cells.size());
    }

    /// Moves items whose offset from the centre of their cell, in cells, has left [-1/2, 1/2) to their new
    /// cells, and the offsets with them. An item lies at its slot (see settle).
    void follow(std::array<Offset*, d> const& offset)
    {
        leavers_.resize(blocks_.size() + 1);
        stay_.assign(blocks_.size(), 0);
        leavers_.back().clear();
        int const count = static_cast<int>(blocks_.size());
#pragma omp parallel for schedule(dynamic, 4) num_threads(threads_)
        for (int b = 0; b < count; ++b) find_leavers(b, offset);
        rearrange(size());
    }

    /// Says that all items now lie at their slots.
    void settle() { settled_ = true; }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        for (Block const& block : blocks_)
            for (std::uint32_t slot = block.begin; slot < block.end; ++slot)
                visit(std::size_t{source(slot)}, cell_at(block.coordinates, place_[slot]));
    }

private:
    static constexpr std::uint16_t gone = 0xffff;

    struct Item
    {
        Coordinates<d> block;
        std::uint32_t source;
        std::uint16_t place;
    };

    std::uint32_t source(std::size_t slot) const
    {
        return settled_ ? static_cast<std::uint32_t>(slot) : source_[slot];
    }

    static Item item_in(Coordinates<d> const& cell, std::uint32_t source)
    {
        Item item{Coordinates<d>::Zero(), source, 0};
        int place = 0;
        for (int a = 0; a < d; ++a) {
            int const extent = Shape::extent(a), inside = ((cell[a] % extent) + extent) % extent;
            item.block[a] = (cell[a] - inside) / extent;
            place = place * extent + inside;
        }
        item.place = static_cast<std::uint16_t>(place);
        return item;
    }

    static Coordinates<d> cell_at(Coordinates<d> const& block, int place)
    {
        Coordinates<d> cell;
        for (int a = d - 1; a >= 0; --a) {
            cell[a] = block[a] * Shape::extent(a) + place % Shape::extent(a);
            place /= Shape::extent(a);
        }
        return cell;
    }

    void find_leavers(int b, std::array<Offset*, d> const& offset)
    {
        auto& leavers = leavers_[b];
        leavers.clear();
        Block const& block = blocks_[b];
        for (std::uint32_t slot = block.begin; slot < block.end; ++slot) {
            new_place_[slot] = place_[slot];
            Coordinates<d> by;
            for (int a = 0; a < d; ++a) by[a] = CellOffset<Number>::wrap(offset[a][slot]);
            if (by.isZero()) continue;
            Coordinates<d> const cell = cell_at(block.coordinates, place_[slot]) + by;
            Item const item = item_in(cell, slot);
            if (item.block == block.coordinates)
                new_place_[slot] = item.place;
            else {
                new_place_[slot] = gone;
                leavers.push_back(item);
            }
        }
        stay_[b] = static_cast<std::uint32_t>(block.end - block.begin - leavers.size());
    }

    /// Writes the new order: the items that stay in their block, and those that come from elsewhere.
    void rearrange(std::size_t count)
    {
        std::vector<Block> next = blocks_with_items();
        bool same = next.size() == blocks_.size();
        for (std::size_t b = 0; same && b < next.size(); ++b)
            same = next[b].coordinates == blocks_[b].coordinates;
        old_block_.assign(next.size(), BlockMap::absent);
        for (std::size_t b = 0; b < next.size(); ++b)
            old_block_[b] = same ? int(b) : map_.find(block_key<d>(next[b].coordinates));
        if (!same) {
            map_.clear(next.size());
            for (std::size_t b = 0; b < next.size(); ++b)
                map_.insert(block_key<d>(next[b].coordinates), int(b));
            ++version_;
        }
        deal_arrivals(next);

        new_source_.resize(count);
        for (auto* places : {&place_, &new_place_}) places->resize(count);
        after_place_.resize(count);
        counts_.resize(next.size() * Shape::cells);
        group_begin_.resize(next.size() * Shape::groups);
        int const blocks = static_cast<int>(next.size());
#pragma omp parallel num_threads(threads_)
        {
            std::vector<std::uint32_t> sorted;
#pragma omp for schedule(dynamic, 4)
            for (int b = 0; b < blocks; ++b) sort_block(b, next[b], sorted);
        }
        std::swap(source_, new_source_);
        std::swap(place_, after_place_);
        blocks_ = std::move(next);
        settled_ = false;
    }

    /// All blocks that will hold items, in the order of their keys.
    std::vector<Block> blocks_with_items()
    {
        std::vector<Coordinates<d>> fresh;
        for (auto const& list : leavers_)
            for (Item const& item : list) {
                int const existing = map_.find(block_key<d>(item.block));
                if (existing == BlockMap::absent)
                    fresh.push_back(item.block);
                else
                    ++stay_[existing];
            }
        std::vector<Block> next;
        next.reserve(blocks_.size() + 64);
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            if (stay_[b] > 0) next.push_back({blocks_[b].coordinates});
        auto const before = [](auto const& a, auto const& b) { return block_key<d>(a) < block_key<d>(b); };
        std::sort(fresh.begin(), fresh.end(), before);
        fresh.erase(std::unique(fresh.begin(), fresh.end()), fresh.end());
        std::size_t const old = next.size();
        for (auto const& block : fresh) next.push_back({block});
        std::inplace_merge(
            next.begin(), next.begin() + static_cast<std::ptrdiff_t>(old), next.end(),
            [&](Block const& a, Block const& b) { return before(a.coordinates, b.coordinates); });
        return next;
    }

    /// Sorts what arrives by its block, in the order in which it left, and finds each block's slots.
    void deal_arrivals(std::vector<Block>& next)
    {
        arrival_begin_.assign(next.size() + 1, 0);
        for (auto const& list : leavers_)
            for (Item const& item : list) ++arrival_begin_[map_.find(block_key<d>(item.block)) + 1];
        std::uint32_t slot = 0;
        for (std::size_t b = 0; b < next.size(); ++b) {
            // stay_ counts arrivals to blocks that existed before, too: those are taken off again
            std::uint32_t const arrivals = arrival_begin_[b + 1];
            std::uint32_t const total = old_block_[b] == BlockMap::absent ? arrivals : stay_[old_block_[b]];
            next[b].begin = slot;
            next[b].end = slot += total;
            arrival_begin_[b + 1] += arrival_begin_[b];
        }
        arrivals_.resize(arrival_begin_.back());
        arrival_end_.assign(arrival_begin_.begin(), arrival_begin_.end() - 1);
        for (auto const& list : leavers_)
            for (Item const& item : list)
                arrivals_[arrival_end_[map_.find(block_key<d>(item.block))]++] = item;
    }

    /// Counting sort of a block's items by cell, then interleaving by rank within groups.
    void sort_block(int b, Block const& block, std::vector<std::uint32_t>& sorted)
    {
        std::uint32_t* const counts = &counts_[std::size_t(b) * Shape::cells];
        std::fill(counts, counts + Shape::cells, 0u);
        auto const for_each_item = [&](auto const& use) {
            if (int const old = old_block_[b]; old != BlockMap::absent)
                for (std::uint32_t slot = blocks_[old].begin; slot < blocks_[old].end; ++slot)
                    if (new_place_[slot] != gone) use(new_place_[slot], source(slot));
            for (std::uint32_t i = arrival_begin_[b]; i < arrival_begin_[b + 1]; ++i)
                use(arrivals_[i].place, arrivals_[i].source);
        };
        for_each_item([&](std::uint16_t place, std::uint32_t) { ++counts[place]; });

        std::array<std::uint32_t, Shape::cells> next;
        std::uint32_t sum = 0;
        for (int cell = 0; cell < Shape::cells; ++cell) {
            next[cell] = sum;
            sum += counts[cell];
        }
        sorted.resize(sum);
        for_each_item([&](std::uint16_t place, std::uint32_t from) { sorted[next[place]++] = from; });

        std::uint32_t slot = block.begin;
        for (int group = 0; group < Shape::groups; ++group) {
            group_begin_[std::size_t(b) * Shape::groups + group] = slot;
            int const first = group * lanes;
            std::uint32_t const end = slot + (next[first + lanes - 1] - (next[first] - counts[first]));
            for (std::uint32_t rank = 0; slot < end; ++rank)
                for (int cell = first; cell < first + lanes; ++cell)
                    if (rank < counts[cell]) {
                        new_source_[slot] = sorted[next[cell] - counts[cell] + rank];
                        after_place_[slot++] = static_cast<std::uint16_t>(cell);
                    }
        }
    }

    int threads_;
    bool settled_ = true;
    std::uint64_t version_ = 0;
    std::vector<Block> blocks_;
    BlockMap map_;
    Array<std::uint32_t> source_, new_source_, counts_, group_begin_;
    Array<std::uint16_t> place_, new_place_, after_place_;
    std::vector<std::vector<Item>> leavers_; ///< per block, and last those that are new
    std::vector<std::uint32_t> stay_;
    std::vector<int> old_block_;
    std::vector<Item> arrivals_;
    std::vector<std::uint32_t> arrival_begin_, arrival_end_;
};

} // namespace firn::openmp
