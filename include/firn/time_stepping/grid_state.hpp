// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/chain.hpp>
#include <firn/grid/periods.hpp>
#include <firn/particles/readback.hpp>
#include <firn/phases/extend_velocities.hpp>
#include <firn/phases/gather.hpp>
#include <firn/phases/particles_to_grid.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/phases/update_bodies.hpp>
#include <firn/phases/update_grid.hpp>
#include <firn/transfer/integrators.hpp>

#include <cstddef>
#include <optional>
#include <type_traits>

namespace firn
{

/// The grid of a scene, what its particles have scattered to it, and the fields they gather from it between
/// steps. `sets` are the MaterialSets of the scene, the same in every call.
template <class Backend, class Sets, class Kernel, class Transfer>
class GridState
{
public:
    using Space = typename Sets::Space;
    using Number = typename Space::Scalar;
    static constexpr int d = Space::dimension;
    using Grid =
        typename Backend::template Grid<Number, d, Kernel::degree, NodeSums<d, SumsOf<Transfer>>::channels,
                                        NodeValues<d, ValuesOf<Transfer>>::template channels<Kernel>,
                                        static_cast<int>(Sets::count), Sets::are_bodies,
                                        values_of_solve<Transfer, Kernel, d>>;
    template <std::size_t k>
    using MaterialTraits = typename Sets::template MaterialTraits<k>;
    /// The scatter phase of a material.
    template <std::size_t k>
    using P2g = ParticlesToGrid<Space, typename MaterialTraits<k>::Model, Kernel, Transfer,
                                typename MaterialTraits<k>::Stored, typename MaterialTraits<k>::Derived>;

    GridState(Lattice lattice, Transfer const& transfer, Backend const& backend)
        : lattice_(lattice), transfer_(transfer), backend_(backend), grid_(backend_, periods_of<d>(lattice))
    {}

    /// Takes what another one has listed, of which this one may be in need again.
    void take_lists([[maybe_unused]] GridState& before)
    {
        if constexpr (requires { grid_.images().take(before.grid_.images()); })
            grid_.images().take(before.grid_.images());
    }

    Grid& grid() { return grid_; }
    Grid const& grid() const { return grid_; }

    /// The time for which stresses act in the step that particles have scattered to the grid for [s]; 0:
    /// nothing has been scattered.
    double scattered_dt() const { return scattered_dt_; }
    /// After particles have changed: they must scatter afresh.
    void forget() { scattered_dt_ = 0; }
    /// After steps: the time of stresses [s] for which particles have scattered to the next one, and whether
    /// those that changed cells since (the leavers) have, too.
    void set_scattered(double dt, bool leavers_scattered)
    {
        scattered_dt_ = dt;
        leavers_scattered_ = leavers_scattered;
    }

    /// Completes the sums on the grid for a step in which stresses act for this long [s]; particles may have
    /// scattered already, and for another time.
    void scatter_missing(double dt, Sets& sets)
    {
        Sets::for_each([&](auto k) {
            if (exactly_equal(scattered_dt_, 0))
                scatter<k>(dt, false, sets);
            else {
                auto layer = grid_.layer(k);
                if (!leavers_scattered_)
                    backend_.template scatter_leavers<P2g<k>>(sets.template particles<k>().cells(), layer);
                if constexpr (!StepsImplicitly<Transfer>) // whose particles scatter no impulse of stress
                    if (!exactly_equal(scattered_dt_, dt)) scatter<k>(dt - scattered_dt_, true, sets);
            }
        });
        leavers_scattered_ = true;
        scattered_dt_ = dt;
    }

    /// Extends nodal velocities before the grid update, where the transfer does so. The scattered velocities
    /// use the buffer of the next step's sums; the second swap restores this step's sums.
    void extend_velocities([[maybe_unused]] Sets& sets, [[maybe_unused]] Number smallest_node_mass)
    {
        if constexpr (ExtendsVelocities<Transfer>) {
            auto const on_nodes = [&](bool first) {
                backend_.for_each_node(sets.orders(), grid_,
                                       ExtendVelocities<Space>{smallest_node_mass, first});
            };
            on_nodes(true);
            for (int pass = 0; pass < transfer_.passes(); ++pass) {
                Sets::for_each([&](auto k) {
                    auto& table = sets.template particles<k>();
                    auto layer = grid_.layer(k);
                    backend_.for_each_cell(
                        table.cells(), layer,
                        ReturnVelocities<Space, Kernel, typename MaterialTraits<k>::Stored>{
                            table.current(), table.mass_groups()});
                });
                grid_.swap();
                on_nodes(false);
                grid_.swap();
            }
        }
    }

    /// Gathers the fields that are not stored, exactly as in the last step.
    template <std::size_t k>
    FIRN_COLD void regather(Sets const& sets,
                            typename MaterialTraits<k>::Table::DerivedView const& derived) const
    {
        if constexpr (MaterialTraits<k>::Derived::components(d) > 0) {
            auto const& table = sets.template particles<k>();
            auto const layer = const_cast<Grid&>(grid_).layer(k); // only read
            backend_.for_each_cell(
                table.cells(), layer,
                GatherVelocities<Space, Kernel, Transfer, typename MaterialTraits<k>::Stored,
                                 typename MaterialTraits<k>::Derived>{
                    {}, transfer_, table.ordered(), derived, static_cast<Number>(lattice_.cell_size)});
        }
    }

    /// Caches these fields beside the particles, before their source changes.
    void cache_grid_fields(Sets& sets) const
    {
        Sets::for_each([&](auto k) {
            auto& table = sets.template particles<k>();
            if (table.has_grid_fields()) return;
            regather<k>(sets, table.place_for_derived());
            table.cache_grid_fields();
        });
    }

    /// A field of a material's particles, by row: stored, cached or regathered. Out of line, because it is
    /// much code for seldom called functions.
    template <class Tag, std::size_t k>
    [[gnu::noinline]] std::vector<FieldValue<Tag, Number, d>> download(Sets const& sets,
                                                                       detail::Rows wanted) const
    {
        auto const& table = sets.template particles<k>();
        if constexpr (MaterialTraits<k>::Stored::template contains<Tag>)
            return download_field<Tag>(table, wanted);
        else {
            std::optional<DerivedOf<k>> again;
            auto by_row = derived<k>(sets, again).template by_row<Tag>(table.size());
            detail::share_rows(table.backend(), detail::rows_of(table), by_row, wanted);
            return by_row;
        }
    }

    /// Writes a field to memory that the backend's loops reach; see Solver::write.
    template <class Tag, std::size_t k>
    void write(Sets const& sets, Number* to, std::size_t stride) const
    {
        auto const& table = sets.template particles<k>();
        auto const write_by = [&](std::size_t count, auto const& fields) {
            backend_.for_each(count, field_writer<Tag>(fields, to, stride));
        };
        if constexpr (MaterialTraits<k>::Stored::template contains<Tag>)
            write_by(table.places(), table);
        else {
            std::optional<DerivedOf<k>> again;
            write_by(table.size(), derived<k>(sets, again));
        }
    }

    /// After a failed step: the grid no longer has the velocities that particles gathered, but still the sums
    /// they scattered. Regathers from these, without the forces of the failed step.
    void regain_velocities(Sets& sets, Number smallest_node_mass)
    {
        using Now = StepContext<Number, Chain<>>;
        typename Backend::template ReadbackBuffer<Now> now(backend_);
        now.resize(1);
        backend_.for_each(1, ClearContext<Now>{now.data()});
        Sets::for_each([&](auto k) { scatter<k>(-scattered_dt_, true, sets); });
        scattered_dt_ = 0;
        extend_velocities(sets, smallest_node_mass);
        auto const phase = grid_update<Chain<>>(sets, now.data(), smallest_node_mass, 1, false);
        backend_.for_each_node(sets.orders(), grid_, phase);
        if constexpr (spans_ranks<Backend>) backend_.for_each_other_node(sets.orders(), grid_, phase);
        cache_grid_fields(sets);
    }

    /// The phase that updates the nodes. `mass_unit` is that of the scene's masses [kg]; `bodies_touch` says
    /// whether bodies act on each other.
    template <class Actions>
    auto grid_update(Sets const& sets, StepContext<Number, Actions> const* now, Number smallest_node_mass,
                     double mass_unit, [[maybe_unused]] bool bodies_touch) const
    {
        UpdateGrid<Space, Kernel, Transfer, Actions> const update{
            {carried_by(transfer_)},       now, lattice_, smallest_node_mass, flip_fraction(),
            static_cast<Number>(mass_unit)};
        if constexpr (Sets::are_bodies) {
            auto const densities = sets.densities();
            std::array<Number, Sets::count> volumes;
            for (std::size_t b = 0; b < Sets::count; ++b)
                volumes[b] =
                    static_cast<Number>(mass_unit / (densities[b] * std::pow(lattice_.cell_size, d)));
            return UpdateBodies<Space, Kernel, Transfer, Actions, Sets::count>{update, sets.contact(),
                                                                               volumes, bodies_touch};
        }
        else
            return update;
    }

    /// The share of its own velocity that a particle keeps beside the grid's.
    Number flip_fraction() const
    {
        if constexpr (Transfer::keeps_old_velocity)
            return static_cast<Number>(transfer_.fraction);
        else
            return Number(0);
    }

private:
    template <std::size_t k>
    using DerivedOf = typename MaterialTraits<k>::Table::Derived;

    /// The gathered fields of a material's particles: the cached ones or, stored in `again`, regathered ones.
    template <std::size_t k>
    FIRN_COLD [[gnu::noinline]] DerivedOf<k> const& derived(Sets const& sets,
                                                            std::optional<DerivedOf<k>>& again) const
    {
        auto const& table = sets.template particles<k>();
        auto const& cached = table.contents().gathered;
        if (table.has_grid_fields() && !cached.same()) return cached.rows();
        again.emplace(table.new_derived());
        if (table.has_grid_fields())
            again->fill(0, *cached.same());
        else
            regather<k>(sets, again->view());
        return *again;
    }

    /// All particles of a material scatter to the grid: everything, or the impulse of a step alone.
    template <std::size_t k>
    FIRN_COLD void scatter(double dt, bool impulse_only, Sets& sets)
    {
        auto& table = sets.template particles<k>();
        auto layer = grid_.layer(k);
        backend_.for_each_cell(table.cells(), layer,
                               P2g<k>{{},
                                      sets.template model<k>(),
                                      transfer_,
                                      table.current(),
                                      table.derived(),
                                      table.mass_groups(),
                                      static_cast<Number>(dt),
                                      static_cast<Number>(lattice_.cell_size),
                                      impulse_only});
    }

    Lattice lattice_;
    Transfer transfer_;
    Backend backend_;
    Grid grid_;
    double scattered_dt_ = 0;
    bool leavers_scattered_ = false;
};

} // namespace firn
