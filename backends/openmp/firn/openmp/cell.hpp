// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/grid.hpp>

#include <bit>

namespace firn::openmp
{

/// The lanes' mask from one bit per lane.
template <class Lane>
Mask<Lane> mask_of(std::uint64_t pattern)
{
    if constexpr (requires { Mask<Lane>::from_bits(pattern); })
        return Mask<Lane>::from_bits(pattern);
    else if constexpr (lane_width<Lane> == 1)
        return pattern != 0;
    else {
        Scalar<Lane> one_or_zero[lane_width<Lane>];
        for (int l = 0; l < lane_width<Lane>; ++l) one_or_zero[l] = Scalar<Lane>((pattern >> l) & 1);
        return LaneTraits<Lane>::load(one_or_zero) > Lane(Scalar<Lane>(0));
    }
}

/// The lanes 0, 1, 2, …
template <class Lane>
Lane counting()
{
    Scalar<Lane> number[lane_width<Lane>];
    for (int l = 0; l < lane_width<Lane>; ++l) number[l] = Scalar<Lane>(l);
    return LaneTraits<Lane>::load(number);
}

/// A group of cells as a phase sees it: lane l is cell l. What the phase loads comes from where the items
/// lie, what it stores goes to their slots. A lane without an item repeats another lane's values, so that
/// they are harmless; its place in here() is false.
template <class Lane, class CellOrder, int d>
class CellLanes
{
public:
    using Real = Lane;
    using Number = Scalar<Lane>;
    using Shape = typename CellOrder::Shape;
    static constexpr int lanes = lane_width<Lane>;

    CellLanes(CellOrder const& cells, std::size_t block, int group)
        : cells_(cells), count_(cells.counts(block, group)), slot_(cells.group_begin(block, group))
    {
        auto const& block_at = cells.blocks()[block].coordinates;
        int const row = group / Shape::groups_per_row;
        if constexpr (d == 3)
            first_ = {row / Shape::across, row % Shape::across, group % Shape::groups_per_row * lanes};
        else
            first_ = {row, group % Shape::groups_per_row * lanes};
        for (int a = 0; a < d; ++a) first_[a] += block_at[a] * Shape::extent(a);
    }

    /// The largest number of items in one of the cells.
    int ranks() const
    {
        std::uint32_t most = 0;
        for (int l = 0; l < lanes; ++l) most = std::max(most, count_[l]);
        return static_cast<int>(most);
    }

    /// Goes on to the next items, one of each cell; ranks are entered in order.
    void enter(int rank)
    {
        slot_ += active_;
        std::uint64_t pattern = 0;
        for (int l = 0; l < lanes; ++l) pattern |= std::uint64_t(count_[l] > std::uint32_t(rank)) << l;
        active_ = std::popcount(pattern);
        here_ = mask_of<Lane>(pattern);
        std::uint32_t const* const source = cells_.sources(slot_);
        full_ = active_ == lanes;
        contiguous_ = full_;
        if (full_)
            for (int l = 0; l < lanes; ++l) {
                from_[l] = source[l];
                contiguous_ &= source[l] == source[0] + std::uint32_t(l);
            }
        else {
            for (int l = 0; l < lanes; ++l) from_[l] = source[0];
            std::uint64_t rest = pattern;
            for (int i = 0; i < active_; ++i, rest &= rest - 1) {
                lane_[i] = std::countr_zero(rest);
                from_[lane_[i]] = source[i];
            }
        }
    }

    Mask<Lane> here() const { return here_; }

    Lane load(Number const* array) const
    {
        if (contiguous_) return LaneTraits<Lane>::load(array + from_[0]);
        Number values[lanes];
        for (int l = 0; l < lanes; ++l) values[l] = array[from_[l]];
        return LaneTraits<Lane>::load(values);
    }

    void store(Number* array, Lane const& value) const
    {
        if (full_) return LaneTraits<Lane>::store(value, array + slot_);
        Number values[lanes];
        LaneTraits<Lane>::store(value, values);
        for (int i = 0; i < active_; ++i) array[slot_ + i] = values[lane_[i]];
    }

    /// Copies what no phase computes with.
    template <class T>
    void copy(T const* from, T* to) const
    {
        std::uint32_t const* const source = cells_.sources(slot_);
        for (int i = 0; i < active_; ++i) to[slot_ + i] = from[source[i]];
    }

    /// Writes `change(what lies there, value)` of each item to its slot.
    template <class T, class Change>
    void update(T const* from, T* to, Lane const& value, Change const& change) const
    {
        Number values[lanes];
        LaneTraits<Lane>::store(value, values);
        if (full_)
            for (int l = 0; l < lanes; ++l) to[slot_ + l] = change(from[from_[l]], values[l]);
        else
            for (int i = 0; i < active_; ++i) to[slot_ + i] = change(from[from_[lane_[i]]], values[lane_[i]]);
    }

    /// The lanes of `ask(where the item lies)`.
    template <class Ask>
    Lane map(Ask const& ask) const
    {
        Number values[lanes];
        for (int l = 0; l < lanes; ++l) values[l] = ask(from_[l]);
        return LaneTraits<Lane>::load(values);
    }

    /// One lane's element of an array.
    template <class T>
    T value(T const* array, int lane) const
    {
        return array[from_[lane]];
    }

    /// The coordinates of lane 0's cell, and how far the other lanes are along the axes.
    Coordinates<d> first() const { return first_; }
    Vector<Lane, d> along() const
    {
        Vector<Lane, d> steps = Vector<Lane, d>::Zero();
        steps[d - 1] = counting<Lane>();
        return steps;
    }

    /// Whether the cells are so far out that an item may be about to leave the range of coordinates.
    bool at_the_edge() const
    {
        for (int a = 0; a < d; ++a)
            if (std::abs(double(first_[a])) > CellOrder::largest_coordinate) return true;
        return false;
    }

private:
    CellOrder const& cells_;
    std::uint32_t const* count_;
    std::size_t slot_;
    int active_ = 0;
    bool full_ = false, contiguous_ = false;
    std::uint32_t from_[lanes];
    int lane_[lanes];
    Mask<Lane> here_{};
    Coordinates<d> first_;
};

/// A group of cells that adds to the tile of its block.
template <class Lane, class CellOrder, class GridType, int d>
class ScatterCell : public CellLanes<Lane, CellOrder, d>
{
public:
    using Number = Scalar<Lane>;

    ScatterCell(CellOrder const& cells, GridType& grid, std::size_t block, int group)
        : CellLanes<Lane, CellOrder, d>(cells, block, group), tile_(grid.tile(block)), group_(group),
          place_(group % GridType::Shape::groups_per_row * lane_width<Lane>)
    {}

    /// Adds to channel c of the node at place k in a row of the stencil of each lane.
    void add(int c, int row, int k, Lane const& value) const
    {
        Number* const at = tile_ + c * GridType::tile_channel +
                           GridType::tile_row(group_, row) * GridType::row_length + place_ + k;
        LaneTraits<Lane>::store(LaneTraits<Lane>::load(at) + value, at);
    }

private:
    Number* tile_;
    int group_, place_;
};

/// A group of cells that reads the nodes of its block, copied into one tile.
template <class Lane, class CellOrder, class GridType, int d>
class GatherCell : public CellLanes<Lane, CellOrder, d>
{
public:
    using Number = Scalar<Lane>;

    GatherCell(CellOrder const& cells, Number const* tile, std::size_t block, int group)
        : CellLanes<Lane, CellOrder, d>(cells, block, group), tile_(tile), group_(group),
          place_(group % GridType::Shape::groups_per_row * lane_width<Lane>)
    {}

    /// Channel c of the node at place k in a row of the stencil of each lane.
    Lane node(int c, int row, int k) const
    {
        return LaneTraits<Lane>::load(tile_ + c * GridType::tile_channel +
                                      GridType::tile_row(group_, row) * GridType::row_length + place_ + k);
    }

private:
    Number const* tile_;
    int group_, place_;
};

/// Neighbouring nodes along a row, one per lane.
template <class Lane, class GridType, int d>
class NodeLanes
{
public:
    using Real = Lane;
    using Number = Scalar<Lane>;

    NodeLanes(Number const* sums, Number* values, Coordinates<d> const& first)
        : sums_(sums), values_(values), first_(first)
    {}

    Lane sum(int c) const { return LaneTraits<Lane>::load(sums_ + c * GridType::Shape::along); }
    void set(int c, Lane const& value) const
    {
        LaneTraits<Lane>::store(value, values_ + c * GridType::block_channel);
    }

    /// The coordinates of lane 0's node, and how far the other lanes are along the axes.
    Coordinates<d> first() const { return first_; }
    Vector<Lane, d> offset() const
    {
        Vector<Lane, d> steps = Vector<Lane, d>::Zero();
        steps[d - 1] = counting<Lane>();
        return steps;
    }

private:
    Number const* sums_;
    Number* values_;
    Coordinates<d> first_;
};

} // namespace firn::openmp
