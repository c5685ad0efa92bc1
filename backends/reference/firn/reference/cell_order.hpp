// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/reference/array.hpp>

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

// The order of cells, and one of its items as a phase sees it.
namespace firn::reference
{

/// The order of cells and nodes.
struct FirstAxisFirst
{
    template <class Coordinates>
    bool operator()(Coordinates const& a, Coordinates const& b) const
    {
        return std::lexicographical_compare(a.data(), a.data() + a.size(), b.data(), b.data() + b.size());
    }
};

/// An item that left its cell, with what it scatters in the new one: a phase scatters it as it is.
template <class Number, int d>
struct Leaver
{
    using Real = Number;

    Coordinates<d> cell;              ///< the new one
    std::vector<Number> contribution; ///< its scratch; the offset, which comes first, is that in the new cell

    Number scratch(int channel) const { return contribution[std::size_t(channel)]; }
};

/// The items sorted by their cells, the first axis first. Their place in that order is their *slot*. Sorting
/// moves no item: `place` says where the item of a slot lies. A step reads items from there, and stores them
/// at their slots. After commit() they lie there, but until rebin() what was read can be read once more.
template <class NumberType, int d>
class CellOrder
{
public:
    using Number = NumberType;
    using Offset = typename CellOffset<Number>::Stored;

    /// An item of the order.
    struct Entry
    {
        Coordinates<d> cell;
        std::uint32_t place; ///< where the item lies, or lay before commit()
    };

    /// Items beyond this coordinate are refused; the other backends have the same range.
    static constexpr double largest_coordinate = d == 3 ? 4.0e6 : 1.0e9;
    static constexpr std::size_t bytes_per_item = sizeof(Entry);

    explicit CellOrder(Reference const&, Periods<d> const& periods = {}) : periods_(periods) {}

    /// The cells that are stored together along an axis, of which a period is a multiple.
    static constexpr int extent(int) { return 1; }

    std::size_t size() const { return entries_.size(); }
    Entry const& operator[](std::size_t slot) const { return entries_.at(slot); }

    /// Adds items that lie at first, first + 1, … in the given cells.
    void insert(std::span<Coordinates<d> const> cells, std::uint32_t first)
    {
        assert(!committed_ && "items that moved have been rebinned");
        leavers.clear();
        for (auto const& cell : cells) entries_.push_back({periods_.wrapped(cell), first++});
        sort();
    }

    /// Erases the items for which `gone[where it lies]` is not 0. The other `kept` ones will lie at
    /// `new_place[where it lies]`.
    void erase(unsigned char const* gone, std::uint32_t const* new_place, [[maybe_unused]] std::size_t kept)
    {
        assert(!committed_ && "items that moved have been rebinned");
        leavers.clear();
        std::erase_if(entries_, [&](Entry const& entry) { return gone[entry.place] != 0; });
        for (Entry& entry : entries_) entry.place = new_place[entry.place];
        assert(size() == kept && "all others are kept");
    }

    /// Says that all items now lie at their slots.
    void commit() { committed_ = true; }

    /// Sorts items into the cells to which their offsets lead, and wraps these.
    void rebin(std::array<Offset*, std::size_t(d)> const& offset)
    {
        assert(committed_ && "items that are sorted lie at their slots");
        for (std::uint32_t slot = 0; slot < size(); ++slot) {
            entries_[slot].place = slot;
            for (int a = 0; a < d; ++a)
                entries_[slot].cell[a] += CellOffset<Number>::wrap(offset[std::size_t(a)][slot]);
            entries_[slot].cell = periods_.wrapped(entries_[slot].cell);
        }
        committed_ = false;
        sort();
    }
    /// The same. Another backend may leave a part of the work to the loop that needs it first.
    void begin_rebin(std::array<Offset*, std::size_t(d)> const& offset) { rebin(offset); }

    /// Calls `visit(where it lies, its cell)` for every item.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        for (std::size_t slot = 0; slot < size(); ++slot)
            visit(committed_ ? slot : std::size_t{entries_[slot].place}, entries_[slot].cell);
    }

    std::size_t memory() const
    {
        std::size_t bytes = entries_.capacity() * sizeof(Entry);
        for (auto const& leaver : leavers)
            bytes += sizeof(leaver) + leaver.contribution.capacity() * sizeof(Number);
        return bytes;
    }

    /// The items that left their cells when they last moved.
    std::vector<Leaver<Number, d>> leavers;

private:
    /// Stable, so that the items of a cell are added up in the same order in every run.
    void sort()
    {
        std::stable_sort(entries_.begin(), entries_.end(),
                         [](Entry const& a, Entry const& b) { return FirstAxisFirst{}(a.cell, b.cell); });
    }

    std::vector<Entry> entries_; ///< by slot
    bool committed_ = false;     ///< whether items lie at their slots
    Periods<d> periods_;
};

/// One item, as a phase sees it, with `channels` values of scratch. It has both roles: that of items side by
/// side, and that of a group of cells. Loads come from where it lies, and stores go to its slot.
template <class Number, int d, int channels, class StencilType>
class Item
{
public:
    using Real = Number;
    using Order = CellOrder<Number, d>;
    using Offset = typename Order::Offset;

    /// `nodes` are those around its cell, if the phase gathers.
    Item(Order const& cells, std::size_t slot, StencilType const& nodes)
        : slot_(slot), place_(cells[slot].place), cell_(cells[slot].cell), nodes_(nodes)
    {
        scratch_.fill(std::numeric_limits<Number>::quiet_NaN());
    }

    // As items side by side: there is one.
    bool here() const { return true; }
    Number load(Number const* array) const { return array[place_]; }
    void store(Number* array, Number value) const { array[slot_] = value; }
    void store_at(Number* array, std::uint32_t const* index, Number value) const
    {
        array[index[place_]] = value;
    }
    void copy(auto const* from, auto* to) const { to[slot_] = from[place_]; }
    Number map(auto const& ask) const { return ask(place_); }
    auto value(auto const* array, int) const { return array[place_]; }
    void expect_load(auto const*) const {}
    void expect_store(auto const*) const {}

    Number load_offset(Offset const* array, int) const { return CellOffset<Number>::value(array[place_]); }
    /// Moves the offset along an axis by a displacement [cells]; `value` becomes what was stored. Returns
    /// whether the item is still within its cell.
    bool move_offset(Offset const* from, Offset* to, int axis, Number displacement, Number& value) const
    {
        Offset const moved = CellOffset<Number>::moved(from[place_], displacement);
        to[slot_] = moved_[axis] = moved;
        value = CellOffset<Number>::value(moved);
        return CellOffset<Number>::inside(moved);
    }
    /// The item leaves for the cell to which its offset leads: it scatters the first `kept` channels there,
    /// and nothing here.
    void leave(bool, int, int kept)
    {
        for (int a = 0; a < d; ++a) {
            cell_[a] += CellOffset<Number>::wrap(moved_[a]);
            scratch_[std::size_t(a)] = CellOffset<Number>::value(moved_[a]);
        }
        kept_ = kept;
    }
    bool has_left() const { return kept_ > 0; }
    Leaver<Number, d> leaver() const { return {cell_, {scratch_.begin(), scratch_.begin() + kept_}}; }

    Coordinates<d> first() const { return cell_; }
    Vector<Number, d> along() const { return zeros<Vector<Number, d>>(); }
    bool at_the_edge() const
    {
        for (int const at : cell_)
            if (std::abs(double(at)) > Order::largest_coordinate) return true;
        return false;
    }

    // As a group of cells: there is one, too.
    Number node(int channel, int row, int k) const
    {
        return nodes_.at(std::size_t(k)).at(std::size_t(row))[channel];
    }

    void set_scratch(int channel, Number value) { scratch_.at(std::size_t(channel)) = value; }
    Number scratch(int channel) const { return scratch_.at(std::size_t(channel)); }

private:
    std::size_t slot_;
    std::uint32_t place_;
    Coordinates<d> cell_;
    StencilType const& nodes_;
    std::array<Number, std::size_t(channels)> scratch_;
    mutable Offset moved_[std::size_t(d)]{};
    int kept_ = 0; ///< channels of a leaver
};

} // namespace firn::reference
