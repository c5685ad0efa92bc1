// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/grid.hpp>
#include <firn/openmp/lanes.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstring>
#include <span>
#include <vector>

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

/// Where some items that are loaded side by side lie.
template <class Lane>
class Places
{
    using Number = Scalar<Lane>;
    static constexpr int lanes = lane_width<Lane>;

public:
    /// The first `count` of the sources; lanes beyond repeat the last.
    void follow(std::uint32_t const* sources, int count)
    {
        count_ = count;
        // written at once and whole: what is loaded next is found in one store before it
        std::uint32_t const last = sources[count - 1];
        for (int l = 0; l < lanes; ++l) of_[l] = l < count ? sources[l] : last;
        if constexpr (lanes > 1) reader_.follow(of_);
    }

    int count() const { return count_; }
    std::uint32_t operator[](int lane) const { return of_[lane]; }

    Lane load(Number const* array) const
    {
        if constexpr (lanes == 1)
            return array[of_[0]];
        else
            return reader_.load(array);
    }

    /// The same of anything as wide as a number.
    template <class T>
    void copy(T const* array, T (&values)[lanes]) const
    {
        if constexpr (lanes == 1)
            values[0] = array[of_[0]];
        else
            reader_.copy(array, values);
    }

private:
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

    int count_ = 0;
    std::uint32_t of_[lanes];
    decltype(reader_for<Lane>()) reader_;
};

/// What a thread keeps of the items of a group from one function of a phase to the next: values, one array
/// per channel in the order of slots, and for each pack where its items lie and the offsets that it loaded.
template <class Lane, int d>
class Scratch
{
    using Number = Scalar<Lane>;
    static constexpr int lanes = lane_width<Lane>;

public:
    using Offset = typename CellOffset<Number>::Stored;
    struct Pack
    {
        Places<Lane> places;
        Offset offset[d][lanes];
    };

    void reserve(int channels, std::size_t items)
    {
        stride_ = (items + 2 * lanes - 1) / lanes * lanes; // whole packs may be written behind the last item
        values_.resize(static_cast<std::size_t>(channels) * stride_);
        if (packs_.size() < stride_ / lanes) packs_.resize(stride_ / lanes);
        if (cells_.size() < stride_) cells_.resize(stride_);
    }

    Number* at(int channel, std::size_t item) { return &values_[channel * stride_ + item]; }
    Number const* at(int channel, std::size_t item) const { return &values_[channel * stride_ + item]; }

    /// Of the items of a pack, of which this is the first.
    Pack& pack(std::size_t item) { return packs_[item / lanes]; }

    /// The number of an item's cell in the group, for who needs it.
    std::uint32_t* cell(std::size_t item) { return &cells_[item]; }

private:
    std::size_t stride_ = 0;
    Array<Number> values_;
    std::vector<Pack> packs_;
    std::vector<std::uint32_t> cells_;
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

    Items(CellOrder const& cells, std::size_t block, Scratch<Lane, d>& scratch)
        : scratch_(scratch), cells_(cells), block_(block)
    {}

    /// Goes to the items of the slots from `slot` on, up to `end`; the first of them is number `item` in the
    /// scratch.
    void enter(std::size_t slot, std::size_t end, std::size_t item)
    {
        auto const* const sources = cells_.sources(slot);
        int const count = static_cast<int>(std::min<std::size_t>(lanes, end - slot));
        assert(std::all_of(sources, sources + count, [&](auto from) { return from < cells_.size(); }) &&
               "a lane's item is one that is there");
        scratch_.pack(item).places.follow(sources, count);
        enter_again(slot, item);
    }
    /// Goes to them once more.
    void enter_again(std::size_t slot, std::size_t item)
    {
        slot_ = slot;
        item_ = item;
        pack_ = &scratch_.pack(item);
        int const count = pack_->places.count();
        if (count != entered_) here_ = mask_of<Lane>((std::uint64_t{1} << count) - 1);
        entered_ = count;
    }

    Mask<Lane> here() const { return here_; }

    void keep(int channel, Lane const& value) { LaneTraits<Lane>::store(value, scratch_.at(channel, item_)); }
    Lane kept(int channel) const { return LaneTraits<Lane>::load(scratch_.at(channel, item_)); }

    Lane load(Number const* array) const { return places().load(array); }

    void store(Number* array, Lane const& value) const
    {
        if constexpr (lanes == 1)
            array[slot_] = value;
        else if (entered_ == lanes)
            value.store(array + slot_);
        else
            value.store_first(entered_, array + slot_);
    }

    /// Stores to the element of an array that the item's own number in `index` says.
    void store_at(Number* array, std::uint32_t const* index, Lane const& value) const
    {
        Number values[lanes];
        LaneTraits<Lane>::store(value, values);
        for (int l = 0; l < entered_; ++l) array[index[places()[l]]] = values[l];
    }

    /// Fetches what will be read or written from memory while there is other work to do.
    template <class T>
    void expect_load(T const* array) const
    {
        __builtin_prefetch(array + places()[0], 0, 2);
        __builtin_prefetch(array + places()[lanes - 1], 0, 2);
    }
    template <class T>
    void expect_store(T const* array) const
    {
        __builtin_prefetch(array + slot_, 1, 2);
    }

    /// The offsets along an axis, in cells.
    Lane load_offset(Offset const* array, int axis) const
    {
        auto& stored = pack_->offset[axis];
        places().copy(array, stored);
        Number values[lanes];
        for (int l = 0; l < lanes; ++l) values[l] = CellOffset<Number>::value(stored[l]);
        return LaneTraits<Lane>::load(values);
    }

    /// Moves the offsets along an axis that were loaded when these items were entered first, from `from`, by
    /// a displacement [cells] into `to`; `value` becomes what was written. Returns which are still within
    /// their cells.
    Mask<Lane> move_offset([[maybe_unused]] Offset const* from, Offset* to, int axis,
                           Lane const& displacement, Lane& value) const
    {
        Offset stored[lanes];
        Number by[lanes], values[lanes], inside[lanes];
        LaneTraits<Lane>::store(displacement, by);
        for (int l = 0; l < lanes; ++l) {
            stored[l] = CellOffset<Number>::moved(pack_->offset[axis][l], by[l]);
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
            places().copy(from, values);
            store_bits(values, to);
        }
        else
            for (int l = 0; l < entered_; ++l) to[slot_ + l] = from[places()[l]];
    }

    /// The lanes of `ask(where the item lies)`.
    template <class Ask>
    Lane map(Ask const& ask) const
    {
        Number values[lanes];
        for (int l = 0; l < lanes; ++l) values[l] = ask(places()[l]);
        return LaneTraits<Lane>::load(values);
    }

    /// One lane's element of an array.
    template <class T>
    T value(T const* array, int lane) const
    {
        return array[places()[lane]];
    }

    /// The coordinates of a cell, and how far the lanes' own cells are from it along the axes.
    Coordinates<d> first() const { return CellOrder::cell_at(cells_.blocks()[block_].coordinates, 0); }
    Vector<Lane, d> along() const
    {
        int place[lanes];
        cells_.find_places(block_, slot_, entered_, place);
        Number steps[d][lanes];
        for (int l = 0; l < lanes; ++l) {
            auto const cell = CellOrder::cell_at(Coordinates<d>::Zero(), place[std::min(l, entered_ - 1)]);
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
    Scratch<Lane, d>& scratch_;
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

    Places<Lane> const& places() const { return pack_->places; }

    CellOrder const& cells_;
    std::size_t block_;
    typename Scratch<Lane, d>::Pack* pack_ = nullptr;
    int entered_ = 0;
    Mask<Lane> here_{};
};

/// Items that move and may depart from their cells.
template <class Lane, class CellOrder, int d>
class MovingItems : public Items<Lane, CellOrder, d>
{
    using Base = Items<Lane, CellOrder, d>;

public:
    using typename Base::Number, typename Base::Offset;

    MovingItems(CellOrder& cells, std::size_t block, Scratch<Lane, d>& scratch,
                typename CellOrder::Leavers& leavers)
        : Base(cells, block, scratch), departures_(cells.departures(block)), leavers_(leavers)
    {}

    /// As Items do it.
    Mask<Lane> move_offset(Offset const* from, Offset* to, int axis, Lane const& displacement,
                           Lane& value) const
    {
        moved_[axis] = to;
        return Base::move_offset(from, to, axis, displacement, value);
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
};

/// Items of a group of cells side by side, whatever their cells, as what takes from nodes sees them.
template <class Lane, int d>
class ItemsOfCells
{
public:
    using Real = Lane;
    static constexpr int lanes = lane_width<Lane>;

    /// Goes to the items from number `item` on, up to `end`; the scratch tells their cells.
    ItemsOfCells(Scratch<Lane, d>& scratch, std::size_t item, std::size_t end)
        : scratch_(scratch), item_(item), count_(static_cast<int>(std::min<std::size_t>(lanes, end - item)))
    {
        from_.follow(scratch.cell(item));
    }

    /// Behind the last item, too.
    void keep(int channel, Lane const& value) { value.store(scratch_.at(channel, item_)); }
    /// Lanes without an item are zero.
    Lane kept(int channel) const { return Lane::load_first(count_, scratch_.at(channel, item_)); }

    /// What is of the cells, in the lanes of their items.
    Lane of_cells(Lane const& value) const { return from_(value); }

private:
    Scratch<Lane, d>& scratch_;
    std::size_t item_;
    int count_;
    LanesInOrder<Lane> from_;
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
    GroupOfCells(std::uint32_t const* counts, int group, Scratch<Lane, GridType::dimension>& scratch,
                 Number const* read, Number* write)
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

    /// What is of the cells, in the lanes of their items.
    Lane const& of_cells(Lane const& value) const { return value; }

    /// Whether it takes less time to go through the items from the rank entered on, one of `ranks`, side by
    /// side, of `items` in all.
    bool is_sparse(int ranks_left, std::size_t items) const
    {
        if constexpr (can_go_side_by_side) {
            if (active_ * price_of_any_cells > lanes * price_of_own_cells) return false;
            std::size_t const packs = (items - item_ + lanes - 1) / lanes;
            return packs * price_of_any_cells < std::size_t(ranks_left) * price_of_own_cells;
        }
        else
            return false;
    }
    /// Calls `use(items)` for the items from the rank entered on.
    template <class Use>
    void side_by_side(int rank, std::size_t items, Use const& use)
    {
        if constexpr (can_go_side_by_side) {
            std::uint32_t cell[lanes];
            for (int l = 0; l < lanes; ++l) cell[l] = static_cast<std::uint32_t>(l);
            std::size_t item = item_;
            for (std::uint64_t pattern = pattern_; pattern != 0;
                 pattern = lanes_above<lanes>(count_, static_cast<std::uint32_t>(++rank))) {
                compress<lanes>(cell, pattern, scratch_.cell(item));
                item += static_cast<std::size_t>(std::popcount(pattern));
            }
            for (item = item_; item < items; item += lanes) {
                ItemsOfCells<Lane, GridType::dimension> some(scratch_, item, items);
                use(some);
            }
        }
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
