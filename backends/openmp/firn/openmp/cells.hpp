// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/block_map.hpp>
#include <firn/openmp/lanes.hpp>
#include <firn/openmp/share.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <omp.h>
#include <span>
#include <vector>

namespace firn::openmp
{

/// The order of cells: items by block, in a block by group of `lanes` cells, in a group interleaved by rank.
///
/// First come the first items of the group's cells, then the second ones, and so on, so that lane l of a pack
/// can work on cell l and read one run of memory. Items are not moved: `source` says where the item of each
/// slot lies. No result depends on the number of threads.
template <class Number, int d, int lanes>
class Cells
{
public:
    using Shape = BlockShape<d, lanes>;
    using Offset = typename CellOffset<Number>::Stored;

    /// Cells beyond this coordinate have no key (see block_key); one is kept in reserve for what is about to
    /// leave.
    static constexpr double largest_coordinate = d == 3 ? 4.0e6 : 1.0e9;
    /// Bytes per item: its source in the order that holds and in the one being written.
    static constexpr std::size_t bytes_per_item = 2 * sizeof(std::uint32_t);

    struct Block
    {
        Coordinates<d> coordinates;
        std::uint32_t begin = 0, end = 0; ///< its slots
    };

    /// Items of a block that have left their cells since the last follow(): their slots in rising order, and
    /// what each of them gives to the grid, its offset from the centre of its cell first; the loops that move
    /// items write this.
    struct Departures
    {
        std::vector<std::uint32_t> slots;
        std::vector<Number> given;
    };

    /// An item that has changed its cell.
    struct Mover
    {
        std::uint32_t source; ///< where the item lies
        std::uint16_t place;  ///< its cell now
        Number const* given;  ///< what it gives, its offset in the new cell first
    };

    /// `backend` says how many threads work.
    template <class Backend>
    explicit Cells(Backend const& backend) : threads_(backend.thread_count())
    {}

    std::size_t size() const { return blocks_.empty() ? 0 : blocks_.back().end; }
    std::span<Block const> blocks() const { return blocks_; }
    /// Changes whenever the set of blocks does.
    std::uint64_t version() const { return version_; }
    /// How many times the order was written anew.
    std::uint64_t generation() const { return generation_; }
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
    /// The slot behind the last of a group.
    std::uint32_t group_end(std::size_t block, int group) const
    {
        return group + 1 < Shape::groups ? group_begin(block, group + 1) : blocks_[block].end;
    }
    /// The items of a block that were in another cell before the last follow(), in the order of their cells.
    std::span<Mover const> movers(std::size_t block) const { return movers_[block]; }
    Departures& departures(std::size_t block) { return departures_[block]; }
    /// The block's index before the last follow(), or absent.
    int old_block(std::size_t block) const { return old_block_[block]; }
    /// The cells of some slots of a block, side by side in one group, counted along the last axis first.
    void find_places(std::size_t block, std::size_t slot, int count, int* places) const
    {
        auto const begins = group_begin_.data() + block * Shape::groups;
        int const group =
            static_cast<int>(std::upper_bound(begins, begins + Shape::groups, slot) - begins) - 1;
        for_each_rank(block, group, [&](std::uint32_t at, std::uint32_t, std::uint64_t pattern) {
            for (; pattern != 0; pattern &= pattern - 1, ++at)
                if (at >= slot && at < slot + count)
                    places[at - slot] = group * lanes + std::countr_zero(pattern);
        });
    }
    /// Where the items of the slots from `slot` on lie.
    std::uint32_t const* sources(std::size_t slot) const { return &source_[slot]; }
    std::size_t memory() const
    {
        auto const of = [](auto const& list) { return list.capacity() * sizeof(list[0]); };
        std::size_t lists = of(blocks_) + of(arrivals_) + of(stay_) + of(old_block_) + of(arrival_begin_);
        for (auto const& list : leavers_) lists += of(list);
        for (auto const& list : inside_) lists += of(list);
        for (auto const& list : movers_) lists += of(list);
        for (auto const& list : left_) lists += of(list);
        for (auto const& [slots, given] : departures_) lists += of(slots) + of(given);
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
        prepare_lists();
        for (std::size_t i = 0; i < cells.size(); ++i)
            leavers_.back().push_back(item_in(cells[i], static_cast<std::uint32_t>(first + i), nullptr));
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            departures_[b].slots.clear();
            stay_[b] = blocks_[b].end - blocks_[b].begin;
        }
        rearrange(size() + cells.size());
        // Every new item was in these lists; they need not stay so large.
        leavers_.clear();
        leavers_.shrink_to_fit();
        arrivals_.clear();
        arrivals_.shrink_to_fit();
        for (auto& list : movers_) std::vector<Mover>().swap(list);
    }

    /// Forgets the items for which `gone[where it lies]` is not 0, `kept` being the others, which will lie at
    /// `place[where it lies]`; they keep the order of ranks but for holes, which the last of a cell fill.
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        prepare_lists();
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            departures_[b].slots.clear();
            for (int group = 0; group < Shape::groups; ++group)
                for_each_rank(b, group, [&](std::uint32_t slot, std::uint32_t rank, std::uint64_t pattern) {
                    for (; pattern != 0; pattern &= pattern - 1, ++slot)
                        if (gone[source(slot)])
                            left_[b].push_back({rank, static_cast<std::uint16_t>(group * lanes +
                                                                                 std::countr_zero(pattern))});
                });
            stay_[b] = static_cast<std::uint32_t>(blocks_[b].end - blocks_[b].begin - left_[b].size());
        }
        rearrange(kept);
        for (std::size_t slot = 0; slot < kept; ++slot) source_[slot] = place[source_[slot]];
    }

    /// Moves the items that departed to their new cells, and wraps their offsets. An item lies at its slot
    /// (see settle).
    void follow(std::array<Offset*, d> const& offset)
    {
        prepare_lists();
        int const count = static_cast<int>(blocks_.size());
        share(threads_, count, 16, [&] { return [&](int b) { find_new_cells(b, offset); }; });
        rearrange(size());
    }

    /// Forgets departures: those that follow are written by a loop that moves items.
    void expect_departures()
    {
        departures_.resize(blocks_.size());
        for (auto& [slots, given] : departures_) {
            slots.clear();
            given.clear();
        }
    }

    /// Says that all items now lie at their slots.
    void settle() { settled_ = true; }

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

    /// Goes through a group rank by rank: `use(first slot of the rank, rank, one bit for each cell that has
    /// so many items)`.
    template <class Use>
    void for_each_rank(std::size_t block, int group, Use const& use) const
    {
        std::uint32_t slot = group_begin(block, group);
        std::uint32_t const end = group_end(block, group);
        for (std::uint32_t rank = 0; slot < end; ++rank) {
            std::uint64_t const pattern = lanes_above<lanes>(counts(block, group), rank);
            use(slot, rank, pattern);
            slot += static_cast<std::uint32_t>(std::popcount(pattern));
        }
    }

private:
    struct Item : Mover
    {
        Coordinates<d> block;
    };

    /// Where an item was that left: its cell in its block, and its rank there.
    struct Left
    {
        std::uint32_t rank;
        std::uint16_t place;
    };

    /// The sources of a group's items, a row of lanes for each rank, as one thread changes them.
    class Ranks
    {
    public:
        /// Starts with no items, in cells that will have `counts` of them after having had `before`.
        void start(std::uint32_t const* before, std::uint32_t const* counts)
        {
            before_ = before;
            counts_ = counts;
            next_.fill(0);
            auto const most = std::max(*std::max_element(before, before + lanes), //
                                       *std::max_element(counts, counts + lanes));
            if (at_.size() < std::size_t(most) * lanes) at_.resize(std::size_t(most) * lanes);
        }

        std::uint32_t* row(std::uint32_t rank) { return &at_[std::size_t(rank) * lanes]; }

        void leave(std::uint32_t rank, int lane) { row(rank)[lane] = hole; }

        /// Puts a new item into the first hole of a cell, or behind its items.
        void fill(int lane, std::uint32_t source)
        {
            auto& rank = next_[lane];
            while (rank < before_[lane] && row(rank)[lane] != hole) ++rank;
            row(rank++)[lane] = source;
        }

        /// Fills the holes that are left with the last items of their cells.
        void close_holes()
        {
            for (int lane = 0; lane < lanes; ++lane) {
                if (counts_[lane] >= before_[lane]) continue; // as many came as left
                std::uint32_t last = before_[lane];
                for (std::uint32_t rank = next_[lane]; rank < counts_[lane]; ++rank)
                    if (row(rank)[lane] == hole) {
                        do --last;
                        while (row(last)[lane] == hole);
                        row(rank)[lane] = row(last)[lane];
                    }
            }
        }

    private:
        static constexpr std::uint32_t hole = ~std::uint32_t(0);

        std::uint32_t const *before_ = nullptr, *counts_ = nullptr;
        std::array<std::uint32_t, lanes> next_; ///< the first rank that may be free
        std::vector<std::uint32_t> at_;
    };

    std::uint32_t source(std::size_t slot) const
    {
        return settled_ ? static_cast<std::uint32_t>(slot) : source_[slot];
    }

    static Item item_in(Coordinates<d> const& cell, std::uint32_t source, Number const* given)
    {
        Item item{{source, 0, given}, Coordinates<d>::Zero()};
        int place = 0;
        for (int a = 0; a < d; ++a) {
            int const extent = Shape::extent(a), inside = ((cell[a] % extent) + extent) % extent;
            item.block[a] = (cell[a] - inside) / extent;
            place = place * extent + inside;
        }
        item.place = static_cast<std::uint16_t>(place);
        return item;
    }

    void prepare_lists()
    {
        leavers_.resize(blocks_.size() + 1);
        for (auto& list : leavers_) list.clear();
        inside_.resize(blocks_.size());
        for (auto& list : inside_) list.clear();
        left_.resize(blocks_.size());
        for (auto& list : left_) list.clear();
        departures_.resize(blocks_.size());
        stay_.assign(blocks_.size(), 0);
    }

    /// Finds where the items go that departed from their cells: to another one of the block, or out of it.
    void find_new_cells(int b, std::array<Offset*, d> const& offset)
    {
        Block const& block = blocks_[b];
        // by name: clang captures no structured binding where OpenMP is
        std::vector<std::uint32_t>& slots = departures_[b].slots;
        std::vector<Number>& given = departures_[b].given;
        std::size_t const channels = slots.empty() ? 0 : given.size() / slots.size();
        std::size_t i = 0;
        for (int group = 0; i < slots.size(); ++group) {
            if (slots[i] >= group_end(b, group)) continue;
            for_each_rank(b, group, [&](std::uint32_t first, std::uint32_t rank, std::uint64_t pattern) {
                std::uint32_t const end = first + static_cast<std::uint32_t>(std::popcount(pattern));
                for (; i < slots.size() && slots[i] < end; ++i) {
                    std::uint32_t const slot = slots[i];
                    int const place = group * lanes + bit_place(pattern, slot - first);
                    left_[b].push_back({rank, static_cast<std::uint16_t>(place)});
                    Number* const gives = given.data() + i * channels;
                    Coordinates<d> cell = cell_at(block.coordinates, place);
                    for (int a = 0; a < d; ++a) {
                        cell[a] += CellOffset<Number>::wrap(offset[a][slot]);
                        if (channels > 0) gives[a] = CellOffset<Number>::value(offset[a][slot]);
                    }
                    Item const item = item_in(cell, slot, gives);
                    if (item.block == block.coordinates)
                        inside_[b].push_back(item);
                    else
                        leavers_[b].push_back(item);
                }
            });
        }
        stay_[b] = static_cast<std::uint32_t>(block.end - block.begin - leavers_[b].size());
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
        ++generation_;
        deal_arrivals(next);

        new_source_.resize(count);
        new_counts_.resize(next.size() * Shape::cells);
        new_group_begin_.resize(next.size() * Shape::groups);
        movers_.resize(next.size());
        int const blocks = static_cast<int>(next.size());
        share(threads_, blocks, 4,
              [&] { return [&, ranks = Ranks()](int b) mutable { sort_block(b, next[b], ranks); }; });
        std::swap(source_, new_source_);
        std::swap(counts_, new_counts_);
        std::swap(group_begin_, new_group_begin_);
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

    /// Collects the items that come into the cells of a block, in the order of its cells; `came` becomes the
    /// number for each.
    void collect_movers(int b, std::array<std::uint32_t, Shape::cells>& came)
    {
        std::span<Mover const> const inside = old_block_[b] != BlockMap::absent
                                                  ? std::span<Mover const>(inside_[old_block_[b]])
                                                  : std::span<Mover const>();
        auto const arrivals = std::span<Item const>(arrivals_).subspan(
            arrival_begin_[b], arrival_begin_[b + 1] - arrival_begin_[b]);
        came.fill(0);
        for (Mover const& mover : inside) ++came[mover.place];
        for (Mover const& mover : arrivals) ++came[mover.place];
        std::array<std::uint32_t, Shape::cells> next;
        std::exclusive_scan(came.begin(), came.end(), next.begin(), std::uint32_t(0));
        auto& movers = movers_[b];
        movers.resize(inside.size() + arrivals.size());
        for (Mover const& mover : inside) movers[next[mover.place]++] = mover;
        for (Mover const& mover : arrivals) movers[next[mover.place]++] = mover;
    }

    /// Orders a block's items by cell and rank, interleaved by rank within groups.
    ///
    /// Who stays in a cell keeps its rank, so that sources nearly follow one another; who leaves makes room
    /// for who comes, and if none comes for the last of the cell.
    void sort_block(int b, Block const& block, Ranks& ranks)
    {
        int const old = old_block_[b];
        static constexpr std::array<std::uint32_t, Shape::cells> none{};
        std::uint32_t const* const before =
            old != BlockMap::absent ? &counts_[std::size_t(old) * Shape::cells] : none.data();
        std::uint32_t* const counts = &new_counts_[std::size_t(b) * Shape::cells];
        std::array<std::uint32_t, Shape::cells> came;
        collect_movers(b, came);
        for (int cell = 0; cell < Shape::cells; ++cell) counts[cell] = before[cell] + came[cell];
        std::span<Left const> left;
        if (old != BlockMap::absent) left = left_[old];
        for (Left const& from : left) --counts[from.place];

        auto mover = movers_[b].begin();
        auto gone = left.begin();
        std::uint32_t slot = block.begin;
        for (int group = 0; group < Shape::groups; ++group) {
            int const first = group * lanes;
            new_group_begin_[std::size_t(b) * Shape::groups + group] = slot;
            ranks.start(before + first, counts + first);
            if (old != BlockMap::absent)
                for_each_rank(old, group, [&](std::uint32_t from, std::uint32_t rank, std::uint64_t pattern) {
                    std::uint32_t sources[lanes];
                    for (int l = 0; l < lanes; ++l) sources[l] = from + static_cast<std::uint32_t>(l);
                    expand<lanes>(settled_ ? sources : &source_[from], pattern, ranks.row(rank));
                });
            for (; gone != left.end() && gone->place < first + lanes; ++gone)
                ranks.leave(gone->rank, gone->place - first);
            for (; mover != movers_[b].end() && mover->place < first + lanes; ++mover)
                ranks.fill(mover->place - first, mover->source);
            ranks.close_holes();
            for (std::uint32_t rank = 0;; ++rank) {
                std::uint64_t const pattern = lanes_above<lanes>(counts + first, rank);
                if (pattern == 0) break;
                compress<lanes>(ranks.row(rank), pattern, &new_source_[slot]);
                slot += static_cast<std::uint32_t>(std::popcount(pattern));
            }
        }
    }

    int threads_;
    bool settled_ = true;
    std::uint64_t version_ = 0, generation_ = 0;
    std::vector<Block> blocks_;
    BlockMap map_;
    Array<std::uint32_t> source_, new_source_, counts_, new_counts_, group_begin_, new_group_begin_;
    std::vector<std::vector<Item>> leavers_; ///< per block, and last those that are new
    std::vector<std::uint32_t> stay_;
    std::vector<int> old_block_;
    std::vector<std::vector<Mover>> inside_; ///< per block before: those that stay in it
    std::vector<std::vector<Left>> left_;    ///< per block before, as departures
    std::vector<std::vector<Mover>> movers_; ///< per block now, by cell
    std::vector<Departures> departures_;     ///< per block before
    std::vector<Item> arrivals_;
    std::vector<std::uint32_t> arrival_begin_, arrival_end_;
};

} // namespace firn::openmp
