// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/world_layout.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/remove_particles.hpp>
#include <firn/particles/table_snapshot.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numeric>
#include <type_traits>
#include <utility>
#include <vector>

// The particles of one of many worlds in memory of the host. `Table` is a ParticleTable.
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

/// In which worlds the particles of a table are, and their rows: both by place, of those that lie here.
struct ParticlesOfWorlds
{
    std::vector<std::uint32_t> world_at, row_at;

    template <class Table>
    ParticlesOfWorlds(Table const& table, WorldLayout<Table::d> const& layout)
    {
        if (table.places() == 0) return;
        typename Table::Backend::template Array<std::uint32_t> worlds(table.backend());
        worlds.resize(table.places());
        table.backend().for_each_place(table.cells(), FindWorlds<Table::d>{layout, worlds.data()});
        world_at = detail::downloaded(worlds);
        row_at = detail::downloaded(table.contents().buffer[0].id);
        row_at.resize(table.places());
    }

    /// The same of the particles of all ranks, in no order of places.
    template <class Backend>
    ParticlesOfWorlds of_all_ranks(Backend const& backend) &&
    {
        world_at = detail::of_all_ranks(backend, std::move(world_at));
        row_at = detail::of_all_ranks(backend, std::move(row_at));
        return std::move(*this);
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
        mask.here.resize(world_at.size());
        for (std::size_t place = 0; place < world_at.size(); ++place)
            mask.here[place] = world_at[place] == world ? 1 : 0;
        mask.count = detail::sum_of_ranks(
            backend, static_cast<std::size_t>(std::count(mask.here.begin(), mask.here.end(), 1)));
        if (mask.here.empty()) return mask;
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
    MaterialSnapshot<Number, d> to;
    std::vector<std::uint32_t> places, rows; // in cell order
    table.cells().for_each([&](std::size_t place, Coordinates<d> const& cell) {
        if (all.world_at[place] != world) return;
        places.push_back(static_cast<std::uint32_t>(place));
        rows.push_back(all.row_at[place]);
        to.cells.push_back(cell - centre);
    });
    auto rising = detail::of_all_ranks(table.backend(), rows);
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
    }
    if (!rising.empty()) to.mass_groups = detail::groups_of_rows(contents.mass_groups.here(), rising);
    for (std::size_t a = 0; a < to.offsets.size(); ++a) to.offsets[a] = detail::downloaded(picked.offset[a]);
    detail::add_fields<typename Table::PersistentFields>(
        to, [&](std::size_t c) { return detail::downloaded(picked.component[c]); });
    detail::add_fields<typename Table::DerivedFields>(
        to, [&](std::size_t c) { return detail::downloaded(gathered.column(int(c))); });
    if constexpr (spans_ranks<typename Table::Backend>) detail::gather_snapshot(table, to, centre);
    return to;
}

} // namespace firn
