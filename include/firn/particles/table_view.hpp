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

    /// The same, to read only. A template, since compilers warn of a conversion from a type to itself.
    template <class Other>
    operator Other() const requires(!std::is_const_v<Number> && std::is_same_v<Other, ConstView>)
    {
        ConstView view{.component = {}, .present = present};
        std::copy(component.begin(), component.end(), view.component.begin());
        return view;
    }

    template <class Items, class Record>
    FIRN_HOST_DEVICE void load(Items const& items, std::uint32_t const* id, Record& record) const
    {
        for_each_component_of<Set, d>(record, [&](int c, auto& value) {
            value = items.map([&](std::size_t particle) { return component[std::size_t(c)][id[particle]]; });
        });
    }

    template <class Items, class Record>
    FIRN_HOST_DEVICE void store(Items const& items, std::uint32_t const* id, Record& record) const
    {
        for_each_component_of<Set, d>(
            record, [&](int c, auto& value) { items.store_at(component[std::size_t(c)], id, value); });
    }
};

/// One field of all particles in the backend's memory, for example to render it there without a copy.
///
/// Component c of the particle in row `row[i]` of a download is `component[c][i * stride]`; the row is the
/// particle's permanent id until one is removed, or one of another material added (see Solver::ids). Every
/// step changes the order of particles and the pointers: request a new view after it.
template <class Number, int components>
struct FieldView
{
    std::array<Number const*, std::size_t(components)> component;
    std::uint32_t const* row;
    std::size_t stride = 1; ///< from one particle to the next [numbers]
    std::size_t count;      ///< particles
};

/// Writes one field of a particle: called for every place of a particle, or for every row if fields are
/// stored by row.
template <class Number, int components>
struct WriteField
{
    std::array<Number const*, std::size_t(components)> component;
    std::uint32_t const* row; ///< of the particle at a place; null if the place is the row
    Number* to;               ///< component c of the particle in a row at to[row * stride + c]
    std::size_t stride;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        std::size_t const first = (row ? row[place] : place) * stride;
        FIRN_UNROLL
        for (int c = 0; c < components; ++c)
            to[first + static_cast<unsigned>(c)] = component[std::size_t(c)][place];
    }
};

/// Writes the world position of a particle: called for every particle with its place and its cell.
template <class Number, int d, class Set>
struct WritePositions
{
    TableView<Number const, d, Set> particles;
    Lattice lattice;
    int kernel_degree;
    Number* to; ///< axis a of the particle in a row at to[row * stride + a] [m]
    std::size_t stride;

    FIRN_HOST_DEVICE void operator()(std::size_t particle, Coordinates<d> const& cell) const
    {
        Vector<double, d> in_cell;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a)
            in_cell[a] = CellOffset<Number>::exact(particles.offset[std::size_t(a)][particle]);
        Vector<double, d> const x = world_position<d>(lattice, kernel_degree, cell, in_cell);
        FIRN_UNROLL
        for (int a = 0; a < d; ++a)
            to[particles.id[particle] * stride + std::size_t(a)] = static_cast<Number>(x[a]);
    }
};

/// Predicates of a particle's position [m], or of that and its fields.
template <class Call, int d>
concept TellsByPosition = std::is_invocable_r_v < bool,
        Call const&, Vector<double, d>
const& > ;
template <class Call, int d, class Particle>
concept TellsByFields = std::is_invocable_r_v < bool,
        Call const&, Vector<double, d>
const&, Particle const& > ;

/// Finds the particles for which a predicate is true: called for every particle with its place and its cell.
template <class Number, int d, class PersistentFields, class DerivedFields, class IsWanted>
struct FindParticles
{
    using Particle = Record<Number, d, Join<PersistentFields, DerivedFields>>;
    static constexpr bool by_position = TellsByPosition<IsWanted, d>;

    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number const, d, DerivedFields> velocities; ///< if the predicate reads fields
    Lattice lattice;
    int kernel_degree;
    IsWanted is_wanted;
    unsigned char* found; ///< 1 or 0, by the particle's place

    FIRN_HOST_DEVICE void operator()(std::size_t particle, Coordinates<d> const& cell) const
    {
        Vector<double, d> in_cell;
        FIRN_UNROLL
        for (int a = 0; a < d; ++a)
            in_cell[a] = CellOffset<Number>::exact(particles.offset[std::size_t(a)][particle]);
        Vector<double, d> const x = world_position<d>(lattice, kernel_degree, cell, in_cell);
        if constexpr (by_position)
            found[particle] = is_wanted(x) ? 1 : 0;
        else {
            Particle fields;
            for_each_component_of<PersistentFields, d>(
                fields, [&](int c, Number& value) { value = particles.component[c][particle]; });
            for_each_component_of<DerivedFields, d>(fields, [&](int c, Number& value) {
                value = velocities.component[c][particles.id[particle]];
            });
            found[particle] = is_wanted(x, fields) ? 1 : 0;
        }
    }
};

/// Copies the listed elements of an array.
template <class T>
struct GatherValues
{
    T const* from;
    std::uint32_t const* places;
    T* to;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const { to[i] = from[places[i]]; }
};

/// Particles of equal mass and volume: those from row `first_row` up to the next group's.
template <class Number>
struct MassGroup
{
    std::uint32_t first_row;
    Number mass;   ///< in units of the scene's mass unit
    Number volume; ///< V0 [m^3] per mass unit [kg]
};

/// Mass and volume of every particle: one value per mass group, found by the particle's row, so that none is
/// stored per particle.
template <class Number>
struct MassGroups
{
    MassGroup<Number> const* of;
    int count;

    /// The lanes' masses and volumes: both zero in lanes without an item.
    template <class Items>
    FIRN_HOST_DEVICE auto find(Items const& items, std::uint32_t const* id) const
    {
        using Real = typename Items::Real;
        struct Found
        {
            Real mass, volume;
        };
        Found found{Real(of[0].mass), Real(of[0].volume)};
        if (count > 1) {
            found.mass = items.map([&](std::size_t particle) { return of[index(id[particle])].mass; });
            found.volume = items.map([&](std::size_t particle) { return of[index(id[particle])].volume; });
        }
        found.mass = select(items.here(), found.mass, Real(0));
        found.volume = select(items.here(), found.volume, Real(0));
        return found;
    }

    FIRN_HOST_DEVICE int index(std::uint32_t row) const
    {
        int low = 0, high = count; // of[low].first_row <= row < of[high].first_row
        while (high - low > 1) {
            int const middle = (low + high) / 2;
            (of[middle].first_row <= row ? low : high) = middle;
        }
        return low;
    }
};

} // namespace firn
