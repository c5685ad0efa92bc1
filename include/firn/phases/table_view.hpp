// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/core/fields.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

namespace firn
{

/// Where the table of particles lies: positions as offsets from the centres of their cells, one array per
/// component of each field, and the permanent ids.
template <class Number, int d, class Set>
struct TableView
{
    static constexpr int components = Set::components(d);

    using Offset = typename CellOffset<Number>::Stored;

    std::array<Offset*, d> offset;
    std::array<Number*, components> component;
    std::uint32_t* id;

    /// Reads the offsets from the centres of their cells of the cell's current lane of particles, in cells.
    template <class Cell>
    FIRN_HOST_DEVICE Vector<typename Cell::Real, d> position(Cell const& cell) const
    {
        Vector<typename Cell::Real, d> position;
        for (int a = 0; a < d; ++a)
            position[a] = cell.map(
                [&](std::size_t particle) { return CellOffset<Number>::value(offset[a][particle]); });
        return position;
    }

    /// Writes the offsets in `before` plus a displacement [cells], each component within [-1, 1].
    template <class Cell>
    FIRN_HOST_DEVICE void move(Cell const& cell, TableView const& before,
                               Vector<typename Cell::Real, d> const& displacement) const
    {
        for (int a = 0; a < d; ++a)
            cell.update(before.offset[a], offset[a], displacement[a], CellOffset<Number>::moved);
    }

    /// Reads the record of the cell's current lane of particles.
    template <class Cell>
    FIRN_HOST_DEVICE Record<typename Cell::Real, d, Set> load(Cell const& cell) const
    {
        Record<typename Cell::Real, d, Set> record;
        record.for_each([&](int c, auto& value) { value = cell.load(component[c]); });
        mirror(record, Set{});
        return record;
    }

    /// Reads some of the fields.
    template <class Cell, class... Tags>
    FIRN_HOST_DEVICE Record<typename Cell::Real, d, Fields<Tags...>> load(Cell const& cell,
                                                                          Fields<Tags...> wanted) const
    {
        Record<typename Cell::Real, d, Fields<Tags...>> record;
        (for_each_component<Tags, d>(record[Tags{}],
                                     [&](int c, auto& value) {
                                         value =
                                             cell.load(component[Set::template first_component<Tags>(d) + c]);
                                     }),
         ...);
        mirror(record, wanted);
        return record;
    }

    /// Writes the record of the cell's current lane of particles.
    template <class Cell>
    FIRN_HOST_DEVICE void store(Cell& cell, Record<typename Cell::Real, d, Set>& record) const
    {
        record.for_each([&](int c, auto& value) { cell.store(component[c], value); });
    }

private:
    /// Fills the lower triangles of symmetric fields, of which the table holds the upper ones.
    template <class Values, class... Tags>
    FIRN_HOST_DEVICE static void mirror(Values& record, Fields<Tags...>)
    {
        (mirror_one<Tags>(record), ...);
    }

    template <class Tag, class Values>
    FIRN_HOST_DEVICE static void mirror_one(Values& record)
    {
        if constexpr (Tag::shape == FieldShape::symmetric)
            for (int i = 0; i < d; ++i)
                for (int j = 0; j < i; ++j) record[Tag{}](i, j) = record[Tag{}](j, i);
    }
};

/// The particles added by one call: ids from `first_id` on have this mass and volume.
template <class Number>
struct Portion
{
    std::uint32_t first_id;
    Number mass;   ///< in units of the scene's mass unit
    Number volume; ///< V0 [m^3] per mass unit [kg]
};

/// Mass and volume of every particle: one value per portion, found by the particle's id, so that none is
/// stored.
template <class Number>
struct Portions
{
    Portion<Number> const* of;
    int count;

    /// The lanes' masses and volumes: both zero in idle lanes.
    template <class Cell>
    FIRN_HOST_DEVICE auto find(Cell const& cell, std::uint32_t const* id) const
    {
        using Real = typename Cell::Real;
        struct Found
        {
            Real mass, volume;
        };
        Found found{Real(of[0].mass), Real(of[0].volume)};
        if (count > 1) {
            found.mass = cell.map([&](std::size_t particle) { return of[index(id[particle])].mass; });
            found.volume = cell.map([&](std::size_t particle) { return of[index(id[particle])].volume; });
        }
        found.mass = select(cell.here(), found.mass, Real(0));
        found.volume = select(cell.here(), found.volume, Real(0));
        return found;
    }

    FIRN_HOST_DEVICE int index(std::uint32_t id) const
    {
        int low = 0, high = count; // of[low].first_id <= id < of[high].first_id
        while (high - low > 1) {
            int const middle = (low + high) / 2;
            (of[middle].first_id <= id ? low : high) = middle;
        }
        return low;
    }
};

} // namespace firn
