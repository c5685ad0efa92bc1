// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/particles/storage.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

// Reads particles back, or shows them where they lie. `Table` is a ParticleTable; values are by row.
namespace firn
{

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

/// The fields of all particles, one column per component, in memory of the host and in the buffer's order.
template <class Table>
using ColumnsOf =
    std::array<std::vector<typename Table::Number>, Table::PersistentFields::components(Table::d)>;

namespace detail
{
template <class Table>
ColumnsOf<Table> columns_of(Table const& table)
{
    ColumnsOf<Table> columns;
    auto const& components = table.contents().buffer[0].component;
    std::transform(components.begin(), components.end(), columns.begin(), [&](auto const& array) {
        auto column = downloaded(array);
        column.resize(table.places());
        return column;
    });
    return columns;
}

template <class Table>
auto offsets_of(Table const& table)
{
    std::array<std::vector<typename Table::Offset>, std::size_t(Table::d)> offset;
    for (std::size_t a = 0; a < offset.size(); ++a)
        offset[a] = downloaded(table.contents().buffer[0].offset[a]);
    return offset;
}

/// The rows of the particles that lie here, by place.
template <class Table>
std::vector<std::uint32_t> rows_of(Table const& table)
{
    auto rows = downloaded(table.contents().buffer[0].id);
    rows.resize(table.places()); // there may be room for more, where adding some was refused
    return rows;
}

/// Calls `use(row, record, place)` for a copy of every particle in the columns; `row` are their rows.
template <class Table, class Use>
void for_each_record(Table const&, std::vector<std::uint32_t> const& row, ColumnsOf<Table> const& columns,
                     Use const& use)
{
    for (std::size_t i = 0; i < row.size(); ++i) {
        Record<typename Table::Number, Table::d, typename Table::PersistentFields> record;
        record.for_each([&](int c, auto& value) { value = columns[std::size_t(c)][i]; });
        use(row[i], record, i);
    }
}

/// Calls `visit(row, position)` for every particle that lies here.
template <class Table, class Visit>
void for_each_position(Table const& table, Visit const& visit)
{
    constexpr int d = Table::d;
    auto const row = rows_of(table);
    auto const offset = offsets_of(table);
    table.cells().for_each([&](std::size_t particle, Coordinates<d> const& cell) {
        Vector<double, d> in_cell;
        for (int a = 0; a < d; ++a)
            in_cell[a] = CellOffset<typename Table::Number>::exact(offset[std::size_t(a)][particle]);
        visit(row[particle], world_position<d>(table.lattice(), table.kernel_degree(), cell, in_cell));
    });
}
} // namespace detail

/// Calls `visit(row, record)` for a copy of every particle's stored fields.
template <class Table, class Visit>
void for_each_particle(Table const& table, Visit const& visit)
{
    auto columns = detail::columns_of(table);
    for (auto& column : columns) column = detail::of_all_ranks(table.backend(), std::move(column));
    detail::for_each_record(table, detail::of_all_ranks(table.backend(), detail::rows_of(table)), columns,
                            [&](std::uint32_t row, auto& record, std::size_t) { visit(row, record); });
}

/// The stored fields of the particles that lie here after `change(row, record)` on a copy of each.
template <class Table, class Change>
ColumnsOf<Table> changed_columns(Table const& table, Change const& change)
{
    ColumnsOf<Table> columns = detail::columns_of(table);
    detail::for_each_record(
        table, detail::rows_of(table), columns, [&](std::uint32_t row, auto& record, std::size_t i) {
            change(row, record);
            record.for_each([&](int c, auto const& value) { columns[std::size_t(c)][i] = value; });
        });
    return columns;
}
/// Stores such columns.
template <class Table>
void set_columns(Table& table, ColumnsOf<Table> const& columns)
{
    table.forget_packed();
    for (std::size_t c = 0; c < columns.size(); ++c)
        table.contents().buffer[0].component[c].upload(0, columns[c]);
}

/// World positions [m].
template <class Table>
std::vector<Vector<double, Table::d>> positions_of(Table const& table,
                                                   detail::Rows wanted = detail::Rows::all)
{
    std::vector<Vector<double, Table::d>> by_row(table.size());
    detail::for_each_position(table, [&](std::uint32_t row, auto const& x) { by_row[row] = x; });
    detail::share_rows(table.backend(), detail::rows_of(table), by_row, wanted);
    return by_row;
}

/// The position [m] of one particle, for error messages.
template <class Table>
Vector<double, Table::d> position_of(Table const& table, std::uint32_t row)
{
    constexpr int d = Table::d;
    Vector<double, d> found =
        make_vector<double, d>([](int) { return std::numeric_limits<double>::quiet_NaN(); });
    detail::for_each_position(table, [&](std::uint32_t other, Vector<double, d> const& x) {
        if (other == row) found = x;
    });
    if constexpr (spans_ranks<typename Table::Backend>)
        for (auto const& x : detail::of_all_ranks(table.backend(), std::vector{found}))
            if (all_finite(x)) found = x;
    return found;
}

/// The cell of one particle, for error messages; all ranks know it.
template <class Table>
Coordinates<Table::d> cell_of(Table const& table, std::uint32_t row)
{
    auto const rows = detail::downloaded(table.contents().buffer[0].id);
    std::vector<Coordinates<Table::d>> found;
    table.cells().for_each([&](std::size_t place, Coordinates<Table::d> const& cell) {
        if (rows[place] == row) found.push_back(cell);
    });
    found = detail::of_all_ranks(table.backend(), std::move(found));
    return found.empty() ? zeros<Coordinates<Table::d>>() : found.front();
}

/// Masses [kg]; `mass_unit` is that of the scene [kg].
template <class Table>
std::vector<double> masses_of(Table const& table, double mass_unit)
{
    auto const here = table.contents().mass_groups.here();
    std::vector<double> by_row(table.size());
    for (std::size_t row = 0; row < by_row.size(); ++row)
        by_row[row] = mass_unit * here.of[here.index(static_cast<std::uint32_t>(row))].mass;
    return by_row;
}

/// Volumes at rest [m^3]; `mass_unit` is that of the scene [kg].
template <class Table>
std::vector<double> volumes_of(Table const& table, double mass_unit)
{
    auto const here = table.contents().mass_groups.here();
    std::vector<double> by_row(table.size());
    for (std::size_t row = 0; row < by_row.size(); ++row)
        by_row[row] = mass_unit * here.of[here.index(static_cast<std::uint32_t>(row))].volume;
    return by_row;
}

/// A stored field in memory of the host.
template <class Tag, class Table>
auto download_field(Table const& table, detail::Rows wanted)
{
    using Number = typename Table::Number;
    constexpr int d = Table::d;
    constexpr int first = Table::PersistentFields::template first_component<Tag>(d);
    std::vector<FieldValue<Tag, Number, d>> by_row(table.size(), value_at_rest<Tag, Number, d>());
    auto const& buffer = table.contents().buffer[0];
    auto const row = detail::rows_of(table);
    for (int c = 0; c < component_count<Tag>(d); ++c) {
        auto const column = detail::downloaded(buffer.component[std::size_t(first + c)]);
        for (std::size_t i = 0; i < row.size(); ++i) component_of<Tag, d>(by_row[row[i]], c) = column[i];
    }
    detail::share_rows(table.backend(), row, by_row, wanted);
    return by_row;
}

namespace detail
{
/// A stored field of the particles that lie here, in the backend's memory.
template <class Tag, class Table>
auto view_here(Table const& table)
{
    constexpr int d = Table::d;
    auto const& buffer = table.contents().buffer[0];
    FieldView<typename Table::Number, component_count<Tag>(d)> field{
        .component = {}, .row = buffer.id.data(), .count = table.places()};
    constexpr int first = Table::PersistentFields::template first_component<Tag>(d);
    for (int c = 0; c < component_count<Tag>(d); ++c)
        field.component[std::size_t(c)] = buffer.component[std::size_t(first + c)].data();
    return field;
}
} // namespace detail

/// Copies numbers of some particles between a list and memory by row: called for every place in the list.
template <class Number, bool to_list>
struct CopyByRow
{
    std::uint32_t const* row;
    Number *by_row, *list;
    std::size_t stride, components; ///< component c of place i: by_row[row[i] * stride + c]

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        for (std::size_t c = 0; c < components; ++c) {
            Number& at_row = by_row[row[place] * stride + c];
            Number& in_list = list[place * components + c];
            if constexpr (to_list)
                in_list = at_row;
            else
                at_row = in_list;
        }
    }
};

/// Completes memory by row to which each rank has written the values of the particles that lie on it.
template <class Table, class Number = typename Table::Number>
void write_rows_of_other_ranks([[maybe_unused]] Table const& table, [[maybe_unused]] Number* to,
                               [[maybe_unused]] std::size_t stride, [[maybe_unused]] std::size_t components)
{
    if constexpr (spans_ranks<typename Table::Backend>) {
        auto const& backend = table.backend();
        typename Table::Backend::template Array<Number> own(backend);
        own.resize(table.places() * components);
        backend.for_each(table.places(), CopyByRow<Number, true>{table.contents().buffer[0].id.data(), to,
                                                                 own.data(), stride, components});
        auto const rows = detail::of_all_ranks(backend, detail::rows_of(table));
        auto const values = detail::of_all_ranks(backend, detail::downloaded(own));
        auto const rows_there = detail::array_of(backend, rows);
        auto values_there = detail::array_of(backend, values);
        backend.for_each(rows.size(), CopyByRow<Number, false>{rows_there.data(), to, values_there.data(),
                                                               stride, components});
    }
}

/// The function object that writes a stored field; see Solver::write.
template <class Tag, class Table>
auto field_writer(Table const& table, typename Table::Number* to, std::size_t stride)
{
    auto const field = detail::view_here<Tag>(table);
    return WriteField<typename Table::Number, component_count<Tag>(Table::d)>{field.component, field.row, to,
                                                                              stride};
}
/// The same for a field that is gathered from the grid.
template <class Tag, class Backend, class Space, class Set>
auto field_writer(DerivedStorage<Backend, Space, Set> const& fields, typename Space::Scalar* to,
                  std::size_t stride)
{
    constexpr int d = Space::dimension, first = Set::template first_component<Tag>(d);
    WriteField<typename Space::Scalar, component_count<Tag>(d)> write{{}, nullptr, to, stride};
    for (int c = 0; c < component_count<Tag>(d); ++c)
        write.component[std::size_t(c)] = fields.column(first + c).data();
    return write;
}

/// The function object that writes world positions; see Solver::write_positions.
template <class Table>
auto position_writer(Table const& table, typename Table::Number* to, std::size_t stride)
{
    return WritePositions<typename Table::Number, Table::d, typename Table::PersistentFields>{
        table.current(), table.lattice(), table.kernel_degree(), to, stride};
}

/// Appends the particles' current cells to a list, one per particle.
template <class Table>
void append_cells(Table const& table, std::vector<Coordinates<Table::d>>& list)
{
    auto offset = detail::offsets_of(table);
    table.cells().for_each([&](std::size_t particle, Coordinates<Table::d> cell) {
        for (int a = 0; a < Table::d; ++a)
            cell[a] += CellOffset<typename Table::Number>::wrap(offset[std::size_t(a)][particle]);
        list.push_back(cell);
    });
}

/// The cells of the particles of all materials, one per particle; `sets` are MaterialSets.
template <class Sets>
std::vector<Coordinates<Sets::d>> cells_of(Sets const& sets)
{
    std::vector<Coordinates<Sets::d>> cells;
    Sets::for_each([&](auto k) { append_cells(sets.template particles<k>(), cells); });
    return detail::of_all_ranks(sets.template particles<0>().backend(), std::move(cells));
}

} // namespace firn
