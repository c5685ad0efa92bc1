// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/row_ids.hpp>
#include <firn/particles/storage.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

// Finds and removes particles. `Table` is a ParticleTable.
namespace firn
{

/// The particles of a table that are marked for removal, by place: those that lie here.
template <class Backend>
struct RemovalMask
{
    typename Backend::template Array<unsigned char> there; ///< in the backend's memory
    std::vector<unsigned char> here{};                     ///< the same, on the host
    std::size_t count = 0;                                 ///< marked particles, on all ranks

    explicit RemovalMask(Backend const& backend) : there(backend) {}
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
                fields, [&](int c, Number& value) { value = particles.component[std::size_t(c)][particle]; });
            for_each_component_of<DerivedFields, d>(fields, [&](int c, Number& value) {
                value = velocities.component[std::size_t(c)][velocities.place_of(particles.id[particle])];
            });
            found[particle] = is_wanted(x, fields) ? 1 : 0;
        }
    }
};

/// Marks the particles for which `predicate` is true; see Solver::remove_if. Changes nothing.
template <class Table, class Predicate, class Backend = typename Table::Backend>
RemovalMask<Backend> find_particles(Table const& table, Predicate const& predicate)
{
    RemovalMask<Backend> mask(table.backend());
    if (table.size() == 0) return mask;
    mask.there.resize(table.places());
    table.backend().for_each_place(
        table.cells(), FindParticles<typename Table::Number, Table::d, typename Table::PersistentFields,
                                     typename Table::DerivedFields, Predicate>{
                           table.current(), table.derived(), table.lattice(), table.kernel_degree(),
                           predicate, mask.there.data()});
    mask.here = detail::downloaded(mask.there);
    mask.count = detail::sum_of_ranks(
        table.backend(), static_cast<std::size_t>(std::count(mask.here.begin(), mask.here.end(), 1)));
    return mask;
}

/// Marks the particles of some rows, as find_particles() does.
template <class Table, class Backend = typename Table::Backend>
RemovalMask<Backend> mark_rows(Table const& table, std::vector<std::uint32_t> const& rows)
{
    RemovalMask<Backend> mask(table.backend());
    if (rows.empty()) return mask;
    std::size_t const places = table.places();
    auto const row_at = detail::downloaded(table.contents().buffer[0].id);
    std::vector<unsigned char> goes(table.size(), 0);
    for (auto const row : rows) goes[row] = 1;
    mask.here.resize(places);
    for (std::size_t place = 0; place < places; ++place) mask.here[place] = goes[row_at[place]];
    mask.there.resize(places);
    mask.there.upload(0, mask.here);
    mask.count = rows.size();
    return mask;
}

/// The first marked row, or the table's size if none is.
template <class Table, class Backend>
std::uint32_t first_row(Table const& table, RemovalMask<Backend> const& found)
{
    auto const row = detail::downloaded(table.contents().buffer[0].id);
    auto first = static_cast<std::uint32_t>(table.size());
    for (std::size_t place = 0; place < table.places(); ++place)
        if (found.here[place]) first = std::min(first, row[place]);
    if constexpr (spans_ranks<Backend>)
        first = std::ranges::min(detail::of_all_ranks(table.backend(), std::vector<std::uint32_t>{first}));
    return first;
}

namespace detail
{
/// The rows of the particles that are marked here.
template <class Table, class Backend>
std::vector<std::uint32_t> marked_rows(Table const& table, RemovalMask<Backend> const& mask)
{
    auto const row_at = downloaded(table.contents().buffer[0].id);
    std::vector<std::uint32_t> rows;
    for (std::size_t place = 0; place < mask.here.size(); ++place)
        if (mask.here[place]) rows.push_back(row_at[place]);
    return rows;
}

/// Removes the marked particles of a sorted table, whose rows on all ranks are `gone`.
template <class Table, class Backend>
void remove_marked(Table& table, RemovalMask<Backend> const& mask, std::vector<std::uint32_t> const& gone)
{
    auto& to = table.contents();
    std::size_t const size = table.size(), kept = size - gone.size(), places = table.places();
    auto const row_at = downloaded(to.buffer[0].id);
    std::vector<std::uint32_t> from, new_place(places), rows;
    for (std::uint32_t place = 0; place < places; ++place) {
        if (mask.here[place]) continue;
        new_place[place] = static_cast<std::uint32_t>(from.size());
        from.push_back(place);
    }
    std::vector<char> keeps_row(size, 1);
    for (auto const row : gone) keeps_row[row] = 0;
    std::vector<std::uint32_t> new_row(size);
    for (std::uint32_t row = 0; row < size; ++row) {
        new_row[row] = static_cast<std::uint32_t>(rows.size()); // for a removed row, that of the next
        if (keeps_row[row]) rows.push_back(row);
    }

    auto const from_there = array_of(table.backend(), from), rows_there = array_of(table.backend(), rows),
               new_place_there = array_of(table.backend(), new_place);
    RowIds ids = to.ids.kept(rows);
    auto derived = to.gathered.gathered(rows_there.data(), kept);
    for (auto& place : from) place = new_row[row_at[place]];
    table.change([&] { // from here on a buffer has fewer elements than there are particles
        to.buffer[1].gather(table.backend(), to.buffer[0], from_there.data(), from.size());
        to.buffer[1].id.upload(0, from);
        to.buffer[0].swap(to.buffer[1]);
        to.places = from.size();
        to.resize_buffers(table.backend(), to.places);
        to.gathered.replace(std::move(derived), kept);
        to.cells.erase(mask.there.data(), new_place_there.data(), to.places);
        to.mass_groups.keep(new_row, kept);
        to.ids = std::move(ids);
        to.size = kept;
    });
}
} // namespace detail

/// Removes the marked particles; since they were marked only sort() and cache_grid_fields() of the table may
/// have been called. The others keep all their values, and their order.
template <class Table, class Backend>
void remove_particles(Table& table, RemovalMask<Backend> const& mask)
{
    if (mask.count == 0) return;
    auto const gone = detail::of_all_ranks(table.backend(), detail::marked_rows(table, mask));
    table.sort();
    if constexpr (spans_ranks<Backend>) // sorted particles may lie on another rank
        detail::remove_marked(table, mark_rows(table, gone), gone);
    else
        detail::remove_marked(table, mask, gone);
}

} // namespace firn
