// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/cell_offset.hpp>
#include <firn/core/error.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/storage.hpp>
#include <firn/phases/solve_particles.hpp>
#include <firn/phases/solve_search.hpp>
#include <firn/state/save_restore.hpp>
#include <firn/time_stepping/displaced_there.hpp>
#include <firn/time_stepping/time_loop.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{
/// What the particles of a material gather from nodes that hold their displacements in a second, and the
/// state to which these deform them, by row.
template <std::size_t k, class Scene>
auto displacements(Scene& scene, double second)
{
    using Traits = typename Scene::Sets::template MaterialTraits<k>;
    using Phase = GatherSolution<typename Scene::Space, typename Traits::Model, typename Scene::Kernel,
                                 typename Scene::Transfer::Explicit, typename Traits::Stored>;
    auto& table = scene.sets.template particles<k>();
    DerivedStorage<typename Scene::Backend, typename Scene::Space, typename Phase::Found> found(scene.backend,
                                                                                                table.size());
    auto layer = scene.grid_state.grid().layer(k);
    Phase phase;
    phase.particles = table.ordered();
    phase.model = scene.sets.template model<k>();
    phase.found = found.view();
    phase.dt = static_cast<typename Scene::Number>(second);
    phase.inverse_cell_size = static_cast<typename Scene::Number>(1 / scene.lattice.cell_size);
    scene.backend.for_each_cell(table.cells(), layer, phase);
    return found;
}

/// Moves and deforms the particles of a material in a snapshot, and takes away their velocities.
template <std::size_t k, class Scene, class Found, class Snapshot>
void displace(Scene& scene, Found const& found, Snapshot& snapshot)
{
    using Traits = typename Scene::Sets::template MaterialTraits<k>;
    using Number = typename Scene::Number;
    constexpr int d = Scene::d;
    auto const by_row = [&]<class Tag>(Tag) {
        auto of_all = found.template by_row<Tag>(snapshot.ids.size());
        share_rows(scene.backend, rows_of(scene.sets.template particles<k>()), of_all, Rows::all);
        return of_all;
    };
    auto const way = by_row(Velocity{});
    std::vector<std::uint32_t> row(snapshot.ids.size());
    for (std::size_t i = 0; i < row.size(); ++i)
        row[i] = scene.sets.template particles<k>().row(snapshot.ids[i]);
    for (std::size_t i = 0; i < row.size(); ++i)
        for (int a = 0; a < d; ++a) {
            auto& offset = snapshot.offsets[std::size_t(a)][i];
            auto const to = moved_by<Number>(offset, double(way[row[i]][a]) / scene.lattice.cell_size);
            snapshot.cells[i][a] += static_cast<int>(to.cells);
            offset = to.offset;
        }
    auto const set = [&](auto tag, auto const& value) {
        using Tag = decltype(tag);
        auto const field =
            std::ranges::find(snapshot.fields, std::string(Tag::name), &FieldSnapshot<Number>::name);
        if (field == snapshot.fields.end()) return;
        for (int c = 0; c < component_count<Tag>(d); ++c)
            for (std::size_t i = 0; i < row.size(); ++i)
                field->components[std::size_t(c)][i] = value(row[i], c);
    };
    auto const nothing = [](std::uint32_t, int) { return Number(0); };
    set(Velocity{}, nothing);
    set(AffineVelocity{}, nothing);
    for_each_tag(typename Traits::Model::State{}, [&](auto tag) {
        using Tag = decltype(tag);
        auto const tried = by_row(tag);
        set(tag, [&](std::uint32_t of, int c) { return component_of<Tag, d>(tried[of], c); });
    });
}

/// What displace() and set_particles() make of the particles of a material, where all of them lie in memory
/// of this host. Nothing but what changes is copied, and particles come to lie in the same order.
template <std::size_t k, class Scene>
class DisplacedHere
{
    using Traits = typename Scene::Sets::template MaterialTraits<k>;
    using Table = typename Traits::Table;
    using Number = typename Scene::Number;
    using Offset = typename Table::Offset;
    static constexpr int d = Scene::d;

public:
    /// Finds where they are to lie. Allocates all that is needed.
    template <class Found>
    DisplacedHere(Scene& scene, Found const& found)
        : table_(scene.sets.template particles<k>()), cells_(scene.backend, periods_of<d>(scene.lattice))
    {
        table_.sort();
        auto const& buffer = table_.contents().buffer[0];
        std::size_t const count = table_.places();
        places_.reserve(count), rows_.reserve(count);
        std::vector<Coordinates<d>> cells;
        cells.reserve(count);
        table_.cells().for_each([&](std::size_t place, Coordinates<d> const& cell) {
            places_.push_back(place);
            rows_.push_back(buffer.id.data()[place]);
            cells.push_back(cell);
        });
        scratch_.resize(count);
        for (int a = 0; a < d; ++a) {
            auto& offset = offset_[std::size_t(a)];
            Offset const* const from = buffer.offset[std::size_t(a)].data();
            Number const* const way = found.template column_of<Velocity>(a).data();
            offset.resize(count);
            for (std::size_t i = 0; i < count; ++i) {
                auto const to =
                    moved_by<Number>(from[places_[i]], double(way[rows_[i]]) / scene.lattice.cell_size);
                fits_ =
                    fits_ && std::abs(cells[i][a] + to.cells) <= Scene::Sets::CellOrder::largest_coordinate;
                if (!fits_) return;
                cells[i][a] += static_cast<int>(to.cells);
                offset[i] = to.offset;
            }
        }
        for_each_column<typename Table::PersistentFields>([&](auto tag, int c, int) {
            auto const now = value_of(tag, c, found);
            for (std::uint32_t const row : rows_) fits_ = fits_ && (!now || is_finite(now(row)));
        });
        if (fits_ && count > 0) cells_.insert(cells.data(), count, 0);
    }

    /// The largest wave modulus of them [Pa].
    template <class Found>
    double largest_modulus(Found const& found) const
    {
        Number const* const moduli = found.template column_of<FoundModulus>(0).data();
        double largest = 0;
        for (std::uint32_t const row : rows_)
            largest = std::max(largest, modulus_or_infinity(double(moduli[row])));
        return largest;
    }
    /// Whether all are finite and in the range of cells, so that they can be set.
    bool fits() const { return fits_; }

    /// Sets the particles.
    template <class Found>
    void set(Found const& found)
    {
        std::size_t const count = places_.size();
        table_.change([&] {
            auto& to = table_.contents();
            auto& buffer = to.buffer[0];
            for (int a = 0; a < d; ++a)
                std::ranges::copy(offset_[std::size_t(a)], buffer.offset[std::size_t(a)].data());
            std::ranges::copy(rows_, buffer.id.data());
            for_each_column<typename Table::PersistentFields>([&](auto tag, int c, int column) {
                Number* const values = buffer.component[std::size_t(column)].data();
                if (auto const now = value_of(tag, c, found)) {
                    for (std::size_t i = 0; i < count; ++i) values[i] = now(rows_[i]);
                    return;
                }
                for (std::size_t i = 0; i < count; ++i) scratch_[i] = values[places_[i]];
                std::ranges::copy(scratch_, values);
            });
            for_each_column<typename Table::DerivedFields>([&](auto tag, int c, int column) {
                Number* const values = table_.cached().column(column).data();
                if (auto const now = value_of(tag, c, found))
                    for (std::uint32_t row = 0; row < count; ++row) values[row] = now(row);
            });
            if constexpr (requires { cells_.take_workspace(to.cells); }) cells_.take_workspace(to.cells);
            to.cells = std::move(cells_);
        });
    }

private:
    /// The value of a field's component by row, if it is another one now.
    struct NewValue
    {
        Number const* by_row = nullptr;
        bool is_new = false;
        explicit operator bool() const { return is_new; }
        Number operator()(std::uint32_t row) const { return by_row == nullptr ? Number(0) : by_row[row]; }
    };
    template <class Tag, class Found>
    static NewValue value_of(Tag, [[maybe_unused]] int component, [[maybe_unused]] Found const& found)
    {
        if constexpr (Traits::Model::State::template contains<Tag>)
            return {found.template column_of<Tag>(component).data(), true};
        else
            return {nullptr, std::is_same_v<Tag, Velocity> || std::is_same_v<Tag, AffineVelocity>};
    }
    template <class Set, class Use>
    static void for_each_column(Use const& use)
    {
        for_each_tag(Set{}, [&](auto tag) {
            constexpr int first = Set::template first_component<decltype(tag)>(d);
            for (int c = 0; c < component_count<decltype(tag)>(d); ++c) use(tag, c, first + c);
        });
    }

    Table& table_;
    typename Table::CellOrder cells_;
    std::vector<std::size_t> places_; ///< where they lie, in the order of cells
    std::vector<std::uint32_t> rows_;
    std::array<std::vector<Offset>, std::size_t(d)> offset_;
    std::vector<Number> scratch_;
    bool fits_ = true;
};

/// What displaces the particles of a material without a snapshot, on one rank.
template <std::size_t k, class Scene>
using Displaced = std::conditional_t<Scene::Backend::reaches_host_memory, DisplacedHere<k, Scene>,
                                     DisplacedThere<k, Scene>>;
} // namespace detail

/// A load step is a solve of a second in which inertia is left out: its velocities are the displacements of
/// that second. If it does not converge, half of it is tried. Time does not pass.
template <class Scene>
template <class... Effects>
RestReport TimeLoop<Scene>::settle(Scene& scene, Effects const&... effects)
{
    static_assert(
        []<std::size_t... k>(std::index_sequence<k...>) {
            return (!ActsOnRates<typename Sets::template MaterialTraits<k>::Model> && ...);
        }(typename Sets::Places{}),
        "a fluid bears no shear, so no solve finds its state of rest: take firn::settle(solver, ...) of "
        "firn/settle.hpp, or begin with hydrostatic() of firn/initial_stress.hpp");
    require(!scene.transfer.integrator.fixed,
            "a fixed number of iterations need not find a state of rest, and settle() asks for one",
            "Solver::settle",
            "Settle a solver whose Implicit::fixed is false, and restore its snapshot into this one.");
    constexpr double second = 1;
    double const now = next_.time_state.time;
    detail::require_to_last<Number>(now, second, "Solver::settle");
    Controller controller = next_.controller_for(scene, effects...);
    controller.equal = second;
    auto plain = plain_effects(now, effects...);
    RestReport report;
    std::optional<std::array<double, Sets::count>> largest; // wave moduli, where the solve tells them
    begin_call(scene);
    auto const load = [&] { // one load step; false if it does not converge
        groups_.stage(plain, scene.lattice, now, second, effects...);
        scene.cache_grid_fields();
        next_.time_state.ready = false;
        next_.choose(scene, controller);
        auto const parts = parts_of(scene);
        typename Driver::template Steps<decltype(plain)> step(memory_, parts, controller, plain, 1);
        bool solved = false;
        scene.change([&] {
            step.rebin();
            step.activate_grid();
            step.scatter_missing();
            solved = step.solve();
            report.reactions.clear();
            if (solved) {
                using Result = Reactions<decltype(step)::Actions::obstacles>;
                typename Scene::Backend::template ReadbackBuffer<Result> buffer(scene.backend);
                auto const reactions = merged_result(scene.backend, buffer, step.update_grid(0));
                for (auto* const group : groups_.of_call()) { // adds up what they received
                    group->add_ranks(0);
                    group->add_up(1);
                    group->end(1, false, 0);
                }
                groups_.template append_reactions<Effects...>(reactions, scene.masses.unit, report.reactions);
            }
            step.end(0, true); // the grid has no velocities of the last step
        });
        if (!solved) return false;
        auto const found = [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            return std::tuple{detail::displacements<k>(scene, second)...};
        }
        (typename Sets::Places{});
        scene.cache_grid_fields();
        constexpr bool may_object = []<std::size_t... k>(std::index_sequence<k...>)
        {
            return (Sets::template may_object<k> || ...);
        }
        (typename Sets::Places{});
        using Backend = typename Scene::Backend;
        if constexpr (!spans_ranks<Backend> && !may_object) {
            auto displaced = [&]<std::size_t... k>(std::index_sequence<k...>)
            {
                return std::tuple{detail::Displaced<k, Scene>(scene, std::get<k>(found))...};
            }
            (typename Sets::Places{});
            if (std::apply([](auto const&... of) { return (of.fits() && ...); }, displaced)) {
                // the grid knows the orders of cells that were
                typename Scene::GridStateType grid_state(scene.lattice, scene.transfer, scene.backend);
                largest.emplace();
                Sets::for_each([&](auto k) {
                    (*largest)[k] = std::get<k>(displaced).largest_modulus(std::get<k>(found));
                });
                scene.change([&] {
                    Sets::for_each([&](auto k) { std::get<k>(displaced).set(std::get<k>(found)); });
                    grid_state.take_lists(scene.grid_state);
                    scene.grid_state = std::move(grid_state);
                    go_on_from({.time = next_.time_state.time});
                });
                return true;
            }
        }
        largest.reset();
        auto snapshot = detail::snapshot_of_scene(scene, *this);
        Sets::for_each(
            [&](auto k) { detail::displace<k>(scene, std::get<k>(found), snapshot.materials[k]); });
        snapshot.previous = snapshot.last = 0;
        snapshot.bounds = {};
        constexpr auto call = "Solver::settle";
        detail::require_whole(
            snapshot, Sets::CellOrder::largest_coordinate, call,
            "The load takes particles to where no scene can be, or makes values of them that "
            "are not finite: pass a smaller load, or look at the material. The state is that "
            "of the last load step that was found.");
        if constexpr (may_object)
            detail::replace(snapshot, true, scene, *this, call);
        else
            detail::set_particles(snapshot, scene, *this);
        return true;
    };
    auto const end = [&] { // whatever happened
        memory_.solve.at_rest = false;
        memory_.solve.left_out = 0;
        next_.time_state.time = now;
        next_.time_state.ready = false;
        report.solve = memory_.solve.report;
    };
    memory_.solve.at_rest = true;
    try {
        double left = 1, share = 1; // of the load, and of a load step in it
        while (left > 0) {
            memory_.solve.left_out = share < left ? 1 - share / left : 0;
            if (load()) {
                left = share < left ? left - share : 0;
                ++report.load_steps;
                continue;
            }
            if (memory_.solve.refused != nullptr) refuse_step(scene);
            share /=
                memory_.solve.loose != nullptr ? 8 : 2; // what slides at all loads need not be tried at each
            if (share < smallest_load) {
                require_stress(scene);
                fail_to_rest();
            }
        }
        next_.find_bounds_at_rest(
            scene, [&](auto k) { return largest ? (*largest)[k] : detail::largest_modulus<k>(scene.sets); });
    }
    catch (...) {
        end();
        throw;
    }
    end();
    return report;
}

} // namespace firn
