// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/step_error.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/storage.hpp>
#include <firn/particles/table_snapshot.hpp>
#include <firn/state/restore.hpp>
#include <firn/state/snapshot.hpp>
#include <firn/state/world_state.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

// How the particles of worlds come back to a state, and which states are refused. `Table` is a ParticleTable.
namespace firn
{

namespace detail
{
/// Refuses a state of which other ranks have another one.
template <class Backend, class Number, int d>
void require_same_state([[maybe_unused]] Backend const& backend, [[maybe_unused]] char const* where,
                        [[maybe_unused]] WorldState<Number, d> const& state)
{
    if constexpr (spans_ranks<Backend>) {
        std::vector<double> const numbers{state.time, state.masses.unit, state.bounds.speed,
                                          state.bounds.wave_speed, state.bounds.deformation_rate};
        std::vector<std::uint64_t> hashes{hash_of(numbers)};
        for (auto material : state.materials) {
            for_each_list(material, [&](auto const& list) { hashes.push_back(hash_of(list)); });
            for (auto const& group : material.mass_groups)
                hashes.push_back(hash_of(std::vector<Number>{group.mass, group.volume}) + group.first_row);
        }
        require_same_values(backend, where, "state", hashes);
    }
}

/// Refuses the state of a world of other materials, kernels or cells than those of a SceneState, and one that
/// no world can have.
template <class Scene, class Number, int d>
void require_state_fits(WorldState<Number, d> const& state, Scene const& scene, WorldLayout<d> const& layout)
{
    using Sets = typename Scene::Sets;
    char const* const where = "Worlds::reset";
    auto const same = [&](bool condition, std::string const& what) {
        if (!condition) throw Error{what, where, "Pass what save() of worlds of the same kind has returned."};
    };
    same(exactly_equal(state.cell_size, scene.lattice.cell_size) &&
             exactly_equal(state.origin, scene.lattice.origin) &&
             state.kernel_degree == Scene::Kernel::degree,
         "the state is of cells of another size, place or kernel");
    StepBounds const& bounds = state.bounds;
    same(is_finite(state.time) && bounds.material >= 0 && std::size_t(bounds.material) < Sets::count &&
             is_finite(bounds.wave_speed) && is_finite(bounds.speed) && is_finite(bounds.deformation_rate),
         "the state's time, or what bounds the next step, is out of range");
    same(state.materials.size() == Sets::count, "the state has another number of materials");
    same(is_finite(state.masses.unit) &&
             (state.masses.unit > 0 ||
              std::ranges::all_of(state.materials, [](auto const& of) { return of.ids.empty(); })),
         "the state's unit of masses is out of range");
    Sets::for_each([&](auto k) {
        MaterialSnapshot<Number, d> ours;
        name_material<k>(scene.sets, ours);
        auto const& theirs = state.materials[k];
        std::string const material = "material " + std::to_string(k);
        same(theirs.name == ours.name,
             material + " of the state is '" + theirs.name + "', not '" + ours.name + "'");
        std::string const owner = "for " + material + " (" + ours.name + ")";
        char const* const remedy = "Pass what save() of worlds with the same parameters has returned.";
        if (!exactly_equal(theirs.density, ours.density))
            refuse_snapshot(owner + " the density [kg/m^3]", theirs.density, ours.density, remedy, where);
        compare_parameters<Number>(owner, theirs.parameters, ours.parameters, remedy, where);
        require_same_fields<typename Sets::template MaterialTraits<k>::Table>(theirs, material, where);
        require_whole(theirs, state.masses, static_cast<std::uint32_t>(theirs.ids.size()),
                      layout.half_world - WorldLayout<d>::margin, where);
        auto ranks = theirs.ids;
        std::sort(ranks.begin(), ranks.end());
        same(std::adjacent_find(ranks.begin(), ranks.end()) == ranks.end(),
             material + " of the state has two particles of one rank");
    });
}

/// Listed mass groups, to be looked up by row.
template <class Number>
MassGroups<Number> grouped(std::vector<MassGroup<Number>> const& list)
{
    return {list.data(), static_cast<int>(list.size())};
}

/// The particles of a world that come back from the quarantine: their ids in rising order, and the ranks that
/// these have in the world then.
struct Returning
{
    std::uint32_t world;
    std::vector<std::uint32_t> ids, ranks;
};

/// Those of a material that a world needs to have as many as `wanted`, where it has the ids in `present`:
/// what it lost last. Fewer, if it has not lost so many.
FIRN_COLD inline Returning returning_to(std::uint32_t world, std::size_t material,
                                        std::vector<std::uint32_t> const& present, std::size_t wanted,
                                        std::vector<StepFailure> const& isolated)
{
    Returning coming{world, {}, {}};
    auto& ids = coming.ids;
    for (auto lost = isolated.rbegin(); lost != isolated.rend() && present.size() + ids.size() < wanted;
         ++lost)
        if (lost->world == world && lost->material == material) ids.push_back(lost->particle);
    std::sort(ids.begin(), ids.end());
    for (std::size_t i = 0; i < ids.size(); ++i) {
        auto const before = std::ranges::lower_bound(present, ids[i]) - present.begin();
        coming.ranks.push_back(static_cast<std::uint32_t>(before) + static_cast<std::uint32_t>(i));
    }
    return coming;
}

/// Refuses a state of other particles of a material than a world has, whose rows are `rows`, together with
/// those that come back to it. `scale` has the scene's masses.
template <std::size_t k, class Scene, class Number, int d>
void require_same_particles(WorldState<Number, d> const& state, Scene const& scene, MassScale const& scale,
                            std::vector<std::uint32_t> const& rows, Returning const& coming)
{
    auto const& theirs = state.materials[k];
    auto const refuse = [&](std::string const& what) {
        throw Error{
            "world " + std::to_string(coming.world) + what, "Worlds::reset",
            "Reset worlds that have the particles of the state. What remove_if() took does not come back: "
            "clear() the world, add() its particles, and reset it then."};
    };
    auto const of_material = " of material " + std::to_string(k);
    if (rows.size() + coming.ids.size() != theirs.ids.size())
        refuse(" has " + std::to_string(rows.size()) + " particles" + of_material +
               (coming.ids.empty() ? "" : " and " + std::to_string(coming.ids.size()) + " in quarantine") +
               ", and the state has " + std::to_string(theirs.ids.size()));
    if (theirs.ids.empty()) return;
    auto const in_kg = [](double unit, Number mass) { return unit * double(mass); };
    auto const alike = [&](Number a, Number b) { // in kg, to some roundings
        double const theirs_in_kg = in_kg(state.masses.unit, b);
        return std::abs(in_kg(scale.unit, a) - theirs_in_kg) <=
               8 * double(std::numeric_limits<Number>::epsilon()) * theirs_in_kg;
    };
    bool same = true;
    if (!rows.empty()) {
        auto of_state = theirs.mass_groups;
        if (!coming.ids.empty()) {
            std::vector<std::uint32_t> all(theirs.ids.size()), present;
            std::iota(all.begin(), all.end(), std::uint32_t(0));
            std::ranges::set_difference(all, coming.ranks, std::back_inserter(present));
            of_state = groups_of_rows(grouped(theirs.mass_groups), present);
        }
        auto const ours =
            groups_of_rows(scene.sets.template particles<k>().contents().mass_groups.here(), rows);
        same = std::equal(
            ours.begin(), ours.end(), of_state.begin(), of_state.end(), [&](auto const& a, auto const& b) {
                return a.first_row == b.first_row && alike(a.mass, b.mass) && alike(a.volume, b.volume);
            });
    }
    if (!coming.ids.empty())
        for (auto const& group : theirs.mass_groups)
            same = same && scale.bears<Number>(in_kg(state.masses.unit, group.mass) / scale.unit);
    if (!same) refuse("'s particles" + of_material + " have other masses or volumes");
}

/// The mass groups of a table's particles, by row, after others have come that a state has: their masses are
/// those in the state, times `to_unit`. `scale` takes these in.
template <class Table>
auto groups_with(Table const& table, std::vector<Returning> const& coming,
                 MaterialSnapshot<typename Table::Number, Table::d> const& from, double to_unit,
                 MassScale& scale)
{
    using Number = typename Table::Number;
    std::vector<std::pair<std::uint32_t, MassGroup<Number>>> by_id;
    auto const ours = table.contents().mass_groups.here();
    for (std::uint32_t row = 0; row < table.size(); ++row)
        by_id.emplace_back(table.id(row), ours.of[ours.index(row)]);
    auto const theirs = grouped(from.mass_groups);
    for (auto const& of_world : coming)
        for (std::size_t i = 0; i < of_world.ids.size(); ++i) {
            auto group = theirs.of[theirs.index(of_world.ranks[i])];
            group.mass = static_cast<Number>(to_unit * double(group.mass));
            group.volume = static_cast<Number>(to_unit * double(group.volume));
            scale.admit(group.mass);
            by_id.emplace_back(of_world.ids[i], group);
        }
    std::ranges::sort(by_id, {}, [](auto const& of) { return of.first; });
    std::vector<MassGroup<Number>> all;
    std::vector<std::uint32_t> rows(by_id.size());
    std::iota(rows.begin(), rows.end(), std::uint32_t(0));
    for (auto const& of : by_id) all.push_back(of.second);
    for (std::size_t row = 0; row < all.size(); ++row) all[row].first_row = static_cast<std::uint32_t>(row);
    return groups_of_rows(grouped(all), rows);
}

/// Brings particles of worlds back into a table, as they are in a state of one world: see groups_with. All
/// others keep their values, their ids and their order. Requires has_grid_fields().
template <class Table>
FIRN_COLD void return_particles(Table& table, std::vector<Returning> const& coming,
                                MaterialSnapshot<typename Table::Number, Table::d> const& from,
                                double to_unit, MassScale& scale, WorldLayout<Table::d> const& layout)
{
    if (std::ranges::all_of(coming, [](Returning const& of) { return of.ids.empty(); })) return;
    auto all = snapshot_of(table);
    all.mass_groups = groups_with(table, coming, from, to_unit, scale);
    std::vector<std::size_t> at_rank(from.ids.size());
    for (std::size_t i = 0; i < from.ids.size(); ++i) at_rank[from.ids[i]] = i;
    for (auto const& of_world : coming)
        for (std::size_t n = 0; n < of_world.ids.size(); ++n) {
            std::size_t const i = at_rank[of_world.ranks[n]];
            all.ids.push_back(of_world.ids[n]);
            all.cells.push_back(from.cells[i] + layout.centre(of_world.world));
            for (std::size_t a = 0; a < all.offsets.size(); ++a) all.offsets[a].push_back(from.offsets[a][i]);
            for (auto& field : all.fields) {
                auto const& same =
                    *std::ranges::find(from.fields, field.name, &std::decay_t<decltype(field)>::name);
                for (std::size_t c = 0; c < field.components.size(); ++c)
                    field.components[c].push_back(same.components[c][i]);
            }
        }
    restore_particles(table, all);
}
} // namespace detail

/// Finds where the particles of some rows lie: called for every place. Those of other ranks lie nowhere.
struct FindRows
{
    static constexpr auto none = std::numeric_limits<std::uint32_t>::max();

    std::uint32_t const* row_at;      ///< by place
    std::uint32_t const* rank_of_row; ///< in the list of these rows, or none
    unsigned char* is_listed;         ///< 1 or 0, by place
    std::uint32_t *place_of_rank, *new_place;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        auto const rank = rank_of_row[row_at[place]], here = static_cast<std::uint32_t>(place);
        is_listed[place] = rank == none ? 0 : 1;
        if (rank != none) place_of_rank[rank] = here;
        new_place[place] = here;
    }
};

/// Brings the particles of some worlds into the state `from` that those of one world had: each of these
/// worlds gets the same. `rows_of` are the rows of their particles, in rising order. The particles keep their
/// ids; all others keep all their values, and their order. Requires has_grid_fields(), and in each world as
/// many particles as in the state. The host's work is proportional to what is reset.
template <class Table>
void reset_particles(Table& table, std::vector<std::uint32_t> const& worlds,
                     std::vector<std::vector<std::uint32_t> const*> const& rows_of,
                     MaterialSnapshot<typename Table::Number, Table::d> const& from,
                     WorldLayout<Table::d> const& layout)
{
    constexpr int d = Table::d;
    using Number = typename Table::Number;
    using PersistentFields = typename Table::PersistentFields;
    using DerivedFields = typename Table::DerivedFields;
    std::size_t const count = from.ids.size(), all = count * worlds.size(), places = table.places();
    if (all == 0) return;
    using Backend = typename Table::Backend;
    Backend const& backend = table.backend();
    std::vector<std::uint32_t> rows, ranks(all);
    std::vector<Coordinates<d>> cells;
    rows.reserve(all);
    cells.reserve(all);
    for (std::size_t w = 0; w < worlds.size(); ++w) {
        Coordinates<d> const centre = layout.centre(worlds[w]);
        for (std::size_t i = 0; i < count; ++i) {
            rows.push_back((*rows_of[w])[from.ids[i]]);
            cells.push_back(from.cells[i] + centre);
        }
    }
    std::iota(ranks.begin(), ranks.end(), std::uint32_t(0));

    // What goes lies anywhere here, and on other ranks; what comes lies where its cells are.
    std::vector<std::uint32_t> own;
    if constexpr (spans_ranks<Backend>) own = table.cells().own(cells);
    auto const here = [&](auto const& values) -> decltype(auto) {
        return detail::values_here<Backend>(values, own);
    };

    using Indices = typename Backend::template Array<std::uint32_t>;
    auto const rows_there = detail::array_of(backend, rows), ranks_there = detail::array_of(backend, ranks);
    Indices rank_of_row(backend), place_of_rank(backend), new_place(backend);
    typename Backend::template Array<unsigned char> goes(backend);
    rank_of_row.resize(table.size());
    place_of_rank.resize(all);
    new_place.resize(places);
    goes.resize(places);
    rank_of_row.fill(0, table.size(), FindRows::none);
    place_of_rank.fill(0, all, FindRows::none);
    backend.for_each(all,
                     PutValues<std::uint32_t>{ranks_there.data(), rows_there.data(), rank_of_row.data()});
    backend.for_each(places, FindRows{table.contents().buffer[0].id.data(), rank_of_row.data(), goes.data(),
                                      place_of_rank.data(), new_place.data()});
    // What comes will lie at the end, so what lies there and stays moves into the places of what goes.
    auto to_place = detail::downloaded(place_of_rank);
    std::erase_if(to_place, [](std::uint32_t place) { return place == FindRows::none; });
    std::size_t const leaving = to_place.size(), kept = places - leaving;
    std::erase_if(to_place, [&](std::uint32_t place) { return place >= kept; });
    std::sort(to_place.begin(), to_place.end());
    std::vector<std::uint32_t> from_place;
    std::vector<unsigned char> last(leaving);
    goes.download(kept, last);
    for (std::size_t i = 0; i < leaving; ++i)
        if (last[i] == 0) from_place.push_back(static_cast<std::uint32_t>(kept + i));
    auto const from_there = detail::array_of(backend, from_place),
               to_there = detail::array_of(backend, to_place);
    std::vector<Coordinates<d>> const& cells_here = here(cells);
    auto const cells_there = detail::array_of(backend, cells_here);
    std::size_t const places_then = kept + cells_here.size();
    if (places_then > places) table.contents().resize_buffers(backend, places_then);
    backend.for_each(from_place.size(),
                     PutValues<std::uint32_t>{to_there.data(), from_there.data(), new_place.data()});

    /// A column of the state, once for each world.
    auto const repeated = [&](auto const& column) {
        auto all_of_them = column;
        all_of_them.reserve(column.size() * worlds.size());
        for (std::size_t w = 1; w < worlds.size(); ++w)
            all_of_them.insert(all_of_them.end(), column.begin(), column.end());
        return all_of_them;
    };
    table.change([&] {
        auto& to = table.contents();
        auto& buffer = to.buffer[0];
        auto const replace = [&](auto& column, auto const& values) {
            using Value = typename std::decay_t<decltype(column)>::Value;
            backend.for_each(from_place.size(),
                             MoveValues<Value>{column.data(), from_there.data(), to_there.data()});
            column.upload(kept, here(values));
        };
        for (std::size_t a = 0; a < from.offsets.size(); ++a)
            replace(buffer.offset[a], repeated(from.offsets[a]));
        replace(buffer.id, rows);
        for_each_tag(PersistentFields{}, [&](auto tag) {
            auto const& field = detail::field_of<decltype(tag)>(from);
            detail::for_each_column<PersistentFields, d>(tag, [&](std::size_t i, std::size_t c) {
                replace(buffer.component[c], repeated(field.components[i]));
            });
        });
        for_each_tag(DerivedFields{}, [&](auto tag) {
            auto const& field = detail::field_of<decltype(tag)>(from);
            detail::for_each_column<DerivedFields, d>(tag, [&](std::size_t i, std::size_t c) {
                auto const values = detail::array_of(backend, repeated(field.components[i]));
                backend.for_each(rows.size(), PutValues<Number>{values.data(), rows_there.data(),
                                                                table.cached().column(int(c)).data()});
            });
        });
        to.cells.erase(goes.data(), new_place.data(), kept);
        to.cells.insert(cells_there.data(), cells_here.size(), static_cast<std::uint32_t>(kept));
        to.places = places_then;
        if (places_then < places) to.resize_buffers(backend, places_then);
    });
}

} // namespace firn
