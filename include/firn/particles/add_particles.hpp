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
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

// Adds particles. `Table` is a ParticleTable.
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
    require_same_values(table.backend(), "Solver::add", "points", all.points);
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
            detail::require_same_on_ranks(table.backend(), "Solver::add",
                                          detail::text_of(same_velocity.transpose()));
            std::vector<double> of_each;
            for (std::size_t i = 0; i < (volumes.are_listed() ? added : 1); ++i) {
                of_each.push_back(volumes.volume(i));
                of_each.push_back(volumes.density(i, density));
            }
            detail::require_same_values(table.backend(), "Solver::add", "volumes", of_each);
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

} // namespace firn
