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
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

// The order of cells, and one of its items as a phase sees it. What their members owe is in firn/backend.hpp.
namespace firn::reference
{

/// The order of cells and nodes.
struct FirstAxisFirst
{
    bool operator()(auto const& a, auto const& b) const
    {
        return std::lexicographical_compare(a.begin(), a.end(), b.begin(), b.end());
    }
};

/// The items sorted by their cells, the first axis first. Sorting moves no item: `place` says where the item
/// of a slot lies.
template <class Number, int d>
class CellOrder
{
public:
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
    static constexpr int extent(int /*axis*/) { return 1; }

    explicit CellOrder(Reference const&, Periods<d> const& periods = {}) : periods_(periods) {}

    std::size_t size() const { return entries_.size(); }
    std::size_t memory() const { return entries_.capacity() * sizeof(Entry); }
    Entry const& operator[](std::size_t slot) const { return entries_.at(slot); }

    void insert(Coordinates<d> const* where, std::size_t count, std::uint32_t first)
    {
        assert(!committed_ && "items that moved have been rebinned");
        for (auto const& cell : std::span(where, count))
            entries_.push_back({periods_.wrapped(cell), first++});
        sort();
    }
    void erase(unsigned char const* gone, std::uint32_t const* new_place, [[maybe_unused]] std::size_t kept)
    {
        assert(!committed_ && "items that moved have been rebinned");
        std::erase_if(entries_, [&](Entry const& entry) { return gone[entry.place] != 0; });
        for (Entry& entry : entries_) entry.place = new_place[entry.place];
        assert(size() == kept && "all others are kept");
    }

    void commit() { committed_ = true; }
    void rebin(std::array<Offset*, std::size_t(d)> const& offset)
    {
        assert(committed_ && "items that are sorted lie at their slots");
        for (std::uint32_t slot = 0; slot < size(); ++slot) {
            Entry& entry = entries_[slot];
            entry.place = slot;
            for (int a = 0; a < d; ++a)
                entry.cell[a] += CellOffset<Number>::wrap(offset[std::size_t(a)][slot]);
            entry.cell = periods_.wrapped(entry.cell);
        }
        committed_ = false;
        sort();
    }
    /// The same. Another backend may leave a part of the work to the loop that needs it first.
    void begin_rebin(std::array<Offset*, std::size_t(d)> const& offset) { rebin(offset); }

    void for_each(auto const& visit) const
    {
        for (std::size_t slot = 0; slot < size(); ++slot)
            visit(committed_ ? slot : std::size_t{entries_[slot].place}, entries_[slot].cell);
    }

protected:
    /// Stable, so that the items of a cell are added up in the same order in every run.
    void sort() { std::ranges::stable_sort(entries_, FirstAxisFirst{}, &Entry::cell); }

    std::vector<Entry> entries_; ///< by slot
    bool committed_ = false;     ///< whether items lie at their slots
    Periods<d> periods_;
};

/// One item, as a phase sees it. It has both roles: that of items side by side, and that of a group of cells.
/// Loads come from where it lies, and stores go to its slot. `Nodes` are those around its cell, if the phase
/// gathers.
template <class Phase, class Nodes>
class Item
{
    static constexpr int d = Phase::d;

public:
    using Real = typename Phase::Number;
    using Order = CellOrder<Real, d>;
    using Offset = typename Order::Offset;

    Item(Order const& cells, std::size_t slot, Nodes const& nodes)
        : slot_(slot), place_(cells[slot].place), cell_(cells[slot].cell), nodes_(nodes)
    {
        scratch_.fill(std::numeric_limits<Real>::quiet_NaN());
    }

    // As items side by side: there is one.
    bool here() const { return true; }
    Real load(Real const* array) const { return array[place_]; }
    void store(Real* array, Real value) const { array[slot_] = value; }
    Real load_stored(Real const* array) const { return array[slot_]; }
    void store_at(Real* array, auto const* index, Real value) const { array[index[place_]] = value; }
    void copy(auto const* from, auto* to) const { to[slot_] = from[place_]; }
    Real map(auto const& ask) const { return ask(place_); }
    auto value(auto const* array, int /*lane*/) const { return array[place_]; }
    void expect_load(auto const*) const {}
    void expect_store(auto const*) const {}

    Real load_offset(Offset const* array, int) const { return CellOffset<Real>::value(array[place_]); }
    bool move_offset(Offset const* from, Offset* to, int axis, Real displacement, Real& value) const
    {
        Offset const moved = CellOffset<Real>::moved(from[place_], displacement);
        to[slot_] = moved_[axis] = moved;
        value = CellOffset<Real>::value(moved);
        return CellOffset<Real>::inside(moved);
    }
    /// The item leaves for the cell to which its offset leads, and scatters there: all channels, and nothing
    /// where it was.
    void leave(bool /*which*/, int /*zero_from*/, int /*channels*/)
    {
        for (int a = 0; a < d; ++a) {
            cell_[a] += CellOffset<Real>::wrap(moved_[a]);
            set_scratch(a, CellOffset<Real>::value(moved_[a]));
        }
    }

    Coordinates<d> first() const { return cell_; }
    Vector<Real, d> along() const { return zeros<Vector<Real, d>>(); }
    bool at_the_edge() const { return cell_.cwiseAbs().maxCoeff() > Order::largest_coordinate; }

    // As a group of cells: there is one, too.
    Real reference(int channel) const
    {
        return nodes_.at(nodes_.size() / 2).at(nodes_[0].size() / 2)[channel];
    }
    Real node(int channel, int row, int k) const
    {
        return nodes_.at(std::size_t(k)).at(std::size_t(row))[channel] - reference(channel);
    }
    void set_scratch(int channel, Real value) { scratch_.at(std::size_t(channel)) = value; }
    Real scratch(int channel) const { return scratch_.at(std::size_t(channel)); }

private:
    std::size_t slot_;
    std::uint32_t place_;
    Coordinates<d> cell_;
    Nodes const& nodes_;
    std::array<Real, std::size_t(Phase::scratch_channels)> scratch_;
    mutable Offset moved_[std::size_t(d)]{};
};

} // namespace firn::reference
