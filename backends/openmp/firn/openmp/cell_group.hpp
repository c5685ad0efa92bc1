// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/openmp/compress.hpp>
#include <firn/openmp/grid.hpp>
#include <firn/openmp/items.hpp>
#include <firn/openmp/permutation.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace firn::openmp
{

/// Items of a group of cells side by side, whatever their cells, as the gather sees them.
template <class Lane, int d>
class PackedItems
{
public:
    using Real = Lane;
    static constexpr int lanes = lane_width<Lane>;

    /// Goes to the items from number `item` on, up to `end`; the scratch holds their cells.
    PackedItems(Scratch<Lane, d>& scratch, std::size_t item, std::size_t end)
        : scratch_(scratch), item_(item), count_(static_cast<int>(std::min<std::size_t>(lanes, end - item)))
    {
        from_.follow(scratch.cell(item));
    }

    /// May write behind the last item.
    void set_scratch(int channel, Lane const& value) { value.store(scratch_.at(channel, item_)); }
    /// Lanes without an item are zero.
    Lane scratch(int channel) const { return Lane::load_first(count_, scratch_.at(channel, item_)); }

    /// Moves values of cells to the lanes of their items.
    Lane of_cells(Lane const& value) const { return from_(value); }

private:
    Scratch<Lane, d>& scratch_;
    std::size_t item_;
    int count_;
    LanesInOrder<Lane> from_;
};

/// A group of neighbouring cells as a phase sees it: lane l is cell l. It visits the items of its cells rank
/// by rank: the first of each cell, then the second ones.
template <class Lane, class GridType>
class CellGroup
{
public:
    using Real = Lane;
    using Number = ScalarOf<Lane>;
    using Shape = typename GridType::Shape;
    static constexpr int lanes = lane_width<Lane>;

    /// `counts` has the number of items of each cell; `scratch` has their values, from number `first` on.
    /// `read` is a tile of node values, `write` a tile of sums, or null where a phase does not need it.
    CellGroup(std::uint32_t const* counts, int group, Scratch<Lane, GridType::dimension>& scratch,
              std::size_t first, Number const* read, Number* write)
        : count_(counts), scratch_(scratch), group_(group), place_(group % Shape::groups_per_row * lanes),
          read_(read), write_(write), first_(first), item_(first)
    {}

    /// The largest number of items in one of the cells.
    int ranks() const { return static_cast<int>(most_of<lanes>(count_)); }

    /// Goes back before the first items.
    void restart() { item_ = first_, active_ = 0; }

    /// Goes on to the items of this rank, in the cells that have so many; ranks are entered in order.
    void enter(int rank)
    {
        item_ += active_;
        pattern_ = lanes_above<lanes>(count_, static_cast<std::uint32_t>(rank));
        active_ = static_cast<std::size_t>(std::popcount(pattern_));
    }

    /// The number of the entered rank's first item, and the cells that have one: a bit for each.
    std::size_t item() const { return item_; }
    std::uint64_t pattern() const { return pattern_; }
    /// Whether each cell has one.
    bool is_whole() const { return active_ == lanes; }

    void set_scratch(int channel, Lane const& value)
    {
        Number* const to = scratch_.at(channel, item_);
        if constexpr (lanes == 1)
            *to = value;
        else
            value.compressed(pattern_).store(to);
    }

    /// Values of cells in the lanes of their items: the same lanes here.
    Lane const& of_cells(Lane const& value) const { return value; }

    /// Whether it is faster to process the items from the entered rank on side by side: `ranks_left` ranks of
    /// them are left, and the group's items end before number `end`.
    bool is_sparse(int ranks_left, std::size_t end) const
    {
        if constexpr (can_go_side_by_side) {
            if (active_ * price_of_any_cells > lanes * price_of_own_cells) return false;
            std::size_t const packs = (end - item_ + lanes - 1) / lanes;
            return packs * price_of_any_cells < std::size_t(ranks_left) * price_of_own_cells;
        }
        else
            return false;
    }
    /// Calls `use(items)` for packs of the items from the entered rank on.
    template <class Use>
    void side_by_side(int rank, std::size_t end, Use const& use)
    {
        if constexpr (can_go_side_by_side) {
            std::uint32_t cell[std::size_t(lanes)];
            for (int l = 0; l < lanes; ++l) cell[l] = static_cast<std::uint32_t>(l);
            std::size_t item = item_;
            for (std::uint64_t pattern = pattern_; pattern != 0;
                 pattern = lanes_above<lanes>(count_, static_cast<std::uint32_t>(++rank))) {
                compress<lanes>(cell, pattern, scratch_.cell(item));
                item += static_cast<std::size_t>(std::popcount(pattern));
            }
            for (item = item_; item < end; item += lanes) {
                PackedItems<Lane, GridType::dimension> some(scratch_, item, end);
                use(some);
            }
        }
    }

    /// Lanes without an item are zero.
    Lane scratch(int channel) const
    {
        Number const* const from = scratch_.at(channel, item_);
        if constexpr (lanes == 1)
            return *from;
        else
            return Lane::load(from).expanded(pattern_);
    }

    /// Channel c of the node at place k in a row of the stencil of each lane.
    Lane node(int c, int row, int k) const { return LaneTraits<Lane>::load(read_ + at(c, row, k)); }

    /// Adds to the nodes of a row of the stencils: `sums[k][c]` to channel c of the node at place k of each
    /// lane. Neighbouring lanes share nodes, so their sums are combined first.
    template <int width, int channels>
    void add(int row, Lane const (&sums)[std::size_t(width)][std::size_t(channels)]) const
    {
        Number* const first = write_ + at(0, row, 0);
        for (int c = 0; c < channels; ++c) {
            Number* const to = first + c * GridType::tile_channel;
            if constexpr (lanes >= width) {
                Lane here = sums[0][c], beyond(Number(0));
                add_shifted<width, channels>(sums, c, here, beyond,
                                             std::make_integer_sequence<int, width - 1>{});
                (Lane::load(to) + here).store(to);
                Number* const rest = to + lanes;
                (Lane::load_first(width - 1, rest) + beyond).store_first(width - 1, rest);
            }
            else
                for (int k = 0; k < width; ++k)
                    LaneTraits<Lane>::store(LaneTraits<Lane>::load(to + k) + sums[k][c], to + k);
        }
    }

private:
    /// Adds the sum of lane l for place k to element l + k of `here` followed by `beyond`, for k = 1, 2, …
    template <int width, int channels, int... before>
    static void add_shifted(Lane const (&sums)[std::size_t(width)][std::size_t(channels)], int c, Lane& here,
                            Lane& beyond, std::integer_sequence<int, before...>)
    {
        Lane const zero(Number(0));
        ((here += Lane::template window<lanes - 1 - before>(zero, sums[before + 1][c])), ...);
        ((beyond += Lane::template window<lanes - 1 - before>(sums[before + 1][c], zero)), ...);
    }

    static constexpr bool can_go_side_by_side = [] {
        if constexpr (lanes > 1)
            return LanesInOrder<Lane>::is_fast;
        else
            return false;
    }();

    int at(int c, int row, int k) const
    {
        assert(c >= 0 && row >= 0 && row < GridType::stencil_rows && k >= 0 &&
               place_ + k < GridType::row_length && "a node is in the tile of its block");
        return c * GridType::tile_channel + GridType::tile_row(group_, row) * GridType::row_length + place_ +
               k;
    }

    std::uint32_t const* count_;
    Scratch<Lane, GridType::dimension>& scratch_;
    int group_, place_;
    Number const* read_;
    Number* write_;
    std::size_t first_, item_, active_ = 0;
    std::uint64_t pattern_ = 0;
};

/// Items in any cells of a block, one per lane, in the role of a group of cells: each lane reads its own
/// nodes, and lanes add to nodes one after the other. For few items in several groups; a lane is a pack.
template <class Lane, class GridType>
class ScatteredItems
{
public:
    using Real = Lane;
    using Number = ScalarOf<Lane>;
    static constexpr int lanes = lane_width<Lane>;

    /// There are `count` of them, one or more, at these places in the block, and the scratch holds no others.
    /// Further lanes repeat the last item. For the other parameters see CellGroup.
    ScatteredItems(int const* places, int count, Scratch<Lane, GridType::dimension>& scratch,
                   Number const* read, Number* write)
        : count_(count), scratch_(scratch), read_(read), write_(write)
    {
        for (int l = 0; l < lanes; ++l) stencil_[l] = GridType::tile_place(places[std::min(l, count - 1)]);
    }

    int ranks() const { return 1; }
    void restart() {}
    void enter(int) {}
    bool is_sparse(int, std::size_t) const { return false; }
    template <class Use>
    void side_by_side(int, std::size_t, Use const&)
    {}

    void set_scratch(int channel, Lane const& value)
    {
        value.store(scratch_.at(channel, 0)); // may write behind the last item
    }
    Lane const& of_cells(Lane const& value) const { return value; }

    /// Lanes without an item are zero.
    Lane scratch(int channel) const { return Lane::load_first(count_, scratch_.at(channel, 0)); }

    Lane node(int c, int row, int k) const { return Lane::gather(read_ + at(c, row, k), stencil_); }

    template <int width, int channels>
    void add(int row, Lane const (&sums)[std::size_t(width)][std::size_t(channels)]) const
    {
        Number values[std::size_t(width)][std::size_t(channels)][std::size_t(lanes)];
        for (int k = 0; k < width; ++k)
            for (int c = 0; c < channels; ++c) sums[k][c].store(values[k][c]);
        for (int l = 0; l < count_; ++l) {
            Number* to = write_ + at(0, row, 0) + stencil_[l];
            for (int c = 0; c < channels; ++c, to += GridType::tile_channel)
                for (int k = 0; k < width; ++k) to[k] += values[k][c][l];
        }
    }

private:
    /// The distance of a node of a stencil from its first node.
    int at(int c, int row, int k) const
    {
        int const node = GridType::stencil_row(row) * GridType::row_length + k;
        assert(c >= 0 && row >= 0 && row < GridType::stencil_rows && k >= 0 &&
               std::ranges::all_of(stencil_, [&](int of) { return of + node < GridType::tile_channel; }) &&
               "a node is in the tile of its block");
        return c * GridType::tile_channel + node;
    }

    int count_;
    Scratch<Lane, GridType::dimension>& scratch_;
    Number const* read_;
    Number* write_;
    std::int32_t stencil_[std::size_t(lanes)]; ///< where in a tile the stencils begin
};

/// The lanes 0, 1, 2, …, from constant memory: numbers stored one by one would stall the load of a pack.
template <class Lane>
Lane counting()
{
    static constexpr auto numbers = [] {
        std::array<ScalarOf<Lane>, lane_width<Lane>> from_0{};
        for (int l = 0; l < lane_width<Lane>; ++l) from_0[std::size_t(l)] = ScalarOf<Lane>(l);
        return from_0;
    }();
    return LaneTraits<Lane>::load(numbers.data());
}

/// Neighbouring nodes along a row, one per lane.
template <class Lane, class GridType, int d>
class NodeLanes
{
public:
    using Real = Lane;
    using Number = ScalarOf<Lane>;

    NodeLanes(Number const* sums, Number* values, Coordinates<d> const& first)
        : sums_(sums), values_(values), first_(first)
    {}

    Lane sum(int c) const { return LaneTraits<Lane>::load(sums_ + c * GridType::Shape::along); }
    /// The value from before this update.
    Lane value(int c) const { return LaneTraits<Lane>::load(values_ + c * GridType::block_channel); }
    void set(int c, Lane const& value) const
    {
        LaneTraits<Lane>::store(value, values_ + c * GridType::block_channel);
    }

    /// The coordinates of the node of lane 0, and the offsets of the other lanes along the axes.
    Coordinates<d> first() const { return first_; }
    Vector<Lane, d> offset() const
    {
        Vector<Lane, d> steps = zeros<Vector<Lane, d>>();
        steps[d - 1] = counting<Lane>();
        return steps;
    }

private:
    Number const* sums_;
    Number* values_;
    Coordinates<d> first_;
};

} // namespace firn::openmp
