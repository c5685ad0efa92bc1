// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/particles/add_remove.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/table_snapshot.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <type_traits>
#include <vector>

// The particles of one of many worlds in memory of the host, and how they come back. `Table` is a
// ParticleTable.
namespace firn
{

/// What the particles of one world are like at one time, in memory of the host: see Worlds.
template <class Number, int d>
struct WorldState
{
    double cell_size = 0;            ///< [m]
    Eigen::Vector3d origin{0, 0, 0}; ///< of the world's cells [m]
    int kernel_degree = 0;           ///< the cells are those of kernels of this degree
    MassScale masses{};              ///< the unit of masses, and their range
    double time = 0;                 ///< of the world [s]
    StepBounds bounds{};             ///< of the next step
    /// The particles, in cell order: cells from the world's own (0, 0, 0), and in place of ids the ranks of
    /// ids, 0, 1, 2, … in the world.
    std::vector<MaterialSnapshot<Number, d>> materials{};
};

namespace detail
{
/// Copies values within an array, each from one place to another.
template <class T>
struct MoveValues
{
    T* values;
    std::uint32_t const *from, *to;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const { values[to[i]] = values[from[i]]; }
};

/// Writes values to the listed places of an array.
template <class T>
struct PutValues
{
    T const* values;
    std::uint32_t const* places;
    T* to;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const { to[places[i]] = values[i]; }
};

/// A vector in the backend's memory.
template <class Backend, class T>
auto array_of(Backend const& backend, std::vector<T> const& values)
{
    typename Backend::template Array<T> there(backend);
    there.resize(std::max<std::size_t>(values.size(), 1)); // so that it has an address
    there.upload(0, values);
    return there;
}

/// The mass groups of some rows, which are listed in rising order, by the rank in the list.
template <class Number>
std::vector<MassGroup<Number>> groups_of_rows(MassGroups<Number> const& all,
                                              std::vector<std::uint32_t> const& rows)
{
    std::vector<MassGroup<Number>> groups;
    for (std::size_t rank = 0; rank < rows.size(); ++rank) {
        MassGroup<Number> group = all.of[all.index(rows[rank])];
        group.first_row = static_cast<std::uint32_t>(rank);
        if (groups.empty() || !exactly_equal(groups.back().mass, group.mass) ||
            !exactly_equal(groups.back().volume, group.volume))
            groups.push_back(group);
    }
    return groups;
}
} // namespace detail

/// Finds the world in which each particle is: called for every particle with its place and its cell.
template <int d>
struct FindWorlds
{
    WorldLayout<d> layout;
    std::uint32_t* found; ///< by place

    FIRN_HOST_DEVICE void operator()(std::size_t place, Coordinates<d> const& cell) const
    {
        found[place] = layout.world_of(cell);
    }
};

/// In which worlds the particles of a table are, and their rows: both by place.
struct ParticlesOfWorlds
{
    std::vector<std::uint32_t> world_at, row_at;

    template <class Table>
    ParticlesOfWorlds(Table const& table, WorldLayout<Table::d> const& layout)
    {
        if (table.size() == 0) return;
        typename Table::Backend::template Array<std::uint32_t> worlds(table.backend());
        worlds.resize(table.size());
        table.backend().for_each_place(table.cells(), FindWorlds<Table::d>{layout, worlds.data()});
        world_at = detail::downloaded(worlds);
        row_at = detail::downloaded(table.contents().buffer[0].id);
        row_at.resize(table.size());
    }

    /// The rows of the particles of each of `count` worlds, in rising order.
    std::vector<std::vector<std::uint32_t>> rows_by_world(std::uint32_t count) const
    {
        std::vector<std::vector<std::uint32_t>> rows(count);
        for (std::size_t place = 0; place < world_at.size(); ++place)
            rows[world_at[place]].push_back(row_at[place]);
        for (auto& of_world : rows) std::sort(of_world.begin(), of_world.end());
        return rows;
    }

    /// Marks the particles of a world.
    template <class Backend>
    RemovalMask<Backend> mask(std::uint32_t world, Backend const& backend) const
    {
        RemovalMask<Backend> mask(backend);
        if (world_at.empty()) return mask;
        mask.here.resize(world_at.size());
        for (std::size_t place = 0; place < world_at.size(); ++place)
            mask.here[place] = world_at[place] == world ? 1 : 0;
        mask.count = static_cast<std::size_t>(std::count(mask.here.begin(), mask.here.end(), 1));
        mask.there.resize(mask.here.size());
        mask.there.upload(0, mask.here);
        return mask;
    }
};

/// The particles of a world; requires has_grid_fields(). The caller adds the model's name.
template <class Table>
auto particles_of_world(Table& table, ParticlesOfWorlds const& all, std::uint32_t world,
                        Coordinates<Table::d> const& centre)
{
    constexpr int d = Table::d;
    using Number = typename Table::Number;
    using PersistentFields = typename Table::PersistentFields;
    using DerivedFields = typename Table::DerivedFields;
    MaterialSnapshot<Number, d> to;
    std::vector<std::uint32_t> places, rows; // in cell order
    table.cells().for_each([&](std::size_t place, Coordinates<d> const& cell) {
        if (all.world_at[place] != world) return;
        places.push_back(static_cast<std::uint32_t>(place));
        rows.push_back(all.row_at[place]);
        to.cells.push_back(cell - centre);
    });
    std::vector<std::uint32_t> rising = rows;
    std::sort(rising.begin(), rising.end());
    for (auto const row : rows)
        to.ids.push_back(static_cast<std::uint32_t>(std::ranges::lower_bound(rising, row) - rising.begin()));

    auto const& contents = table.contents();
    typename Table::Buffer picked(table.backend());
    typename Table::Derived gathered(table.backend(), rows.size());
    if (!rows.empty()) {
        auto const places_there = detail::array_of(table.backend(), places),
                   rows_there = detail::array_of(table.backend(), rows);
        picked.gather(table.backend(), contents.buffer[0], places_there.data(), places.size());
        gathered.gather(table.backend(), table.cached(), rows_there.data());
        to.mass_groups = detail::groups_of_rows(contents.mass_groups.here(), rising);
    }
    for (std::size_t a = 0; a < to.offsets.size(); ++a) to.offsets[a] = detail::downloaded(picked.offset[a]);
    for_each_tag(PersistentFields{}, [&](auto tag) {
        to.fields.push_back({decltype(tag)::name, {}});
        detail::for_each_column<PersistentFields, d>(tag, [&](std::size_t, std::size_t c) {
            to.fields.back().components.push_back(detail::downloaded(picked.component[c]));
        });
    });
    for_each_tag(DerivedFields{}, [&](auto tag) {
        to.fields.push_back({decltype(tag)::name, {}});
        detail::for_each_column<DerivedFields, d>(tag, [&](std::size_t, std::size_t c) {
            to.fields.back().components.push_back(detail::downloaded(gathered.column(int(c))));
        });
    });
    return to;
}

/// Finds where the particles of some rows lie: called for every place.
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
    std::size_t const count = from.ids.size(), all = count * worlds.size(), size = table.size(),
                      kept = size - all;
    if (all == 0) return;
    auto const& backend = table.backend();
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

    using Indices = typename Table::Backend::template Array<std::uint32_t>;
    auto const rows_there = detail::array_of(backend, rows), ranks_there = detail::array_of(backend, ranks);
    Indices rank_of_row(backend), place_of_rank(backend), new_place(backend);
    typename Table::Backend::template Array<unsigned char> goes(backend);
    rank_of_row.resize(size);
    place_of_rank.resize(all);
    new_place.resize(size);
    goes.resize(size);
    rank_of_row.fill(0, size, FindRows::none);
    backend.for_each(
        all, detail::PutValues<std::uint32_t>{ranks_there.data(), rows_there.data(), rank_of_row.data()});
    backend.for_each(size, FindRows{table.contents().buffer[0].id.data(), rank_of_row.data(), goes.data(),
                                    place_of_rank.data(), new_place.data()});
    // What comes will lie at the end, so what lies there and stays moves into the places of what goes.
    std::vector<std::uint32_t> from_place, to_place;
    std::vector<unsigned char> last(all);
    goes.download(kept, last);
    for (std::size_t i = 0; i < all; ++i)
        if (last[i] == 0) from_place.push_back(static_cast<std::uint32_t>(kept + i));
    for (auto const place : detail::downloaded(place_of_rank))
        if (place < kept) to_place.push_back(place);
    std::sort(to_place.begin(), to_place.end());
    auto const from_there = detail::array_of(backend, from_place),
               to_there = detail::array_of(backend, to_place);
    backend.for_each(from_place.size(),
                     detail::PutValues<std::uint32_t>{to_there.data(), from_there.data(), new_place.data()});

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
                             detail::MoveValues<Value>{column.data(), from_there.data(), to_there.data()});
            column.upload(kept, values);
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
                backend.for_each(rows.size(),
                                 detail::PutValues<Number>{values.data(), rows_there.data(),
                                                           table.cached().column(int(c)).data()});
            });
        });
        to.cells.erase(goes.data(), new_place.data(), kept);
        to.cells.insert(cells, static_cast<std::uint32_t>(kept));
    });
}

} // namespace firn
