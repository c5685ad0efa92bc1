// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/place_points.hpp>
#include <firn/particles/row_ids.hpp>
#include <firn/particles/storage.hpp>
#include <firn/particles/volumes.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

// Adds, finds and removes particles. `Table` is a ParticleTable.
namespace firn
{

namespace detail
{
/// The points that lie here, and their rows if those of all points begin with `first_row`.
template <int d>
struct OwnPoints
{
    std::vector<Vector<double, d>> points; ///< [m]
    std::vector<std::uint32_t> rows;
};
template <class Table, class Points>
OwnPoints<Table::d> own_points(Table& table, Points const& points, std::uint32_t first_row,
                               Coordinates<Table::d> const& centre)
{
    constexpr int d = Table::d;
    std::vector<Coordinates<d>> cells;
    OwnPoints<d> all, own;
    RangeOfPoints<d> const range(table);
    for (auto const& point : points) {
        all.points.push_back(point_of<d>(point));
        if (!range.contains(all.points.back())) range.refuse(all.points.size() - 1);
        cells.push_back(locate<d>(table.lattice(), table.kernel_degree(), all.points.back()).cell + centre);
    }
    std::uint64_t hash = 0;
    for (auto const& x : all.points)
        for (int a = 0; a < d; ++a) hash = (hash ^ std::bit_cast<std::uint64_t>(x[a])) * 0x9e3779b97f4a7c15u;
    require_same_on_ranks(table.backend(), "Solver::add", text_of(all.points.size(), "points", hash));
    for (std::uint32_t const i : table.cells().own(cells)) {
        own.points.push_back(all.points[i]);
        own.rows.push_back(first_row + i);
    }
    return own;
}

/// Gives the `count` particles from `place` on a velocity, and otherwise the state of a new particle; on all
/// ranks there are `added` of them.
template <class Table, int d = Table::d, class Number = typename Table::Number>
void set_state(Table& table, std::size_t place, std::size_t count, std::size_t added,
               Vector<Number, d> const& velocity, Record<Number, d, typename Table::PersistentFields> stored)
{
    auto derived = Record<Number, d, typename Table::DerivedFields>::at_rest();
    if constexpr (Table::PersistentFields::template contains<Velocity>)
        stored[Velocity{}] = velocity;
    else
        derived[Velocity{}] = velocity;
    auto& to = table.contents();
    stored.for_each([&](int c, Number const& value) {
        to.buffer[0].component[std::size_t(c)].fill(place, count, value);
    });
    to.gathered.extend(table.size(), table.size() + added, derived);
}
} // namespace detail

/// Adds particles of a model with a velocity, otherwise at rest, whose ids begin with `first_id`; see
/// Solver::add. The points are in the world with this centre. Returns how many.
template <class Table, class Model, class Points>
FIRN_COLD std::size_t add_particles(Table& table, Model const& model, Points const& points,
                                    Volumes const& volumes, Vector<double, Table::d> const& velocity,
                                    std::uint32_t first_id, MassScale& scale,
                                    Coordinates<Table::d> const& centre)
{
    constexpr int d = Table::d;
    using Number = typename Table::Number;
    double const density(model.density);
    std::size_t const added = std::size(points);
    volumes.validate(added, static_cast<Number>(density));
    Vector<Number, d> const same_velocity = vector_of<Number, d>(velocity);
    require(all_finite(same_velocity), "the velocity is not finite", "Solver::add",
            "Pass metres per second, within the range of the scene's numbers.");
    std::size_t const count = table.size() + added;
    require(first_id + added < std::numeric_limits<std::uint32_t>::max(),
            "there would have been more than 4 294 967 294 particles", "Solver::add",
            "Use fewer particles, or several solvers.");
    auto const first = static_cast<std::uint32_t>(table.size());
    if (added == 0) return 0;
    auto& to = table.contents();
    to.mass_groups.require_comparable(volumes, added, density, scale);
    table.sort(); // insert() needs up-to-date cells

    std::size_t const places = table.places();
    auto const place_all = [&](auto const& here) {
        to.resize_buffers(table.backend(), places + std::size(here));
        typename Table::Backend::template Array<Coordinates<d>> cells(table.backend());
        cells.resize(std::size(here));
        detail::place_points(table, here, static_cast<std::uint32_t>(places), centre, cells.data());
        detail::set_state(table, places, std::size(here), added, same_velocity,
                          state_of_new<Record<Number, d, typename Table::PersistentFields>>(model));
        return cells;
    };
    auto const cells = [&] {
        if constexpr (spans_ranks<typename Table::Backend>) {
            detail::require_same_on_ranks(
                table.backend(), "Solver::add",
                detail::text_of(volumes.are_listed(), volumes.volume(0), same_velocity.transpose()));
            auto const own = detail::own_points(table, points, first, centre);
            auto own_cells = place_all(own.points);
            to.buffer[0].id.upload(places, own.rows);
            return own_cells;
        }
        else
            return place_all(points);
    }();
    RowIds ids = to.ids.extended(table.size(), added, first_id);
    table.change([&] {
        to.mass_groups.add(first, added, volumes, density, scale);
        to.cells.insert(cells.data(), cells.size(), static_cast<std::uint32_t>(places));
        to.ids = std::move(ids);
        to.size = count;
        to.places = places + cells.size();
    });
    return added;
}

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

/// Removes the marked particles; since they were marked only sort() and cache_grid_fields() of the table may
/// have been called. The others keep all their values, and their order.
template <class Table, class Backend>
void remove_particles(Table& table, RemovalMask<Backend> const& mask)
{
    if (mask.count == 0) return;
    table.sort();
    auto& to = table.contents();
    std::size_t const size = table.size(), kept = size - mask.count, places = table.places();
    auto const row_at = detail::downloaded(to.buffer[0].id);
    std::vector<std::uint32_t> from, new_place(places), rows, gone;
    for (std::uint32_t place = 0; place < places; ++place) {
        if (mask.here[place]) {
            gone.push_back(row_at[place]);
            continue;
        }
        new_place[place] = static_cast<std::uint32_t>(from.size());
        from.push_back(place);
    }
    std::vector<char> keeps_row(size, 1);
    for (auto const row : detail::of_all_ranks(table.backend(), std::move(gone))) keeps_row[row] = 0;
    std::vector<std::uint32_t> new_row(size);
    for (std::uint32_t row = 0; row < size; ++row) {
        new_row[row] = static_cast<std::uint32_t>(rows.size()); // for a removed row, that of the next
        if (keeps_row[row]) rows.push_back(row);
    }

    auto const from_there = detail::array_of(table.backend(), from),
               rows_there = detail::array_of(table.backend(), rows),
               new_place_there = detail::array_of(table.backend(), new_place);
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

} // namespace firn
