// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/cell_offset.hpp>
#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/parameters.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/row_ids.hpp>
#include <firn/particles/storage.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

// Snapshots of the particles of one material. `Table` is a ParticleTable.
namespace firn
{

/// One field of all particles of a material.
template <class Number>
struct FieldSnapshot
{
    std::string name;                            ///< the name of its tag
    std::vector<std::vector<Number>> components; ///< per component, one number per particle [SI units]
};

/// The particles of one material, in cell order.
template <class Number, int d>
struct MaterialSnapshot
{
    using Offset = typename CellOffset<Number>::Stored;

    std::string name;                    ///< of the model
    double density = 0;                  ///< of the model [kg/m^3]
    double wave_modulus = 0;             ///< rho c^2 of the model at rest [Pa]; 0: not compared
    std::vector<Parameter> parameters{}; ///< the model's parameters
    std::vector<std::uint32_t> ids{};    ///< permanent
    std::vector<Coordinates<d>> cells{}; ///< the particles' cells
    std::array<std::vector<Offset>, std::size_t(d)>
        offsets{}; ///< offsets from the cells' centres, as CellOffset stores them
    std::vector<FieldSnapshot<Number>> fields{};  ///< the particles' other fields
    std::vector<MassGroup<Number>> mass_groups{}; ///< mass and volume, by row (the rank of the id)

    /// See Snapshot::forget_parameters.
    void forget_parameters()
    {
        parameters.clear();
        wave_modulus = 0;
    }
};

namespace detail
{
/// The listed elements of an array.
template <class Values, class Place>
auto listed(Values const& from, std::vector<Place> const& places)
{
    auto const pick = [&](auto const& values) {
        std::vector<typename std::decay_t<decltype(values)>::value_type> picked(places.size());
        for (std::size_t i = 0; i < places.size(); ++i) picked[i] = values[places[i]];
        return picked;
    };
    if constexpr (requires { from.begin(); })
        return pick(from);
    else
        return pick(downloaded(from));
}

/// Calls `use(component, column)` for the components of a field, counted in the field and in the set.
template <class Set, int d, class Tag, class Use>
void for_each_column(Tag, Use const& use)
{
    constexpr int first = Set::template first_component<Tag>(d);
    for (int c = 0; c < component_count<Tag>(d); ++c) use(std::size_t(c), std::size_t(first + c));
}

template <class Tag, class Number, int d>
FieldSnapshot<Number> const& field_of(MaterialSnapshot<Number, d> const& from)
{
    return *std::ranges::find(from.fields, std::string(Tag::name), &FieldSnapshot<Number>::name);
}

/// Adds the fields of a set to a snapshot; `values(component in the set)` are those of the particles.
template <class Set, class Number, int d, class Values>
void add_fields(MaterialSnapshot<Number, d>& to, Values const& values)
{
    for_each_tag(Set{}, [&](auto tag) {
        to.fields.push_back({decltype(tag)::name, {}});
        for_each_column<Set, d>(
            tag, [&](std::size_t, std::size_t c) { to.fields.back().components.push_back(values(c)); });
    });
}
} // namespace detail

namespace detail
{
/// Calls `use(list)` for the lists of a snapshot that have one element per particle.
template <class Number, int d, class Use>
void for_each_list(MaterialSnapshot<Number, d>& of, Use const& use)
{
    use(of.ids);
    use(of.cells);
    for (auto& list : of.offsets) use(list);
    for (auto& field : of.fields)
        for (auto& list : field.components) use(list);
}

/// Makes one snapshot of those that the ranks have of their own particles, in the same order as on one rank.
/// Their cells are from `centre` on.
template <class Table, class Number, int d>
void gather_snapshot(Table const& table, MaterialSnapshot<Number, d>& to,
                     Coordinates<d> const& centre = zeros<Coordinates<d>>())
{
    for_each_list(to, [&](auto& list) { list = of_all_ranks(table.backend(), std::move(list)); });
    std::vector<std::uint64_t> keys;
    for (auto const& cell : to.cells) keys.push_back(table.cells().block_of(cell + centre));
    std::vector<std::uint32_t> places(keys.size());
    std::iota(places.begin(), places.end(), std::uint32_t(0));
    std::ranges::stable_sort(places, {}, [&](std::uint32_t place) { return keys[place]; });
    for_each_list(to, [&](auto& list) { list = listed(list, places); });
}

/// Those of a snapshot's values that are about particles that lie here: on one rank all of them.
template <class Backend, class Values>
decltype(auto) values_here(Values const& all, [[maybe_unused]] std::vector<std::uint32_t> const& own)
{
    if constexpr (spans_ranks<Backend>)
        return listed(all, own);
    else
        return (all);
}
} // namespace detail

/// All particles, in memory of the host; requires has_grid_fields(). The caller adds the model's name and
/// stiffness.
template <class Table>
auto snapshot_of(Table& table)
{
    constexpr int d = Table::d;
    using Number = typename Table::Number;
    using PersistentFields = typename Table::PersistentFields;
    using DerivedFields = typename Table::DerivedFields;
    table.sort();
    auto const& buffer = table.contents().buffer[0];
    MaterialSnapshot<Number, d> to;
    std::vector<std::size_t> places; // in cell order
    table.cells().for_each([&](std::size_t place, Coordinates<d> const& cell) {
        places.push_back(place);
        to.cells.push_back(cell);
    });
    for (std::size_t a = 0; a < to.offsets.size(); ++a)
        to.offsets[a] = detail::listed(buffer.offset[a], places);
    std::vector<std::uint32_t> const rows = detail::listed(buffer.id, places);
    for (std::uint32_t const row : rows) to.ids.push_back(table.id(row));
    detail::add_fields<PersistentFields>(
        to, [&](std::size_t c) { return detail::listed(buffer.component[c], places); });
    detail::add_fields<DerivedFields>(
        to, [&](std::size_t c) { return detail::listed(table.cached().column(int(c)), rows); });
    to.mass_groups = table.contents().mass_groups.all();
    if constexpr (spans_ranks<typename Table::Backend>) detail::gather_snapshot(table, to);
    return to;
}

/// The cell order of a snapshot's particles, built afresh. If as many particles are in the table already,
/// this alone allocates memory for a restore.
template <class Table>
typename Table::CellOrder cell_order_of(Table const& table,
                                        MaterialSnapshot<typename Table::Number, Table::d> const& from)
{
    typename Table::CellOrder cells(table.backend(), periods_of<Table::d>(table.lattice()));
    if (from.ids.empty()) return cells;
    auto const insert = [&](std::vector<Coordinates<Table::d>> const& here) {
        auto const there = detail::array_of(table.backend(), here);
        cells.insert(there.data(), here.size(), 0);
    };
    if constexpr (spans_ranks<typename Table::Backend>)
        insert(detail::listed(from.cells, cells.own(from.cells)));
    else
        insert(from.cells);
    return cells;
}

/// Replaces the particles by those of a snapshot from a table of the same fields, in the snapshot's order.
/// `cells` is from cell_order_of().
template <class Table>
void restore_particles(Table& table, MaterialSnapshot<typename Table::Number, Table::d> const& from,
                       typename Table::CellOrder cells)
{
    constexpr int d = Table::d;
    using PersistentFields = typename Table::PersistentFields;
    using DerivedFields = typename Table::DerivedFields;
    std::size_t const count = from.ids.size();
    std::vector<std::uint32_t> at_row(count), rows(count);
    std::iota(at_row.begin(), at_row.end(), std::uint32_t(0));
    std::sort(at_row.begin(), at_row.end(),
              [&](auto const& a, auto const& b) { return from.ids[a] < from.ids[b]; });
    for (std::size_t row = 0; row < count; ++row) rows[at_row[row]] = static_cast<std::uint32_t>(row);

    table.change([&] {
        auto& to = table.contents();
        auto& buffer = to.buffer[0];
        std::vector<std::uint32_t> own;
        if constexpr (spans_ranks<typename Table::Backend>) own = cells.own(from.cells);
        auto const here = [&](auto const& values) -> decltype(auto) {
            return detail::values_here<typename Table::Backend>(values, own);
        };
        to.places = 0;
        to.resize_buffers(table.backend(), cells.size());
        to.gathered.resize(count);
        for (std::size_t a = 0; a < from.offsets.size(); ++a)
            buffer.offset[a].upload(0, here(from.offsets[a]));
        buffer.id.upload(0, here(rows));
        for_each_tag(PersistentFields{}, [&](auto tag) {
            auto const& field = detail::field_of<decltype(tag)>(from);
            detail::for_each_column<PersistentFields, d>(tag, [&](std::size_t i, std::size_t c) {
                buffer.component[c].upload(0, here(field.components[i]));
            });
        });
        for_each_tag(DerivedFields{}, [&](auto tag) {
            auto const& field = detail::field_of<decltype(tag)>(from);
            detail::for_each_column<DerivedFields, d>(tag, [&](std::size_t i, std::size_t c) {
                table.cached().column(int(c)).upload(0, detail::listed(field.components[i], at_row));
            });
        });
        to.ids = RowIds(detail::listed(from.ids, at_row));
        to.mass_groups.set(from.mass_groups);
        to.size = count;
        to.places = cells.size();
        to.cells = std::move(cells);
    });
}
/// The same with a cell order of its own.
template <class Table>
void restore_particles(Table& table, MaterialSnapshot<typename Table::Number, Table::d> const& from)
{
    restore_particles(table, from, cell_order_of(table, from));
}

/// Refuses a snapshot whose particles have other fields than those of a `Table`; `where` is the material, and
/// `call` what asks for it.
template <class Table>
void require_same_fields(MaterialSnapshot<typename Table::Number, Table::d> const& from,
                         std::string const& where, std::string const& call = "Solver::restore")
{
    using Number = typename Table::Number;
    constexpr int d = Table::d;
    using All = Join<typename Table::PersistentFields, typename Table::DerivedFields>;
    auto const refuse = [&](std::string what) {
        throw Error{std::move(what), call + ", " + where,
                    "Pass what a solver of the same model and transfer has returned."};
    };
    for_each_tag(All{}, [&](auto tag) {
        using Tag = decltype(tag);
        auto const field =
            std::ranges::find(from.fields, std::string(Tag::name), &FieldSnapshot<Number>::name);
        if (field == from.fields.end())
            refuse("the field '" + std::string(Tag::name) + "' is missing");
        else if (field->components.size() != static_cast<std::size_t>(component_count<Tag>(d)))
            refuse("the field '" + field->name + "' has " + std::to_string(field->components.size()) +
                   " components instead of " + std::to_string(component_count<Tag>(d)));
        else
            for (auto const& component : field->components)
                for (Number const value : component)
                    require_valid<Tag>(
                        value, [&] { return call + ", " + where; },
                        "Pass what a solver of the same model and transfer has returned.");
    });
    for (auto field = from.fields.begin(); field != from.fields.end(); ++field) {
        bool known = false;
        for_each_tag(All{}, [&](auto tag) { known = known || field->name == decltype(tag)::name; });
        if (!known) refuse("the particles of this solver have no field '" + field->name + "'");
        if (std::any_of(from.fields.begin(), field, [&](auto const& f) { return f.name == field->name; }))
            refuse("there are two fields '" + field->name + "'");
    }
}

} // namespace firn
