// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/cell_offset.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/storage.hpp>
#include <firn/phases/solve_particles.hpp>
#include <firn/phases/solve_search.hpp>
#include <firn/state/save_restore.hpp>
#include <firn/time_stepping/time_loop.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
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
            double const to =
                CellOffset<Number>::exact(offset) + double(way[row[i]][a]) / scene.lattice.cell_size;
            double const cells = std::floor(to + 0.5);
            snapshot.cells[i][a] += static_cast<int>(cells);
            offset = CellOffset<Number>::from(to - cells);
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
    constexpr double second = 1;
    double const now = next_.time_state.time;
    detail::require_to_last<Number>(now, second, "Solver::settle");
    Controller controller = next_.controller_for(scene, effects...);
    controller.equal = second;
    auto plain = plain_effects(now, effects...);
    RestReport report;
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
        auto snapshot = detail::snapshot_of_scene(scene, *this);
        Sets::for_each(
            [&](auto k) { detail::displace<k>(scene, std::get<k>(found), snapshot.materials[k]); });
        snapshot.previous = snapshot.last = 0;
        snapshot.bounds = {};
        detail::require_whole(snapshot, Sets::CellOrder::largest_coordinate);
        constexpr bool may_object = []<std::size_t... k>(std::index_sequence<k...>)
        {
            return (Sets::template may_object<k> || ...);
        }
        (typename Sets::Places{});
        if constexpr (may_object)
            detail::replace(snapshot, true, scene, *this);
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
            if (share < smallest_load) fail_to_rest();
        }
        next_.find_bounds(scene);
    }
    catch (...) {
        end();
        throw;
    }
    end();
    return report;
}

} // namespace firn
