// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/error.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/periods.hpp>
#include <firn/particles/derived_cache.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/rebin_over_ranks.hpp>
#include <firn/particles/row_ids.hpp>
#include <firn/particles/storage.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firn
{

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
/// commits the step. Beside it only what add_particles.hpp, remove_particles.hpp, readback.hpp (set_columns)
/// and table_snapshot.hpp do with contents() changes the stored values. Gathered fields have storage here
/// only while they are cached (see cache_grid_fields).
///
/// Particles are numbered by *rows*, from 0 on, in the order of their permanent ids: values are returned row
/// by row. Rows are ids until a particle is removed, or one of another material is added between.
template <class BackendType, class Space, class PersistentSet, class DerivedSet>
class ParticleTable
{
public:
    using Backend = BackendType;
    using PersistentFields = PersistentSet;
    using DerivedFields = DerivedSet;
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Buffer = PersistentStorage<Backend, Space, PersistentFields>;
    using View = typename Buffer::View;
    using ConstView = typename Buffer::ConstView;
    using Derived = DerivedStorage<Backend, Space, DerivedFields>;
    using DerivedView = typename Derived::View;
    using ConstDerivedView = typename Derived::ConstView;
    using CellOrder = typename Backend::template CellOrder<Number, d>;

    using Offset = typename View::Offset;
    static constexpr std::size_t state_bytes =
        d * sizeof(Offset) + PersistentFields::components(d) * sizeof(Number) + sizeof(std::uint32_t);
    static constexpr std::size_t resident_bytes = 2 * state_bytes + CellOrder::bytes_per_item;

    /// All that a table holds.
    struct Contents
    {
        Contents(Backend const& backend, Periods<d> const& periods)
            : buffer{Buffer(backend), Buffer(backend)}, gathered(backend), mass_groups(backend),
              cells(backend, periods)
        {}

        /// Resizes for `count` particles here, and keeps the existing ones. The next buffer has no contents
        /// between steps: while the current one grows its memory is free for that (see make_next()).
        void resize_buffers(Backend const& backend, std::size_t count)
        {
            if (!buffer[0].has_room(count)) buffer[1] = Buffer(backend);
            buffer[0].resize(count, places);
        }

        std::size_t size = 0;   ///< rows: particles, on all ranks
        std::size_t places = 0; ///< particles here
        RowIds ids;
        std::array<Buffer, 2> buffer; ///< the current one, and the next
        DerivedCache<Backend, Space, DerivedFields> gathered;
        MassGroupList<Backend, Number> mass_groups;
        CellOrder cells;
    };

    ParticleTable(Lattice lattice, int kernel_degree, Backend const& backend)
        : lattice_(lattice), kernel_degree_(kernel_degree), backend_(backend),
          contents_(backend, periods_of<d>(lattice))
    {}

    Lattice const& lattice() const { return lattice_; }
    int kernel_degree() const { return kernel_degree_; }
    Backend const& backend() const { return backend_; }

    /// How many particles there are, and so rows; and how many of them lie here. On one rank all of them do.
    std::size_t size() const { return contents_.size; }
    std::size_t places() const { return contents_.places; }
    CellOrder const& cells() const { return contents_.cells; }
    CellOrder& cells() { return contents_.cells; }
    MassGroups<Number> mass_groups() const { return contents_.mass_groups.there(); }
    View current() { return contents_.buffer[0].view(); }
    ConstView current() const { return contents_.buffer[0].view(); }
    View next() { return contents_.buffer[1].view(); } ///< after make_next()
    /// Makes room for the next buffer, before steps begin: as much as the current one has.
    void make_next() { contents_.buffer[1].resize_like(contents_.buffer[0]); }
    /// The buffer that the cell order refers to: after a step the one before it, until the next sort().
    ConstView ordered() const { return contents_.buffer[state_ == TableState::moved ? 1 : 0].view(); }

    /// The permanent id of a row; the ids of all, in rising order.
    std::uint32_t id(std::size_t row) const { return contents_.ids.id(row); }
    std::vector<std::uint32_t> ids() const { return contents_.ids.first(size()); }
    IdMark id_mark() const { return contents_.ids.mark(size()); }
    /// The row of an existing id.
    std::uint32_t row(std::uint32_t id) const { return contents_.ids.row(id); }

    /// Whether the gathered fields are cached here; always, if there are none.
    bool has_grid_fields() const
    {
        return DerivedFields::components(d) == 0 || contents_.gathered.is_cached();
    }
    ConstDerivedView derived() const { return contents_.gathered.view(); }
    /// Where they are written before they count as cached: from cache_grid_fields() on, or from the next
    /// swap() on.
    DerivedView place_for_derived() { return contents_.gathered.place(size()); }
    DerivedView next_derived() { return contents_.gathered.next_place(size()); }
    void cache_grid_fields() { contents_.gathered.accept(); }
    /// Sets whether they are cached after some steps, and were `before`; frees storage that is unused.
    void set_cached(bool now, bool before) { contents_.gathered.keep(now, before); }
    Derived& cached() { return contents_.gathered.values(); } ///< if has_grid_fields()
    Derived new_derived() const { return Derived(backend_, size()); }

    /// For what adds, removes, replaces or reads back particles.
    Contents& contents() { return contents_; }
    Contents const& contents() const { return contents_; }
    /// Changes the contents by `work`, after which the cell order refers to the current buffer.
    template <class Work>
    void change(Work const& work)
    {
        forget_packed();
        change_by(work);
    }
    /// Called where stored values change while particles have yet to be sorted: values that have been packed
    /// for other ranks are old.
    void forget_packed()
    {
        if constexpr (requires { contents_.cells.forget_packed(); }) contents_.cells.forget_packed();
    }
    /// Whether change() or sort() broke off after changing existing particles, too.
    bool is_half_changed() const { return state_ == TableState::changing; }

    /// Brings the cell order up to date with positions that have moved.
    void sort()
    {
        sort([](CellOrder& cells, auto const& offsets) { cells.rebin(offsets); });
        finish_sort();
    }
    /// The same for a step that moves all particles. Until then they may lie anywhere in their arrays, unless
    /// finish_sort() is called.
    void begin_sort()
    {
        sort([](CellOrder& cells, auto const& offsets) { cells.begin_rebin(offsets); });
    }
    void finish_sort()
    {
        if constexpr (spans_ranks<Backend>) detail::fill_holes_of_ranks(contents_);
    }

    /// The same, where `rebin(cells, offsets)` does the work.
    template <class Rebin>
    void sort(Rebin const& rebin)
    {
        if (state_ != TableState::moved) return;
        change_by([&] {
            if constexpr (spans_ranks<Backend>)
                detail::rebin_over_ranks(contents_, backend_);
            else
                rebin(contents_.cells, current().offset);
        });
        require(contents_.cells.size() == places(), "particles were lost while they were sorted into cells",
                "ParticleTable::sort", "This is a mistake in the library: please report the scene.");
    }

    /// Makes the next buffer the current one; the gathered fields, too, if the step wrote them.
    void swap(bool wrote_derived)
    {
        contents_.buffer[0].swap(contents_.buffer[1]);
        contents_.gathered.swap(wrote_derived);
        contents_.cells.commit();
        state_ = TableState::moved;
    }

    /// Undoes `commits` calls of swap() and `rebins` calls of sort(), for steps that were then not taken: as
    /// many of both, or one sort() more.
    void rollback(int commits, int rebins, bool wrote_derived) requires Backend::queues
    {
        if (rebins == 0) return;
        if (commits % 2 != 0) {
            contents_.buffer[0].swap(contents_.buffer[1]);
            if (wrote_derived) contents_.gathered.swap_back();
        }
        bool const moved = rebins > commits;
        state_ = moved ? TableState::moved : TableState::sorted;
        contents_.cells.rollback(commits, rebins, current().offset);
    }

    /// Bytes held, spare capacity included.
    std::size_t memory() const
    {
        auto const& [current, next] = contents_.buffer;
        return current.memory() + next.memory() + cells().memory() + contents_.gathered.memory();
    }

private:
    template <class Work>
    void change_by(Work const& work)
    {
        state_ = TableState::changing; // a failure leaves it so
        work();
        state_ = TableState::sorted;
    }

    Lattice lattice_;
    int kernel_degree_;
    Backend backend_;
    TableState state_ = TableState::sorted;
    Contents contents_;
};

} // namespace firn
