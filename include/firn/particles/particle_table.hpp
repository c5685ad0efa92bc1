// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/particles/derived_cache.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/row_ids.hpp>
#include <firn/particles/storage.hpp>
#include <firn/state/snapshot.hpp>

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// The particles of a table that are marked for removal, by place.
template <class Backend>
struct RemovalMask
{
    typename Backend::template Array<unsigned char> there; ///< in the backend's memory
    std::vector<unsigned char> here{};                     ///< the same, on the host
    std::size_t count = 0;                                 ///< marked particles
};

/// How the cell order of a table stands to its current buffer.
///
///   sorted --swap()--> moved --sort()--> sorted       after each step; rollback() undoes both
///   sorted --change()--> changing --> sorted          particles are added, removed or replaced
///
/// A call that throws while the table is `changing`, as it is during sort(), too, leaves it so.
enum class TableState
{
    sorted,  ///< the cell order refers to the current buffer
    moved,   ///< it refers to the buffer before the step, until the next sort()
    changing ///< both are half changed
};

/// The particles of one material: two buffers of the fields that are stored from step to step, and the order
/// of cells in which they are visited.
///
/// A step reads the current buffer through the cell order and writes the next one in that order; swap()
/// commits the step. Only add(), remove(), restore(), set() and swap() change the table's values. Gathered
/// fields have storage here only while they are cached (see cache_grid_fields).
///
/// Particles are numbered by *rows*, from 0 on, in the order of their permanent ids: values are returned row
/// by row. Rows are ids until a particle is removed, or one of another material is added between.
template <class Backend, class Space, class PersistentFields, class DerivedFields>
class ParticleTable
{
public:
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using View = TableView<Number, d, PersistentFields>;
    using ConstView = TableView<Number const, d, PersistentFields>;
    using Derived = DerivedStorage<Backend, Space, DerivedFields>;
    using DerivedView = typename Derived::View;
    using ConstDerivedView = typename Derived::ConstView;
    using CellOrder = typename Backend::template CellOrder<Number, d>;
    template <class T>
    using Array = typename Backend::template Array<T>;

    using Offset = typename View::Offset;
    static constexpr std::size_t state_bytes =
        d * sizeof(Offset) + PersistentFields::components(d) * sizeof(Number) + sizeof(std::uint32_t);
    static constexpr std::size_t resident_bytes = 2 * state_bytes + CellOrder::bytes_per_item;

    ParticleTable(Lattice lattice, int kernel_degree, Backend const& backend)
        : lattice_(lattice), kernel_degree_(kernel_degree),
          backend_(backend), buffer_{Buffer(backend), Buffer(backend)}, gathered_(backend),
          mass_groups_(backend), cells_(backend)
    {}

    std::size_t size() const { return size_; }
    CellOrder const& cells() const { return cells_; }
    CellOrder& cells() { return cells_; }
    View current() { return buffer_[0].view(); }
    ConstView current() const { return buffer_[0].view(); }
    View next() { return buffer_[1].view(); }
    /// The buffer that the cell order refers to: after a step the one before it, until the next sort().
    ConstView ordered() const { return buffer_[state_ == TableState::moved ? 1 : 0].view(); }

    /// Whether the gathered fields are cached here; always, if there are none.
    bool has_grid_fields() const { return DerivedFields::components(d) == 0 || gathered_.is_cached(); }
    ConstDerivedView derived() const { return gathered_.view(); }
    /// Where they are written before they count as cached: from cache_grid_fields() on, or from the next
    /// swap() on.
    DerivedView place_for_derived() { return gathered_.place(size_); }
    DerivedView next_derived() { return gathered_.next_place(size_); }
    void cache_grid_fields() { gathered_.accept(); }
    /// Sets whether they are cached after some steps, and were `before`; frees storage that is unused.
    void set_cached(bool now, bool before) { gathered_.keep(now, before); }
    Derived& cached() { return gathered_.values(); } ///< if has_grid_fields()
    Derived const& cached() const { return gathered_.values(); }
    Derived new_derived() const { return Derived(backend_, size_); }
    MassGroups<Number> mass_groups() const { return mass_groups_.there(); }

    /// Adds particles with a velocity, otherwise at rest, whose ids begin with `first_id`; see Solver::add.
    /// Returns how many.
    template <class Points>
    FIRN_COLD std::size_t add(Points const& points, double volume, double density,
                              Vector<double, d> const& velocity, std::uint32_t first_id, MassScale& scale)
    {
        std::vector<CellPosition<d>> const located = locate_all(points);
        require(is_finite(volume) && volume > 0, "the volume per point is not a finite number above 0",
                "Solver::add",
                "Pass the volume in m^3 that one particle stands for: the body's volume over the number of "
                "points.");
        Vector<Number, d> const same_velocity = vector_of<Number, d>(velocity);
        require(all_finite(same_velocity), "the velocity is not finite", "Solver::add",
                "Pass metres per second, within the range of the scene's numbers.");
        std::size_t const count = size_ + located.size();
        require(first_id + located.size() < std::numeric_limits<std::uint32_t>::max(),
                "there would have been more than 4 294 967 294 particles", "Solver::add",
                "Use fewer particles, or several solvers.");
        auto const first = static_cast<std::uint32_t>(size_);
        if (located.empty()) return 0;
        mass_groups_.require_comparable(volume, density, scale);
        sort(); // insert() needs up-to-date cells

        resize_buffers(count);
        gathered_.resize(count);
        place(located, first, same_velocity);
        std::vector<Coordinates<d>> cells(located.size());
        for (std::size_t i = 0; i < located.size(); ++i) cells[i] = located[i].cell;
        RowIds ids = ids_.extended(size_, located.size(), first_id);
        change([&] {
            mass_groups_.add(first, volume, density, scale);
            cells_.insert(cells, first);
            ids_ = std::move(ids);
            size_ = count;
        });
        return located.size();
    }

    /// Whether add(), remove() or sort() broke off after changing existing particles, too.
    bool is_half_changed() const { return state_ == TableState::changing; }

    /// Marks the particles for which `predicate` is true; see Solver::remove_if. Changes nothing.
    template <class Predicate>
    RemovalMask<Backend> find(Predicate const& predicate) const
    {
        RemovalMask<Backend> mask{.there = Array<unsigned char>(backend_)};
        if (size_ == 0) return mask;
        mask.there.resize(size_);
        backend_.for_each_place(cells_, FindParticles<Number, d, PersistentFields, DerivedFields, Predicate>{
                                            buffer_[0].view(), derived(), lattice_, kernel_degree_, predicate,
                                            mask.there.data()});
        mask.here = detail::downloaded(mask.there);
        mask.count = static_cast<std::size_t>(std::count(mask.here.begin(), mask.here.end(), 1));
        return mask;
    }

    /// Marks the particles of some rows, as find() does.
    RemovalMask<Backend> removal_mask(std::vector<std::uint32_t> const& rows) const
    {
        RemovalMask<Backend> mask{.there = Array<unsigned char>(backend_)};
        if (rows.empty()) return mask;
        auto const row_at = detail::downloaded(buffer_[0].id);
        std::vector<unsigned char> goes(size_, 0);
        for (auto const row : rows) goes[row] = 1;
        mask.here.resize(size_);
        for (std::size_t place = 0; place < size_; ++place) mask.here[place] = goes[row_at[place]];
        mask.there.resize(size_);
        mask.there.upload(0, mask.here);
        mask.count = rows.size();
        return mask;
    }

    /// The first marked row, or size() if none is.
    std::uint32_t first_row(RemovalMask<Backend> const& found) const
    {
        auto const row = detail::downloaded(buffer_[0].id);
        auto first = static_cast<std::uint32_t>(size_);
        for (std::size_t place = 0; place < size_; ++place)
            if (found.here[place]) first = std::min(first, row[place]);
        return first;
    }

    /// Removes the marked particles; since find() only sort() and cache_grid_fields() may have been called.
    /// The others keep all their values, and their order.
    void remove(RemovalMask<Backend> const& mask)
    {
        if (mask.count == 0) return;
        sort();
        std::size_t const kept = size_ - mask.count;
        auto const row_at = detail::downloaded(buffer_[0].id);
        std::vector<std::uint32_t> from, new_place(size_), rows;
        std::vector<char> keeps_row(size_, 0);
        for (std::uint32_t place = 0; place < size_; ++place) {
            if (mask.here[place]) continue;
            keeps_row[row_at[place]] = 1;
            new_place[place] = static_cast<std::uint32_t>(from.size());
            from.push_back(place);
        }
        std::vector<std::uint32_t> new_row(size_);
        for (std::uint32_t row = 0; row < size_; ++row) {
            new_row[row] = static_cast<std::uint32_t>(rows.size()); // for a removed row, that of the next
            if (keeps_row[row]) rows.push_back(row);
        }

        auto const on_backend = [&](std::vector<std::uint32_t> const& list) {
            Array<std::uint32_t> there(backend_);
            there.resize(list.size());
            there.upload(0, list);
            return there;
        };
        Array<std::uint32_t> const from_there = on_backend(from), rows_there = on_backend(rows),
                                   new_place_there = on_backend(new_place);
        std::optional<Derived> derived = gathered_.gathered(rows_there.data(), kept);
        buffer_[1].gather(backend_, buffer_[0], from_there.data(), kept);
        for (auto& place : from) place = new_row[row_at[place]];
        buffer_[1].id.upload(0, from);

        RowIds ids = ids_.kept(rows);
        change([&] {
            buffer_[0].swap(buffer_[1]);
            resize_buffers(kept);
            gathered_.replace(std::move(derived));
            cells_.erase(mask.there.data(), new_place_there.data(), kept);
            mass_groups_.keep(new_row, kept);
            ids_ = std::move(ids);
            size_ = kept;
        });
    }

    /// All particles, in memory of the host; requires has_grid_fields(). The caller adds the model's name and
    /// stiffness.
    MaterialSnapshot<Number, d> snapshot()
    {
        sort();
        MaterialSnapshot<Number, d> to;
        std::vector<std::size_t> places; // in cell order
        cells_.for_each([&](std::size_t place, Coordinates<d> const& cell) {
            places.push_back(place);
            to.cells.push_back(cell);
        });
        for (std::size_t a = 0; a < to.offsets.size(); ++a)
            to.offsets[a] = listed(buffer_[0].offset[a], places);
        std::vector<std::uint32_t> const rows = listed(buffer_[0].id, places);
        for (std::uint32_t const row : rows) to.ids.push_back(id(row));
        for_each_tag(PersistentFields{}, [&](auto tag) {
            to.fields.push_back({decltype(tag)::name, {}});
            for_each_column<PersistentFields>(tag, [&](int, int c) {
                auto const& column = buffer_[0].component[static_cast<std::size_t>(c)];
                to.fields.back().components.push_back(listed(column, places));
            });
        });
        for_each_tag(DerivedFields{}, [&](auto tag) {
            to.fields.push_back({decltype(tag)::name, {}});
            for_each_column<DerivedFields>(tag, [&](int, int c) {
                to.fields.back().components.push_back(listed(cached().column(int(c)), rows));
            });
        });
        to.mass_groups = mass_groups_.all();
        return to;
    }

    /// Replaces the particles by those of a snapshot from a table of the same fields, in the snapshot's
    /// order.
    void restore(MaterialSnapshot<Number, d> const& from) { restore(from, order_of(from)); }

    /// The cell order of a snapshot's particles, built afresh. If as many particles are in the table already,
    /// this alone allocates memory for a restore.
    CellOrder order_of(MaterialSnapshot<Number, d> const& from) const
    {
        CellOrder cells(backend_);
        if (!from.ids.empty()) cells.insert(from.cells, 0);
        return cells;
    }

    /// The same with a cell order from order_of().
    void restore(MaterialSnapshot<Number, d> const& from, CellOrder cells)
    {
        std::size_t const count = from.ids.size();
        std::vector<std::uint32_t> at_row(count), rows(count);
        std::iota(at_row.begin(), at_row.end(), std::uint32_t(0));
        std::sort(at_row.begin(), at_row.end(),
                  [&](auto const& a, auto const& b) { return from.ids[a] < from.ids[b]; });
        for (std::size_t row = 0; row < count; ++row) rows[at_row[row]] = static_cast<std::uint32_t>(row);

        change([&] {
            resize_buffers(count);
            gathered_.resize(count);
            for (std::size_t a = 0; a < from.offsets.size(); ++a)
                buffer_[0].offset[a].upload(0, from.offsets[a]);
            buffer_[0].id.upload(0, rows);
            for_each_tag(PersistentFields{}, [&](auto tag) {
                auto const& field = field_of<decltype(tag)>(from);
                for_each_column<PersistentFields>(tag, [&](std::size_t i, std::size_t c) {
                    buffer_[0].component[c].upload(0, field.components[i]);
                });
            });
            for_each_tag(DerivedFields{}, [&](auto tag) {
                auto const& field = field_of<decltype(tag)>(from);
                for_each_column<DerivedFields>(tag, [&](std::size_t i, int c) {
                    cached().column(c).upload(0, listed(field.components[i], at_row));
                });
            });
            ids_ = RowIds(listed(from.ids, at_row));
            mass_groups_.set(from.mass_groups);
            size_ = count;
            cells_ = std::move(cells);
        });
    }

    /// Refuses a snapshot whose particles have other fields; `where` is the material.
    static void require_same_fields(MaterialSnapshot<Number, d> const& from, std::string const& where)
    {
        using All = Join<PersistentFields, DerivedFields>;
        auto const refuse = [&](std::string what) {
            throw Error{std::move(what), "Solver::restore, " + where,
                        "Restore into a solver of the same model and transfer."};
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
                            value, [&] { return "Solver::restore, " + where; },
                            "Restore what Solver::snapshot has returned.");
        });
        for (auto field = from.fields.begin(); field != from.fields.end(); ++field) {
            bool known = false;
            for_each_tag(All{}, [&](auto tag) { known = known || field->name == decltype(tag)::name; });
            if (!known) refuse("the particles of this solver have no field '" + field->name + "'");
            if (std::any_of(from.fields.begin(), field, [&](auto const& f) { return f.name == field->name; }))
                refuse("there are two fields '" + field->name + "'");
        }
    }

    /// The permanent id of a row; the ids of all, in rising order.
    std::uint32_t id(std::size_t row) const { return ids_.id(row); }
    /// The row of an existing id.
    std::uint32_t row(std::uint32_t id) const { return ids_.row(id); }
    std::vector<std::uint32_t> ids() const { return ids_.first(size_); }

    /// Brings the cell order up to date with positions that have moved.
    void sort()
    {
        sort([](CellOrder& cells, auto const& offsets) { cells.rebin(offsets); });
    }

    /// The same, where `rebin(cells, offsets)` does the work.
    template <class Rebin>
    void sort(Rebin const& rebin)
    {
        if (state_ != TableState::moved) return;
        change([&] { rebin(cells_, current().offset); });
        require(cells_.size() == size_, "particles were lost while they were sorted into cells",
                "ParticleTable::sort", "This is a mistake in the library: please report the scene.");
    }

    /// Makes the next buffer the current one; the gathered fields, too, if the step wrote them.
    void swap(bool wrote_derived)
    {
        buffer_[0].swap(buffer_[1]);
        gathered_.swap(wrote_derived);
        cells_.commit();
        state_ = TableState::moved;
    }

    /// Undoes the last calls of swap() and sort() for steps that were then not taken: as many of both, or one
    /// sort() more.
    void rollback(int accepted, int sorted, bool wrote_derived) requires Backend::queues
    {
        if (sorted == 0) return;
        if (accepted % 2 != 0) {
            buffer_[0].swap(buffer_[1]);
            if (wrote_derived) gathered_.swap_back();
        }
        bool const moved = sorted > accepted;
        state_ = moved ? TableState::moved : TableState::sorted;
        cells_.rollback(sorted, moved, current().offset);
    }

    /// The fields of all particles, one column per component, in memory of the host.
    using Columns = std::array<std::vector<Number>, PersistentFields::components(d)>;

    /// The fields of all particles after `change(row, record)` on a copy of each.
    template <class Change>
    Columns changed(Change const& change) const
    {
        Columns component = columns();
        auto const row = detail::downloaded(buffer_[0].id);
        for (std::size_t i = 0; i < size_; ++i) {
            Record<Number, d, PersistentFields> record;
            record.for_each([&](int c, Number& value) { value = component[std::size_t(c)][i]; });
            change(row[i], record);
            record.for_each([&](int c, Number const& value) { component[std::size_t(c)][i] = value; });
        }
        return component;
    }
    /// Stores such columns.
    void set(Columns const& component)
    {
        for (std::size_t c = 0; c < component.size(); ++c) buffer_[0].component[c].upload(0, component[c]);
    }

    /// Calls `visit(row, record)` for a copy of every particle.
    template <class Visit>
    void for_each(Visit const& visit) const
    {
        auto const component = columns();
        auto const row = detail::downloaded(buffer_[0].id);
        for (std::size_t i = 0; i < size_; ++i) {
            Record<Number, d, PersistentFields> record;
            record.for_each([&](int c, Number& value) { value = component[std::size_t(c)][i]; });
            visit(row[i], record);
        }
    }

    std::vector<Vector<double, d>> positions() const
    {
        std::vector<Vector<double, d>> by_row(size_);
        for_each_position([&](std::uint32_t row, Vector<double, d> const& x) { by_row[row] = x; });
        return by_row;
    }

    /// The function object that writes world positions by row; see Solver::write_positions.
    WritePositions<Number, d, PersistentFields> position_writer(Number* to, std::size_t stride) const
    {
        return {buffer_[0].view(), lattice_, kernel_degree_, to, stride};
    }

    /// The function object that writes a stored field by row; see Solver::write.
    template <class Tag>
    WriteField<Number, component_count<Tag>(d)> writer(Number* to, std::size_t stride) const
    {
        auto const field = view<Tag>();
        return {field.component, field.row, to, stride};
    }

    /// A stored field in the backend's memory.
    template <class Tag>
    FieldView<Number, component_count<Tag>(d)> view() const
    {
        FieldView<Number, component_count<Tag>(d)> field{
            .component = {}, .row = buffer_[0].id.data(), .count = size_};
        constexpr int first = PersistentFields::template first_component<Tag>(d);
        for (int c = 0; c < component_count<Tag>(d); ++c)
            field.component[std::size_t(c)] = buffer_[0].component[std::size_t(first + c)].data();
        return field;
    }

    template <class Tag>
    std::vector<FieldValue<Tag, Number, d>> download() const
    {
        constexpr int first = PersistentFields::template first_component<Tag>(d);
        std::vector<FieldValue<Tag, Number, d>> by_row(size_, value_at_rest<Tag, Number, d>());
        auto const row = detail::downloaded(buffer_[0].id);
        for (int c = 0; c < component_count<Tag>(d); ++c) {
            auto const column = detail::downloaded(buffer_[0].component[std::size_t(first + c)]);
            for (std::size_t i = 0; i < size_; ++i) component_of<Tag, d>(by_row[row[i]], c) = column[i];
        }
        return by_row;
    }

    /// Masses [kg], by row; `mass_unit` is that of the scene [kg].
    std::vector<double> masses(double mass_unit) const
    {
        MassGroups<Number> const here = mass_groups_.here();
        std::vector<double> by_row(size_);
        for (std::size_t row = 0; row < size_; ++row)
            by_row[row] = mass_unit * here.of[here.index(static_cast<std::uint32_t>(row))].mass;
        return by_row;
    }

    /// Appends the particles' current cells to a list, one per particle.
    void add_cells(std::vector<Coordinates<d>>& list) const
    {
        std::array<std::vector<Offset>, std::size_t(d)> offset;
        for (int a = 0; a < d; ++a)
            offset[std::size_t(a)] = detail::downloaded(buffer_[0].offset[std::size_t(a)]);
        cells_.for_each([&](std::size_t particle, Coordinates<d> cell) {
            for (int a = 0; a < d; ++a) cell[a] += CellOffset<Number>::wrap(offset[std::size_t(a)][particle]);
            list.push_back(cell);
        });
    }

    /// The position of one particle, for error messages.
    Vector<double, d> position(std::uint32_t row) const
    {
        Vector<double, d> found =
            make_vector<double, d>([](int) { return std::numeric_limits<double>::quiet_NaN(); });
        for_each_position([&](std::uint32_t other, Vector<double, d> const& x) {
            if (other == row) found = x;
        });
        return found;
    }

    /// Bytes held, spare capacity included.
    std::size_t memory() const
    {
        return buffer_[0].memory() + buffer_[1].memory() + cells_.memory() + gathered_.memory();
    }

private:
    using Buffer = PersistentStorage<Backend, Space, PersistentFields>;

    /// Changes the table by `work`, after which the cell order refers to the current buffer.
    template <class Work>
    void change(Work const& work)
    {
        state_ = TableState::changing; // a failure leaves it so
        work();
        state_ = TableState::sorted;
    }

    /// Resizes for `count` particles, and keeps the existing ones; the other buffer needs no contents.
    void resize_buffers(std::size_t count)
    {
        buffer_[0].resize(count, size_);
        buffer_[1].resize(count, 0);
    }

    /// Writes new particles behind the existing ones: with a velocity, otherwise at rest.
    void place(std::vector<CellPosition<d>> const& located, std::uint32_t first,
               Vector<Number, d> const& velocity)
    {
        Buffer& buffer = buffer_[0];
        auto* const columns = buffer.component.data();
        std::size_t const count = located.size();
        std::vector<Offset> offsets(count);
        for (int a = 0; a < d; ++a) {
            for (std::size_t i = 0; i < count; ++i)
                offsets[i] = CellOffset<Number>::from(located[i].offset[a]);
            buffer.offset[std::size_t(a)].upload(first, offsets);
        }
        std::vector<std::uint32_t> ids(count);
        std::iota(ids.begin(), ids.end(), first);
        buffer.id.upload(first, ids);
        auto stored = Record<Number, d, PersistentFields>::at_rest();
        auto derived = Record<Number, d, DerivedFields>::at_rest();
        if constexpr (PersistentFields::template contains<Velocity>)
            stored[Velocity{}] = velocity;
        else
            derived[Velocity{}] = velocity;
        stored.for_each([&](int c, Number const& value) { columns[c].fill(first, count, value); });
        cached().fill(first, derived);
    }

    Columns columns() const
    {
        Columns columns;
        for (int c = 0; c < int(columns.size()); ++c)
            columns[std::size_t(c)] = detail::downloaded(buffer_[0].component[std::size_t(c)]);
        return columns;
    }

    /// Calls `visit(row, position)` for every particle.
    template <class Visit>
    void for_each_position(Visit const& visit) const
    {
        auto const row = detail::downloaded(buffer_[0].id);
        std::array<std::vector<Offset>, std::size_t(d)> offset;
        for (int a = 0; a < d; ++a)
            offset[std::size_t(a)] = detail::downloaded(buffer_[0].offset[std::size_t(a)]);
        cells_.for_each([&](std::size_t particle, Coordinates<d> const& cell) {
            Vector<double, d> in_cell;
            for (int a = 0; a < d; ++a)
                in_cell[a] = CellOffset<Number>::exact(offset[std::size_t(a)][particle]);
            visit(row[particle], world_position<d>(lattice_, kernel_degree_, cell, in_cell));
        });
    }

    template <class Points>
    std::vector<CellPosition<d>> locate_all(Points const& points) const
    {
        std::vector<CellPosition<d>> located;
        located.reserve(std::size(points));
        for (auto const& point : points) {
            Vector<double, d> const x = vector_of<double, d>(point);
            bool is_near = true; // false for NaN, too
            for (int a = 0; a < d; ++a)
                is_near =
                    is_near && is_finite(x[a]) &&
                    std::abs(x[a] - lattice_.origin[a]) / lattice_.cell_size < CellOrder::largest_coordinate;
            if (!is_near)
                throw Error{"point " + std::to_string(located.size()) +
                                " is not finite or too far from the lattice's origin",
                            "Solver::add",
                            "Pass finite positions in metres, within " +
                                std::to_string(static_cast<long>(CellOrder::largest_coordinate)) +
                                " cells of the origin: use a larger cell or move the lattice's origin."};
            located.push_back(locate<d>(lattice_, kernel_degree_, x));
        }
        return located;
    }

    /// The listed elements of an array.
    template <class Values, class Place>
    static auto listed(Values const& from, std::vector<Place> const& places)
    {
        auto const pick = [&](auto const& values) {
            std::vector<typename std::decay_t<decltype(values)>::value_type> picked(places.size());
            for (std::size_t i = 0; i < places.size(); ++i) picked[i] = values[places[i]];
            return picked;
        };
        if constexpr (requires { from.begin(); })
            return pick(from);
        else
            return pick(detail::downloaded(from));
    }

    /// Calls `use(component, column)` for the components of a field, counted in the field and in the set.
    template <class Set, class Tag, class Use>
    static void for_each_column(Tag, Use const& use)
    {
        constexpr int first = Set::template first_component<Tag>(d);
        for (int c = 0; c < component_count<Tag>(d); ++c) use(std::size_t(c), std::size_t(first + c));
    }

    template <class Tag>
    static FieldSnapshot<Number> const& field_of(MaterialSnapshot<Number, d> const& from)
    {
        return *std::ranges::find(from.fields, std::string(Tag::name), &FieldSnapshot<Number>::name);
    }

    Lattice lattice_;
    int kernel_degree_;
    Backend backend_;
    std::size_t size_ = 0;
    TableState state_ = TableState::sorted;
    RowIds ids_;
    std::array<Buffer, 2> buffer_; ///< the current one, and the next
    DerivedCache<Backend, Space, DerivedFields> gathered_;
    MassGroupList<Backend, Number> mass_groups_;
    CellOrder cells_;
};

} // namespace firn
