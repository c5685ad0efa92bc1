// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
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
#include <omp.h>
#include <span>
#include <utility>
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

    /// Makes room in a list for more: there is one for each block, and together they would waste much if each
    /// grew to twice its size.
    template <class T>
    static void make_room(std::vector<T>& list, std::size_t more)
    {
        std::size_t const needed = list.size() + more;
        if (needed > list.capacity()) list.reserve(std::max(needed, list.capacity() + list.capacity() / 8));
    }

    /// Items of a block that have left their cells since the last follow(); the loops that move items write
    /// this.
    struct Departures
    {
        std::vector<std::uint32_t> slots;  ///< in rising order
        std::vector<std::uint16_t> places; ///< of each: its cell now, or elsewhere
        std::vector<Number> given;         ///< by those that went elsewhere, see Mover
    };
    /// Instead of a cell of the block: listed as one that comes to a block, another one or the same.
    static constexpr std::uint16_t elsewhere = 0xffff;

    /// An item that has changed its cell.
    struct Mover
    {
        std::uint32_t source; ///< where the item lies
        std::uint16_t place;  ///< its cell now
        Number const* given;  ///< what it gives, its offset in the new cell first
    };

    /// Those that have left their cells in one block, while it is being worked on.
    struct Leavers
    {
        std::vector<std::array<signed char, d>> steps; ///< cells along the axes; as Departures::slots
        std::vector<Number> given;                     ///< the same, see Mover
        std::vector<Mover> inside;                     ///< who goes to another cell of the block
        std::vector<Mover> in_order;                   ///< the same in the order of cells

        void start()
        {
            steps.clear();
            given.clear();
            inside.clear();
        }
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
    /// The items of a block that have come to it in the last follow() and not yet given, in the order of
    /// their cells.
    std::span<Mover const> movers(std::size_t block) const
    {
        return std::span(arrivals_).subspan(arrival_begin_[block],
                                            arrival_begin_[block + 1] - arrival_begin_[block]);
    }
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
        std::size_t lists =
            of(blocks_) + of(arrivals_) + of(stay_) + of(old_block_) + of(block_now_) + of(arrival_begin_);
        for (auto const& list : leavers_) lists += of(list);
        for (auto const& [slots, places, given] : departures_) lists += of(slots) + of(places) + of(given);
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
        expect_departures();
        for (std::size_t i = 0; i < cells.size(); ++i)
            leavers_.back().push_back(item_in(cells[i], static_cast<std::uint32_t>(first + i)));
        rearrange(size() + cells.size());
        // Every new item was in these lists; they need not stay so large.
        decltype(leavers_)().swap(leavers_);
        decltype(arrivals_)().swap(arrivals_);
        arrival_begin_.assign(blocks_.size() + 1, 0);
    }

    /// Forgets the items for which `gone[where it lies]` is not 0, `kept` being the others, which will lie at
    /// `place[where it lies]`; they keep the order of ranks but for holes, which the last of a cell fill.
    void erase(unsigned char const* gone, std::uint32_t const* place, std::size_t kept)
    {
        expect_departures();
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            for (int group = 0; group < Shape::groups; ++group)
                for_each_rank(b, group, [&](std::uint32_t slot, std::uint32_t, std::uint64_t pattern) {
                    for (; pattern != 0; pattern &= pattern - 1, ++slot)
                        if (gone[source(slot)]) {
                            departures_[b].slots.push_back(slot);
                            departures_[b].places.push_back(elsewhere);
                        }
                });
        rearrange(kept);
        for (std::size_t slot = 0; slot < kept; ++slot) source_[slot] = place[source_[slot]];
    }

    /// Moves the items that departed to their new cells, and wraps their offsets. An item lies at its slot
    /// (see settle).
    void follow(std::array<Offset*, d> const& offset)
    {
        share(threads_, static_cast<int>(blocks_.size()), 16, [&] {
            return [&](int b) {
                for (std::uint32_t const slot : departures_[b].slots)
                    for (int a = 0; a < d; ++a) CellOffset<Number>::wrap(offset[a][slot]);
                // the list of what they give does not grow any more
                std::size_t const count = leavers_[b].size();
                std::size_t const channels = count == 0 ? 0 : departures_[b].given.size() / count;
                for (std::size_t i = 0; i < count; ++i)
                    leavers_[b][i].given = departures_[b].given.data() + i * channels;
            };
        });
        rearrange(size());
    }

    /// Finds where those go that have left their cells in a block.
    void find_new_cells(std::size_t b, Leavers& leavers)
    {
        Departures& departures = departures_[b];
        std::size_t i = 0;
        std::size_t const count = departures.slots.size();
        make_room(departures.places, count);
        for (int group = 0; i < count; ++group) {
            if (departures.slots[i] >= group_end(b, group)) continue;
            for_each_rank(b, group, [&](std::uint32_t first, std::uint32_t, std::uint64_t pattern) {
                std::uint32_t const end = first + static_cast<std::uint32_t>(std::popcount(pattern));
                for (; i < count && departures.slots[i] < end; ++i) {
                    std::uint32_t const slot = departures.slots[i];
                    int const place = group * lanes + bit_place(pattern, slot - first);
                    Coordinates<d> cell = cell_at(blocks_[b].coordinates, place);
                    for (int a = 0; a < d; ++a) cell[a] += leavers.steps[i][a];
                    Item const item = item_in(cell, slot);
                    bool const is_inside = is_same_block<d>(item.block, blocks_[b].coordinates);
                    departures.places.push_back(is_inside ? item.place : elsewhere);
                    if (is_inside)
                        leavers.inside.push_back(item);
                    else
                        leave(b, item, i, leavers);
                }
            });
        }
    }

    /// Those of a block that are to give at once, in the order of their cells, when it is known where all of
    /// them go: who goes to another cell of the block, if they are many. Nothing need be kept of them but
    /// where they went. A few give together with those who come from other blocks, which takes less time.
    std::span<Mover const> give_at_once(std::size_t b, Leavers& leavers)
    {
        Departures& departures = departures_[b];
        bool const are_many = leavers.inside.size() * share_to_keep > blocks_[b].end - blocks_[b].begin;
        std::size_t const channels =
            leavers.inside.empty() ? 0 : leavers.given.size() / departures.slots.size();
        std::size_t i = 0;
        for (Mover& mover : leavers.inside) {
            while (departures.places[i] == elsewhere) ++i;
            if (are_many)
                mover.given = leavers.given.data() + i * channels;
            else {
                departures.places[i] = elsewhere;
                leave(b, {mover, blocks_[b].coordinates}, i, leavers);
            }
            ++i;
        }
        if (!are_many) return {};
        std::array<std::uint32_t, Shape::cells> counts{};
        sort_by_cell(leavers.inside, leavers.in_order, counts);
        return leavers.in_order;
    }

    /// Forgets departures: those that follow are written by a loop that moves items.
    void expect_departures()
    {
        departures_.resize(blocks_.size());
        for (auto& [slots, places, given] : departures_) {
            slots.clear();
            places.clear();
            given.clear();
        }
        leavers_.resize(blocks_.size() + 1);
        for (auto& list : leavers_) list.clear();
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
        int to = BlockMap::absent; ///< the block's index in the new order
    };

    /// The sources of a group's items, a row of lanes for each rank, as one thread changes them.
    class Ranks
    {
    public:
        /// Starts with no items, in cells that have had `before` of them and will have `counts`, which are
        /// now at most too large.
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

    /// What a thread sorts blocks with.
    struct Sorter
    {
        Ranks ranks;
        std::vector<Mover> inside, unsorted, sorted;
    };

    std::uint32_t source(std::size_t slot) const
    {
        return settled_ ? static_cast<std::uint32_t>(slot) : source_[slot];
    }

    /// Lists one of a block's departures, number i of them, as one to come to a block.
    void leave(std::size_t b, Item const& item, std::size_t i, Leavers const& leavers)
    {
        std::size_t const channels = leavers.given.size() / departures_[b].slots.size();
        make_room(leavers_[b], 1);
        leavers_[b].push_back(item);
        auto& given = departures_[b].given;
        make_room(given, channels);
        given.resize(given.size() + channels);
        std::copy_n(leavers.given.data() + i * channels, channels, given.data() + given.size() - channels);
    }

    static Item item_in(Coordinates<d> const& cell, std::uint32_t source)
    {
        Item item{{source, 0, nullptr}, zeros<Coordinates<d>>()};
        int place = 0;
        for (int a = 0; a < d; ++a) {
            int const extent = Shape::extent(a), inside = ((cell[a] % extent) + extent) % extent;
            item.block[a] = (cell[a] - inside) / extent;
            place = place * extent + inside;
        }
        item.place = static_cast<std::uint16_t>(place);
        return item;
    }

    /// Sorts items by cell, those of one cell in the order in which they are listed, and adds the number of
    /// each cell's to `counts`.
    static void sort_by_cell(std::vector<Mover> const& items, std::vector<Mover>& sorted,
                             std::array<std::uint32_t, Shape::cells>& counts)
    {
        sorted.resize(items.size());
        if (items.empty()) return;
        std::array<std::uint32_t, Shape::cells> next;
        next.fill(0);
        for (Mover const& item : items) ++next[item.place];
        std::uint32_t before = 0;
        for (int cell = 0; cell < Shape::cells; ++cell) {
            counts[cell] += next[cell];
            before += std::exchange(next[cell], before);
        }
        for (Mover const& item : items) sorted[next[item.place]++] = item;
    }

    /// Writes the new order: the items that stay in their block, and those that come from elsewhere.
    void rearrange(std::size_t count)
    {
        stay_.resize(blocks_.size());
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            auto const& places = departures_[b].places;
            auto const left = std::count(places.begin(), places.end(), elsewhere);
            stay_[b] = blocks_[b].end - blocks_[b].begin - static_cast<std::uint32_t>(left);
        }
        std::vector<Block> next = blocks_with_items();
        bool same = next.size() == blocks_.size();
        for (std::size_t b = 0; same && b < next.size(); ++b)
            same = is_same_block<d>(next[b].coordinates, blocks_[b].coordinates);
        old_block_.assign(next.size(), BlockMap::absent);
        block_now_.assign(blocks_.size(), BlockMap::absent);
        for (std::size_t b = 0; b < next.size(); ++b) {
            old_block_[b] = same ? int(b) : map_.find(block_key<d>(next[b].coordinates));
            if (old_block_[b] != BlockMap::absent) block_now_[old_block_[b]] = int(b);
        }
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
        int const blocks = static_cast<int>(next.size());
        share(threads_, blocks, 4,
              [&] { return [&, sorter = Sorter()](int b) mutable { sort_block(b, next[b], sorter); }; });
        std::swap(source_, new_source_);
        std::swap(counts_, new_counts_);
        std::swap(group_begin_, new_group_begin_);
        blocks_ = std::move(next);
        settled_ = false;
    }

    /// Whether an item of a block's list goes to that block; the last list is of none.
    bool comes_back(std::size_t b, Item const& item) const
    {
        return b < blocks_.size() && is_same_block<d>(item.block, blocks_[b].coordinates);
    }

    /// All blocks that will hold items, in the order of their keys.
    std::vector<Block> blocks_with_items()
    {
        std::vector<std::uint64_t> fresh;
        for (std::size_t b = 0; b < leavers_.size(); ++b)
            for (Item const& item : leavers_[b]) {
                auto const key = block_key<d>(item.block);
                int const existing = comes_back(b, item) ? int(b) : map_.find(key);
                if (existing == BlockMap::absent)
                    fresh.push_back(key);
                else
                    ++stay_[existing];
            }
        std::sort(fresh.begin(), fresh.end());
        fresh.erase(std::unique(fresh.begin(), fresh.end()), fresh.end());
        std::vector<Block> next;
        next.reserve(blocks_.size() + fresh.size());
        // both lists are in order: a loop here, since compilers take long for std::inplace_merge
        auto added = fresh.begin();
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            if (stay_[b] == 0) continue;
            auto const key = block_key<d>(blocks_[b].coordinates);
            for (; added != fresh.end() && *added < key; ++added) next.push_back({block_of_key<d>(*added)});
            next.push_back({blocks_[b].coordinates});
        }
        for (; added != fresh.end(); ++added) next.push_back({block_of_key<d>(*added)});
        return next;
    }

    /// Sorts what arrives by its block, in the order in which it left, and finds each block's slots.
    void deal_arrivals(std::vector<Block>& next)
    {
        arrival_begin_.assign(next.size() + 1, 0);
        for (std::size_t b = 0; b < leavers_.size(); ++b)
            for (Item& item : leavers_[b]) {
                item.to = comes_back(b, item) ? block_now_[b] : map_.find(block_key<d>(item.block));
                ++arrival_begin_[item.to + 1];
            }
        std::uint32_t slot = 0;
        for (std::size_t b = 0; b < next.size(); ++b) {
            // stay_ counts arrivals to blocks that existed before, too: those are taken off again
            std::uint32_t const arrivals = arrival_begin_[b + 1];
            std::uint32_t const total = old_block_[b] == BlockMap::absent ? arrivals : stay_[old_block_[b]];
            next[b].begin = slot;
            next[b].end = slot += total;
            arrival_begin_[b + 1] += arrival_begin_[b];
        }
        arrivals_.clear();
        make_room(arrivals_, arrival_begin_.back());
        arrivals_.resize(arrival_begin_.back());
        arrival_end_.resize(next.size());
        std::copy_n(arrival_begin_.data(), next.size(), arrival_end_.data());
        for (auto const& list : leavers_)
            for (Item const& item : list) arrivals_[arrival_end_[item.to]++] = item;
    }

    /// Orders a block's items by cell and rank, interleaved by rank within groups.
    ///
    /// Who stays in a cell keeps its rank, so that sources nearly follow one another; who leaves makes room
    /// for who comes, and if none comes for the last of the cell.
    void sort_block(int b, Block const& block, Sorter& sorter)
    {
        int const old = old_block_[b];
        static constexpr std::array<std::uint32_t, Shape::cells> none{};
        std::uint32_t const* const before =
            old != BlockMap::absent ? &counts_[std::size_t(old) * Shape::cells] : none.data();
        std::uint32_t* const counts = &new_counts_[std::size_t(b) * Shape::cells];
        std::span<std::uint32_t const> gone;
        if (old != BlockMap::absent) gone = departures_[old].slots;
        std::array<std::uint32_t, Shape::cells> came = find_who_comes(b, sorter);
        for (int cell = 0; cell < Shape::cells; ++cell) counts[cell] = before[cell] + came[cell];

        Ranks& ranks = sorter.ranks;
        auto left = gone.begin();
        std::span<Mover const> const arrivals = movers(b);
        auto mover = sorter.inside.cbegin();
        auto arrival = arrivals.begin();
        std::uint32_t slot = block.begin;
        for (int group = 0; group < Shape::groups; ++group) {
            int const first = group * lanes;
            new_group_begin_[std::size_t(b) * Shape::groups + group] = slot;
            ranks.start(before + first, counts + first);
            if (old != BlockMap::absent)
                for_each_rank(old, group, [&](std::uint32_t from, std::uint32_t rank, std::uint64_t pattern) {
                    std::uint32_t sources[lanes];
                    count_up(from, sources);
                    expand<lanes>(settled_ ? sources : &source_[from], pattern, ranks.row(rank));
                    std::uint32_t const end = from + static_cast<std::uint32_t>(std::popcount(pattern));
                    for (; left != gone.end() && *left < end; ++left) {
                        int const lane = bit_place(pattern, *left - from);
                        ranks.leave(rank, lane);
                        --counts[first + lane];
                    }
                });
            for (; mover != sorter.inside.cend() && mover->place < first + lanes; ++mover)
                ranks.fill(mover->place - first, mover->source);
            for (; arrival != arrivals.end() && arrival->place < first + lanes; ++arrival)
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

    /// Lists who comes to the cells of a block in the order of its cells: from other cells of the block in
    /// `sorter.inside`, from other blocks in movers(b). Returns how many come to each cell.
    std::array<std::uint32_t, Shape::cells> find_who_comes(int b, Sorter& sorter)
    {
        std::array<std::uint32_t, Shape::cells> came;
        came.fill(0);
        auto& unsorted = sorter.unsorted;
        unsorted.clear();
        if (int const old = old_block_[b]; old != BlockMap::absent) {
            std::vector<std::uint32_t> const& slots = departures_[old].slots;
            std::vector<std::uint16_t> const& places = departures_[old].places;
            for (std::size_t i = 0; i < slots.size(); ++i)
                if (places[i] != elsewhere) unsorted.push_back({slots[i], places[i], nullptr});
        }
        sort_by_cell(unsorted, sorter.inside, came);
        Mover* const arrivals = arrivals_.data() + arrival_begin_[b];
        unsorted.resize(arrival_begin_[b + 1] - arrival_begin_[b]);
        std::copy_n(arrivals, unsorted.size(), unsorted.data());
        sort_by_cell(unsorted, sorter.sorted, came);
        std::copy_n(sorter.sorted.data(), unsorted.size(), arrivals);
        return came;
    }

    int threads_;
    bool settled_ = true;
    std::uint64_t version_ = 0, generation_ = 0;
    std::vector<Block> blocks_;
    BlockMap map_;
    Array<std::uint32_t> source_, new_source_, counts_, new_counts_, group_begin_, new_group_begin_;
    std::vector<std::vector<Item>> leavers_; ///< per block, and last those that are new
    std::vector<std::uint32_t> stay_;
    std::vector<int> old_block_, block_now_; ///< of each block now its index before, and the reverse
    std::vector<Departures> departures_;     ///< per block before
    std::vector<Mover> arrivals_;            ///< by block now
    std::vector<std::uint32_t> arrival_begin_, arrival_end_;
};

} // namespace firn::openmp
