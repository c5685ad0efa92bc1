// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/compress.hpp>
#include <firn/openmp/indirect_load.hpp>
#include <firn/openmp/migration.hpp>
#include <firn/openmp/offset_lane.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <bit>
#include <cassert>
#include <cstddef>
#include <cstdint>

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
        ScalarOf<Lane> one_or_zero[lane_width<Lane>];
        for (int l = 0; l < lane_width<Lane>; ++l) one_or_zero[l] = ScalarOf<Lane>((pattern >> l) & 1);
        return LaneTraits<Lane>::load(one_or_zero) > Lane(ScalarOf<Lane>(0));
    }
}

/// Where the items of a pack lie.
template <class Lane>
class Places
{
    using Number = ScalarOf<Lane>;
    static constexpr int lanes = lane_width<Lane>;

public:
    /// The first `count` of the sources; lanes beyond repeat the last.
    void follow(std::uint32_t const* sources, int count)
    {
        count_ = count;
        copy_first<lanes>(sources, count, of_);
        if constexpr (lanes > 1) reader_.follow(of_);
    }

    /// There are so many, wherever they lie.
    void follow_none(int count) { count_ = count; }

    int count() const { return count_; }
    std::uint32_t operator[](int lane) const { return of_[lane]; }

    Lane load(Number const* array) const
    {
        if constexpr (lanes == 1)
            return array[of_[0]];
        else
            return reader_.load(array);
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
    std::uint32_t of_[std::size_t(lanes)];
    decltype(reader_for<Lane>()) reader_;
};

/// What a thread keeps of the items of some groups between the functions of a phase: values, one array per
/// channel in the order of slots, and for each pack where its items lie and the offsets that it loaded.
template <class Lane, int d>
class Scratch
{
    using Number = ScalarOf<Lane>;
    static constexpr int lanes = lane_width<Lane>;

public:
    using Offset = typename CellOffset<Number>::Stored;
    /// Where a pack of items lies, and the offsets that were loaded.
    struct Pack
    {
        Places<Lane> places;
        Offset offset[std::size_t(d)][std::size_t(lanes)];
    };

    void reserve(int channels, std::size_t items)
    {
        stride_ = (items + 2 * lanes - 1) / lanes * lanes; // whole packs may be written behind the last item
        values_.resize(static_cast<std::size_t>(channels) * stride_);
        if (packs_.size() < stride_ / lanes) packs_.resize(stride_ / lanes);
        if (cells_.size() < stride_) { // zeros, since packs of them are read whole
            cells_.resize(stride_, 0);
            cells_.fill(0, stride_, 0);
        }
    }

    Number* at(int channel, std::size_t item) { return &values_[std::size_t(channel) * stride_ + item]; }
    Number const* at(int channel, std::size_t item) const { return &values_[channel * stride_ + item]; }

    /// The pack that begins with this item.
    Pack& pack(std::size_t item) { return packs_[item / lanes]; }

    /// The index of an item's cell in the group; set only for PackedItems.
    std::uint32_t* cell(std::size_t item) { return &cells_[item]; }

private:
    std::size_t stride_ = 0;
    Array<Number> values_;
    Array<Pack> packs_;
    Array<std::uint32_t> cells_;
};

/// Some items side by side, whatever their cells, as a phase sees them. Loads come from where the items lie
/// (`source`), stores go to their slots. Lanes beyond the last item repeat its loads and have zeros for
/// scratch, so that they are harmless; they are false in here().
template <class Lane, class Order, int d>
class Items
{
public:
    using Real = Lane;
    using Number = ScalarOf<Lane>;
    using Offset = typename Order::Offset;
    static constexpr int lanes = lane_width<Lane>;

    Items(Order const& cells, std::size_t block, Scratch<Lane, d>& scratch)
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
    /// The same if nothing is asked for that lies at their sources.
    void enter_slots(std::size_t slot, std::size_t end, std::size_t item)
    {
        scratch_.pack(item).places.follow_none(static_cast<int>(std::min<std::size_t>(lanes, end - slot)));
        enter_again(slot, item);
    }
    /// Goes back to them.
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

    void set_scratch(int channel, Lane const& value)
    {
        LaneTraits<Lane>::store(value, scratch_.at(channel, item_));
    }
    /// Lanes beyond the last item are zero: their memory may never have been written.
    Lane scratch(int channel) const
    {
        Number const* const from = scratch_.at(channel, item_);
        if constexpr (lanes == 1)
            return *from;
        else
            return entered_ == lanes ? Lane::load(from) : Lane::load_first(entered_, from);
    }

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

    /// What an earlier loop stored. Lanes without an item are zero.
    Lane load_stored(Number const* array) const
    {
        if constexpr (lanes == 1)
            return array[slot_];
        else
            return entered_ == lanes ? Lane::load(array + slot_) : Lane::load_first(entered_, array + slot_);
    }

    /// Stores each lane to the element of `array` whose number `index` has for its item.
    void store_at(Number* array, std::uint32_t const* index, Lane const& value) const
    {
        Number values[std::size_t(lanes)];
        LaneTraits<Lane>::store(value, values);
        FIRN_KEEP_LOOP
        for (int l = 0; l < entered_; ++l) array[index[places()[l]]] = values[l];
    }

    /// Prefetches what will be read or written.
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
        auto const stored = load_stored_offset(array);
        OffsetLane<Lane>::store(stored, pack_->offset[axis]);
        return CellOffset<Number>::value(stored);
    }

    /// Moves the offsets along an axis by a displacement [cells] and stores them in `to`. Uses the offsets
    /// that load_offset() has loaded for these items. `value` becomes what was stored. Returns which items
    /// are still within their cells.
    Mask<Lane> move_offset([[maybe_unused]] Offset const* from, Offset* to, int axis,
                           Lane const& displacement, Lane& value) const
    {
        auto const stored =
            CellOffset<Number>::moved(OffsetLane<Lane>::load(pack_->offset[axis]), displacement);
        if constexpr (lanes == 1)
            to[slot_] = stored;
        else
            store(reinterpret_cast<Number*>(to), OffsetLane<Lane>::bits(stored));
        value = CellOffset<Number>::value(stored);
        return CellOffset<Number>::inside(stored);
    }

    /// Copies values that no phase computes with.
    template <class T>
    void copy(T const* from, T* to) const
    {
        if constexpr (lanes > 1 && sizeof(T) == sizeof(Number))
            store(reinterpret_cast<Number*>(to), load(reinterpret_cast<Number const*>(from)));
        else
            for (int l = 0; l < entered_; ++l) to[slot_ + std::size_t(l)] = from[places()[l]];
    }

    /// The lanes of `ask(where the item lies)`.
    template <class Ask>
    Lane map(Ask const& ask) const
    {
        Number values[std::size_t(lanes)];
        FIRN_KEEP_LOOP
        for (int l = 0; l < lanes; ++l) values[l] = ask(places()[l]);
        return LaneTraits<Lane>::load(values);
    }

    /// One lane's element of an array.
    template <class T>
    T value(T const* array, int lane) const
    {
        return array[places()[lane]];
    }

    /// The coordinates of a cell, and the distances from it to the lanes' own cells along the axes.
    Coordinates<d> first() const { return Order::cell_at(cells_.blocks()[block_].coordinates, 0); }
    Vector<Lane, d> along() const
    {
        int place[std::size_t(lanes)];
        cells_.find_places(block_, slot_, entered_, place);
        Number steps[std::size_t(d)][std::size_t(lanes)];
        for (int l = 0; l < lanes; ++l) {
            auto const cell = Order::cell_at(zeros<Coordinates<d>>(), place[std::min(l, entered_ - 1)]);
            for (int a = 0; a < d; ++a) steps[a][l] = Number(cell[a]);
        }
        Vector<Lane, d> along;
        for (int a = 0; a < d; ++a) along[a] = LaneTraits<Lane>::load(steps[a]);
        return along;
    }

    /// Whether an item of these cells might leave the range of coordinates.
    bool at_the_edge() const
    {
        auto const cell = first();
        for (int a = 0; a < d; ++a)
            if (std::abs(double(cell[a])) > Order::largest_coordinate) return true;
        return false;
    }

protected:
    Scratch<Lane, d>& scratch_;
    Order const& cells_;
    std::size_t block_;
    std::size_t slot_ = 0, item_ = 0;

private:
    auto load_stored_offset(Offset const* array) const
    {
        if constexpr (lanes == 1)
            return array[places()[0]];
        else
            return OffsetLane<Lane>::of_bits(load(reinterpret_cast<Number const*>(array)));
    }

    Places<Lane> const& places() const { return pack_->places; }

    typename Scratch<Lane, d>::Pack* pack_ = nullptr;
    int entered_ = 0;
    Mask<Lane> here_{};
};

/// Items that move and may leave their cells.
template <class Lane, class Order, int d>
class MovingItems : public Items<Lane, Order, d>
{
    using Base = Items<Lane, Order, d>;

public:
    using Base::lanes;
    using typename Base::Number, typename Base::Offset;

    MovingItems(Order& cells, std::size_t block, Scratch<Lane, d>& scratch,
                typename Order::LeaverNotes& notes)
        : Base(cells, block, scratch), notes_(notes)
    {
        notes.start(cells.blocks()[block].end - cells.blocks()[block].begin);
    }

    /// As in Items; remembers where the offsets went.
    Mask<Lane> move_offset(Offset const* from, Offset* to, int axis, Lane const& displacement,
                           Lane& value) const
    {
        moved_[axis] = to;
        return Base::move_offset(from, to, axis, displacement, value);
    }

    /// Records leavers with their contributions, `kept` channels each, and sets those channels from
    /// `zero_from` on to zero in the scratch. The first channels of a contribution are the offset, now
    /// relative to the new cell.
    void leave(Mask<Lane> const& which, int zero_from, int kept)
    {
        std::uint64_t rest = bits(which);
        notes_.expect(static_cast<std::size_t>(std::popcount(rest)), static_cast<std::size_t>(kept));
        std::size_t count = notes_.count;
        for (; rest != 0; rest &= rest - 1, ++count) {
            int const lane = std::countr_zero(rest);
            auto const slot = static_cast<std::uint32_t>(this->slot_) + static_cast<std::uint32_t>(lane);
            find_group(slot);
            Number* const contribution = notes_.contribution.data() + count * static_cast<std::size_t>(kept);
            for (int c = d; c < kept; ++c) {
                auto& value = *this->scratch_.at(c, this->item_ + static_cast<std::size_t>(lane));
                contribution[c] = value;
                if (c >= zero_from) value = 0;
            }
            std::array<int, std::size_t(d)> steps;
            for (int a = 0; a < d; ++a) {
                Offset offset = moved_[a][slot];
                steps[static_cast<std::size_t>(a)] = CellOffset<Number>::wrap(offset);
                contribution[a] = CellOffset<Number>::value(offset);
            }
            std::uint32_t const at = notes_.at[slot - first_slot_];
            notes_.from[count] = {slot, at};
            notes_.leavers[count] =
                Migration<Number, d, lanes>::moved(slot, group_ * lanes + int(at % lanes), steps);
        }
        notes_.count = count;
    }

private:
    /// Finds the group of a slot that an item leaves, and where each of its items is in the group; slots come
    /// in rising order.
    void find_group(std::uint32_t slot)
    {
        if (slot < end_slot_) return;
        do ++group_;
        while (slot >= this->cells_.group_end(this->block_, group_));
        first_slot_ = this->cells_.group_begin(this->block_, group_);
        end_slot_ = this->cells_.group_end(this->block_, group_);
        this->cells_.list_places(this->block_, group_, notes_.at);
    }

    typename Order::LeaverNotes& notes_;
    int group_ = -1; ///< of the last leaver
    std::uint32_t first_slot_ = 0, end_slot_ = 0;
    mutable Offset* moved_[std::size_t(d)]{}; ///< where offsets were written, along each axis
};

} // namespace firn::openmp
