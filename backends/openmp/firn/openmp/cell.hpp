// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/grid.hpp>
#include <firn/openmp/lanes.hpp>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <span>

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

/// Values that a phase keeps of each item of a group from one of its functions to the next: one array per
/// channel, in the order of slots.
template <class Number, int lanes>
class Scratch
{
public:
    void reserve(int channels, std::size_t items)
    {
        stride_ = (items + 2 * lanes - 1) / lanes * lanes; // whole packs may be written behind the last item
        values_.resize(static_cast<std::size_t>(channels) * stride_);
    }

    Number* at(int channel, std::size_t item) { return &values_[channel * stride_ + item]; }
    Number const* at(int channel, std::size_t item) const { return &values_[channel * stride_ + item]; }

private:
    std::size_t stride_ = 0;
    Array<Number> values_;
};

/// Some items side by side, whatever their cells, as a phase sees them. What it loads comes from where they
/// lie
/// (`source`), what it stores goes to their slots. Lanes beyond the last item repeat it, so that they are
/// harmless; their place in here() is false.
template <class Lane, class CellOrder, int d>
class Items
{
public:
    using Real = Lane;
    using Number = Scalar<Lane>;
    using Offset = typename CellOrder::Offset;
    static constexpr int lanes = lane_width<Lane>;

    Items(CellOrder const& cells, std::size_t block, Scratch<Number, lanes>& scratch)
        : scratch_(scratch), cells_(cells), block_(block)
    {}

    /// Goes to the items of the slots from `slot` on, up to `end`; the first of them is number `item` in the
    /// scratch.
    void enter(std::size_t slot, std::size_t end, std::size_t item)
    {
        enter_sources(cells_.sources(slot), static_cast<int>(std::min<std::size_t>(lanes, end - slot)), item);
        slot_ = slot;
    }

    Mask<Lane> here() const { return here_; }

    void keep(int channel, Lane const& value) { LaneTraits<Lane>::store(value, scratch_.at(channel, item_)); }
    Lane kept(int channel) const { return LaneTraits<Lane>::load(scratch_.at(channel, item_)); }

    Lane load(Number const* array) const
    {
        if constexpr (lanes == 1)
            return array[from_[0]];
        else
            return reader_.load(array);
    }

    void store(Number* array, Lane const& value) const
    {
        if constexpr (lanes == 1)
            array[slot_] = value;
        else if (active_ == lanes)
            value.store(array + slot_);
        else
            value.store_first(active_, array + slot_);
    }

    /// Stores to the element of an array that the item's own number in `index` says.
    void store_at(Number* array, std::uint32_t const* index, Lane const& value) const
    {
        Number values[lanes];
        LaneTraits<Lane>::store(value, values);
        for (int l = 0; l < active_; ++l) array[index[from_[l]]] = values[l];
    }

    /// Fetches what will be read or written from memory while there is other work to do.
    template <class T>
    void expect_load(T const* array) const
    {
        __builtin_prefetch(array + from_[0], 0, 2);
        __builtin_prefetch(array + from_[lanes - 1], 0, 2);
    }
    template <class T>
    void expect_store(T const* array) const
    {
        __builtin_prefetch(array + slot_, 1, 2);
    }

    /// The offsets, in cells.
    Lane load_offset(Offset const* array) const
    {
        Offset stored[lanes];
        Number values[lanes];
        gather(array, stored);
        for (int l = 0; l < lanes; ++l) values[l] = CellOffset<Number>::value(stored[l]);
        return LaneTraits<Lane>::load(values);
    }

    /// Moves the offsets in `from` by a displacement [cells] into `to`; `value` becomes what was written.
    /// Returns which are still within their cells.
    Mask<Lane> move_offset(Offset const* from, Offset* to, Lane const& displacement, Lane& value) const
    {
        Offset stored[lanes];
        Number by[lanes], values[lanes], inside[lanes];
        gather(from, stored);
        LaneTraits<Lane>::store(displacement, by);
        for (int l = 0; l < lanes; ++l) {
            stored[l] = CellOffset<Number>::moved(stored[l], by[l]);
            values[l] = CellOffset<Number>::value(stored[l]);
            inside[l] = CellOffset<Number>::inside(stored[l]) ? Number(1) : Number(0);
        }
        store_bits(stored, to);
        value = LaneTraits<Lane>::load(values);
        return LaneTraits<Lane>::load(inside) > Lane(Number(0));
    }

    /// Copies what no phase computes with.
    template <class T>
    void copy(T const* from, T* to) const
    {
        if constexpr (lanes > 1 && sizeof(T) == sizeof(Number)) {
            T values[lanes];
            reader_.copy(from, values);
            store_bits(values, to);
        }
        else
            for (int l = 0; l < active_; ++l) to[slot_ + l] = from[from_[l]];
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

    /// The coordinates of a cell, and how far the lanes' own cells are from it along the axes.
    Coordinates<d> first() const { return CellOrder::cell_at(cells_.blocks()[block_].coordinates, 0); }
    Vector<Lane, d> along() const
    {
        int place[lanes];
        cells_.find_places(block_, slot_, active_, place);
        Number steps[d][lanes];
        for (int l = 0; l < lanes; ++l) {
            auto const cell = CellOrder::cell_at(Coordinates<d>::Zero(), place[std::min(l, active_ - 1)]);
            for (int a = 0; a < d; ++a) steps[a][l] = Number(cell[a]);
        }
        Vector<Lane, d> along;
        for (int a = 0; a < d; ++a) along[a] = LaneTraits<Lane>::load(steps[a]);
        return along;
    }

    /// Whether the cells are so far out that an item may be about to leave the range of coordinates.
    bool at_the_edge() const
    {
        auto const cell = first();
        for (int a = 0; a < d; ++a)
            if (std::abs(double(cell[a])) > CellOrder::largest_coordinate) return true;
        return false;
    }

protected:
    void enter_sources(std::uint32_t const* source, int count, std::size_t item)
    {
        item_ = item;
        active_ = count;
        // written at once and whole: what is loaded next is found in one store before it
        std::uint32_t const last = source[count - 1];
        for (int l = 0; l < lanes; ++l) from_[l] = l < count ? source[l] : last;
        assert(std::all_of(from_, from_ + lanes, [&](auto from) { return from < cells_.size(); }) &&
               "a lane's item is one that is there");
        if constexpr (lanes > 1) reader_.follow(from_);
        if (count != entered_) here_ = mask_of<Lane>((std::uint64_t{1} << count) - 1);
        entered_ = count;
    }

    Scratch<Number, lanes>& scratch_;
    std::size_t slot_ = 0, item_ = 0;

private:
    /// Stores integers as wide as a number.
    template <class T>
    void store_bits(T const (&values)[lanes], T* to) const
    {
        static_assert(sizeof(T) == sizeof(Number));
        if constexpr (lanes == 1)
            to[slot_] = values[0];
        else {
            Number bits[lanes];
            std::memcpy(bits, values, sizeof bits);
            store(reinterpret_cast<Number*>(to), Lane::load(bits));
        }
    }

    void gather(Offset const* array, Offset (&values)[lanes]) const
    {
        if constexpr (lanes > 1)
            reader_.copy(array, values);
        else
            values[0] = array[from_[0]];
    }

    struct NoReader
    {};
    template <class L>
    static auto reader_for()
    {
        if constexpr (lane_width < L >> 1)
            return RunsOfPlaces<L>{};
        else
            return NoReader{};
    }

    CellOrder const& cells_;
    std::size_t block_;
    int active_ = 0, entered_ = 0;
    std::uint32_t from_[lanes];
    decltype(reader_for<Lane>()) reader_;
    Mask<Lane> here_{};
};

/// Items that move and may depart from their cells.
template <class Lane, class CellOrder, int d>
class MovingItems : public Items<Lane, CellOrder, d>
{
    using Base = Items<Lane, CellOrder, d>;

public:
    using typename Base::Number, typename Base::Offset;

    MovingItems(CellOrder& cells, std::size_t block, Scratch<Number, Base::lanes>& scratch,
                typename CellOrder::Leavers& leavers)
        : Base(cells, block, scratch), departures_(cells.departures(block)), leavers_(leavers)
    {}

    /// As Items do it; called for one axis after the other.
    Mask<Lane> move_offset(Offset const* from, Offset* to, Lane const& displacement, Lane& value) const
    {
        moved_[axis_] = to;
        axis_ = (axis_ + 1) % d;
        return Base::move_offset(from, to, displacement, value);
    }

    /// Notes that some items have left their cells, and takes away what they keep to give: all but the first
    /// `zero_from` of `kept` channels become zero. The first of these are the offset, which is that in the
    /// new cell from now on.
    void depart(Mask<Lane> const& which, int zero_from, int kept)
    {
        std::uint64_t rest = bits(which);
        auto at = leavers_.given.size();
        leavers_.given.resize(at + static_cast<std::size_t>(std::popcount(rest) * kept));
        CellOrder::make_room(departures_.slots, static_cast<std::size_t>(std::popcount(rest)));
        for (; rest != 0; rest &= rest - 1, at += static_cast<std::size_t>(kept)) {
            int const lane = std::countr_zero(rest);
            std::size_t const slot = this->slot_ + static_cast<std::size_t>(lane);
            departures_.slots.push_back(static_cast<std::uint32_t>(slot));
            for (int c = 0; c < kept; ++c) {
                auto& value = *this->scratch_.at(c, this->item_ + static_cast<std::size_t>(lane));
                leavers_.given[at + static_cast<std::size_t>(c)] = value;
                if (c >= zero_from) value = 0;
            }
            auto& steps = leavers_.steps.emplace_back();
            for (int a = 0; a < d; ++a) {
                Offset offset = moved_[a][slot];
                steps[a] = static_cast<signed char>(CellOffset<Number>::wrap(offset));
                leavers_.given[at + static_cast<std::size_t>(a)] = CellOffset<Number>::value(offset);
            }
        }
    }

private:
    typename CellOrder::Departures& departures_;
    typename CellOrder::Leavers& leavers_;
    mutable Offset* moved_[d]{}; ///< where offsets were written, along each axis
    mutable int axis_ = 0;
};

/// A group of neighbouring cells as a phase sees it: lane l is cell l. It goes through the items of its cells
/// rank by rank: the first of each cell, then the second ones.
template <class Lane, class GridType>
class GroupOfCells
{
public:
    using Real = Lane;
    using Number = Scalar<Lane>;
    using Shape = typename GridType::Shape;
    static constexpr int lanes = lane_width<Lane>;

    /// `counts` has the number of items of each cell, `scratch` what they keep; `read` is a tile of node
    /// values, `write` one of sums: a phase that does not need one is given none.
    GroupOfCells(std::uint32_t const* counts, int group, Scratch<Number, lanes>& scratch, Number const* read,
                 Number* write)
        : count_(counts), scratch_(scratch), group_(group), place_(group % Shape::groups_per_row * lanes),
          read_(read), write_(write)
    {}

    /// The largest number of items in one of the cells.
    int ranks() const { return static_cast<int>(*std::max_element(count_, count_ + lanes)); }

    /// Goes back before the first items.
    void restart() { item_ = 0, active_ = 0; }

    /// Goes on to the next items, one of each cell that has so many; ranks are entered in order.
    void enter(int rank)
    {
        item_ += active_;
        pattern_ = lanes_above<lanes>(count_, static_cast<std::uint32_t>(rank));
        active_ = static_cast<std::size_t>(std::popcount(pattern_));
    }

    void keep(int channel, Lane const& value)
    {
        Number* const to = scratch_.at(channel, item_);
        if constexpr (lanes == 1)
            *to = value;
        else
            value.compressed(pattern_).store(to);
    }

    /// Lanes without an item are zero.
    Lane kept(int channel) const
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
    /// lane. Neighbouring lanes share nodes: what is added to them is summed up first.
    template <int width, int channels>
    void add(int row, Lane const (&sums)[width][channels]) const
    {
        Number* const first = write_ + at(0, row, 0);
        for (int c = 0; c < channels; ++c) {
            Number* const to = first + c * GridType::tile_channel;
            if constexpr (lanes >= width) {
                Lane here = sums[0][c], beyond(Number(0));
                add_shifted(sums, c, here, beyond, std::make_integer_sequence<int, width - 1>{});
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
    /// Adds lane l's sum for place k to number l + k of `here` followed by `beyond`, for k = 1, 2, …
    template <int width, int channels, int... before>
    static void add_shifted(Lane const (&sums)[width][channels], int c, Lane& here, Lane& beyond,
                            std::integer_sequence<int, before...>)
    {
        Lane const zero(Number(0));
        ((here += Lane::template window<lanes - 1 - before>(zero, sums[before + 1][c])), ...);
        ((beyond += Lane::template window<lanes - 1 - before>(sums[before + 1][c], zero)), ...);
    }

    int at(int c, int row, int k) const
    {
        assert(c >= 0 && row >= 0 && row < GridType::stencil_rows && k >= 0 &&
               place_ + k < GridType::row_length && "a node is in the tile of its block");
        return c * GridType::tile_channel + GridType::tile_row(group_, row) * GridType::row_length + place_ +
               k;
    }

    std::uint32_t const* count_;
    Scratch<Number, lanes>& scratch_;
    int group_, place_;
    Number const* read_;
    Number* write_;
    std::size_t item_ = 0, active_ = 0;
    std::uint64_t pattern_ = 0;
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
    /// What was set before.
    Lane value(int c) const { return LaneTraits<Lane>::load(values_ + c * GridType::block_channel); }
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
