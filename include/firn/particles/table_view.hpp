// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace firn
{

namespace detail
{
/// `Value`, const where `Number` is.
template <class Number, class Value>
using ConstLike = std::conditional_t<std::is_const_v<Number>, Value const, Value>;
} // namespace detail

/// A view of the particle table: positions as offsets from the centres of their cells, one array per
/// component of each field, and the rows that identify particles (see ParticleTable). With a const `Number`
/// it is a view to read only.
template <class Number, int d, class Set>
struct TableView
{
    static constexpr int components = Set::components(d);

    using Offset = detail::ConstLike<Number, typename CellOffset<std::remove_const_t<Number>>::Stored>;
    using Row = detail::ConstLike<Number, std::uint32_t>;
    using ConstView = TableView<Number const, d, Set>;

    std::array<Offset*, std::size_t(d)> offset;
    std::array<Number*, std::size_t(components)> component;
    Row* id;

    /// The same, to read only. A template, since compilers warn of a conversion from a type to itself.
    template <class Other>
    operator Other() const requires(!std::is_const_v<Number> && std::is_same_v<Other, ConstView>)
    {
        ConstView view{.offset = {}, .component = {}, .id = id};
        std::copy(offset.begin(), offset.end(), view.offset.begin());
        std::copy(component.begin(), component.end(), view.component.begin());
        return view;
    }

    /// Reads the items' offsets from the centres of their cells, in cells.
    template <class Items>
    FIRN_HOST_DEVICE Vector<typename Items::Real, d> position(Items const& items) const
    {
        Vector<typename Items::Real, d> position;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a) position[a] = items.load_offset(offset[std::size_t(a)], a);
        return position;
    }

    /// Writes the offsets of `before` plus a displacement [cells], each component within [-1, 1], after
    /// position() of `before` was called for the same items. `position` becomes what was written. Returns
    /// which items are still in their cells.
    template <class Items>
    FIRN_HOST_DEVICE auto move(Items const& items, ConstView const& before,
                               Vector<typename Items::Real, d> const& displacement,
                               Vector<typename Items::Real, d>& position) const
    {
        auto stays = items.here();
        FIRN_UNROLL
        for (int a = 0; a < d; ++a)
            stays = stays & items.move_offset(before.offset[std::size_t(a)], offset[std::size_t(a)], a,
                                              displacement[a], position[a]);
        return stays;
    }

    /// Reads the fields of the items into a record that has them.
    template <class Items, class Record>
    FIRN_HOST_DEVICE void load(Items const& items, Record& record) const
    {
        for_each_component_of<Set, d>(
            record, [&](int c, auto& value) { value = items.load(component[std::size_t(c)]); });
    }

    /// Prefetch hint: the fields will soon be read.
    template <class Items>
    FIRN_HOST_DEVICE void expect_load(Items const& items) const
    {
        FIRN_UNROLL
        for (int c = 0; c < components; ++c) items.expect_load(component[std::size_t(c)]);
    }

    /// Prefetch hint: all of the table will soon be written.
    template <class Items>
    FIRN_HOST_DEVICE void expect_store(Items const& items) const
    {
        for (auto* const array : offset) items.expect_store(array);
        for (auto* const array : component) items.expect_store(array);
        items.expect_store(id);
    }

    /// Writes the fields of the items from a record that has them.
    template <class Items, class Record>
    FIRN_HOST_DEVICE void store(Items const& items, Record& record) const
    {
        for_each_component_of<Set, d>(
            record, [&](int c, auto& value) { items.store(component[std::size_t(c)], value); });
    }
};

/// Fields that are not stored from step to step, while they are cached: one array per component, by row. With
/// a const `Number` it is a view to read only.
template <class Number, int d, class Set>
struct FieldsById
{
    static constexpr int components = Set::components(d);
    using ConstView = FieldsById<Number const, d, Set>;

    std::array<Number*, std::size_t(components)> component{};
    bool present = false;
    bool same = false; ///< all particles have the values of row 0, which alone are stored; to read only

    /// The same, to read only. A template, since compilers warn of a conversion from a type to itself.
    template <class Other>
    operator Other() const requires(!std::is_const_v<Number> && std::is_same_v<Other, ConstView>)
    {
        ConstView view{.component = {}, .present = present, .same = same};
        std::copy(component.begin(), component.end(), view.component.begin());
        return view;
    }

    /// Where the values of a row are.
    FIRN_HOST_DEVICE std::uint32_t place_of(std::uint32_t row) const { return same ? 0 : row; }

    template <class Items, class Record>
    FIRN_HOST_DEVICE void load(Items const& items, std::uint32_t const* id, Record& record) const
    {
        for_each_component_of<Set, d>(record, [&](int c, auto& value) {
            value = items.map(
                [&](std::size_t particle) { return component[std::size_t(c)][place_of(id[particle])]; });
        });
    }

    template <class Items, class Record>
    FIRN_HOST_DEVICE void store(Items const& items, std::uint32_t const* id, Record& record) const
    {
        for_each_component_of<Set, d>(
            record, [&](int c, auto& value) { items.store_at(component[std::size_t(c)], id, value); });
    }

    /// The same by slot, which is faster, for as long as particles keep their slots.
    template <class Items, class Record>
    FIRN_HOST_DEVICE void load_by_slot(Items const& items, Record& record) const
    {
        for_each_component_of<Set, d>(
            record, [&](int c, auto& value) { value = items.load_stored(component[std::size_t(c)]); });
    }
    /// Some of the fields, which follow one another in the set.
    template <class First, class... Rest>
    auto part(Fields<First, Rest...>) const
    {
        using Part = Fields<First, Rest...>;
        FieldsById<Number, d, Part> view{.component = {}, .present = present, .same = same};
        std::copy_n(component.begin() + Set::template first_component<First>(d), Part::components(d),
                    view.component.begin());
        return view;
    }
    template <class Items, class Record>
    FIRN_HOST_DEVICE void store_by_slot(Items const& items, Record& record) const
    {
        for_each_component_of<Set, d>(
            record, [&](int c, auto& value) { items.store(component[std::size_t(c)], value); });
    }
};

} // namespace firn
