// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/table_snapshot.hpp>
#include <firn/state/restore.hpp>
#include <firn/state/snapshot.hpp>
#include <firn/time_stepping/step_controller.hpp>

#include <cstdint>
#include <sstream>
#include <utility>
#include <vector>

// A whole scene as a snapshot, and back. `scene` is a SceneState, and `time_loop` its TimeLoop.
namespace firn::detail
{

/// Goes on from a snapshot whose particles are in place already: the grid, and the planned steps, begin
/// afresh.
template <class Scene, class TimeLoop, class Number, int d>
void go_on_from(Snapshot<Number, d> const& from, StepBounds const& bounds,
                typename Scene::GridStateType grid_state, std::vector<StepFailure> isolated, Scene& scene,
                TimeLoop& time_loop)
{
    grid_state.take_lists(scene.grid_state);
    scene.grid_state = std::move(grid_state);
    scene.masses = from.masses;
    scene.next_id = from.next_id;
    time_loop.go_on_from({.time = from.time, .bounds = bounds, .previous = from.previous, .last = from.last},
                         std::move(isolated));
}

/// The snapshot of a scene whose particles have cached what they gather.
template <class Scene, class TimeLoop>
auto snapshot_of_scene(Scene& scene, TimeLoop const& time_loop)
{
    using Sets = typename Scene::Sets;
    using Kernel = typename Scene::Kernel;
    TimeState const& time_state = time_loop.next_step().time_state;
    Snapshot<typename Scene::Number, Scene::d> to{.kernel = name_of_policy<Kernel>(),
                                                  .transfer = name_of_policy<typename Scene::Transfer>(),
                                                  .kernel_degree = Kernel::degree,
                                                  .transfer_parameters = parameters_of(scene.transfer),
                                                  .lattice = scene.lattice,
                                                  .time = time_state.time,
                                                  .previous = time_state.previous,
                                                  .last = time_state.last,
                                                  .bounds = time_state.bounds,
                                                  .masses = scene.masses,
                                                  .next_id = scene.next_id,
                                                  .materials = {},
                                                  .isolated = time_loop.isolated()};
    Sets::for_each([&](auto k) {
        to.materials.push_back(snapshot_of(scene.sets.template particles<k>()));
        name_material<k>(scene.sets, to.materials.back());
    });
    return to;
}

/// Lets a scene go on from a snapshot of its own particles, in the memory that they have already.
template <class Scene, class TimeLoop, class Number, int d>
void set_particles(Snapshot<Number, d> const& from, Scene& scene, TimeLoop& time_loop)
{
    using Sets = typename Scene::Sets;
    std::vector<typename Sets::CellOrder> orders; // allocated before anything changes
    Sets::for_each([&](auto k) {
        orders.push_back(cell_order_of(scene.sets.template particles<k>(), from.materials[k]));
    });
    typename Scene::GridStateType grid_state(scene.lattice, scene.transfer, scene.backend);
    auto isolated = from.isolated;
    scene.change([&] {
        Sets::for_each([&](auto k) {
            restore_particles(scene.sets.template particles<k>(), from.materials[k], std::move(orders[k]));
        });
        go_on_from(from, from.bounds, std::move(grid_state), std::move(isolated), scene, time_loop);
    });
}

/// Saves a scene, which then goes on as from its snapshot; see Solver::snapshot.
template <class Scene, class TimeLoop>
auto save(Scene& scene, TimeLoop& time_loop)
{
    scene.cache_grid_fields();
    auto to = snapshot_of_scene(scene, time_loop);
    set_particles(to, scene, time_loop);
    return to;
}

/// Replaces a scene by that of a snapshot whose fields, parameters and cells are known to fit; `has_bounds`
/// says whether its bounds of the next step hold, and `call` is what errors name.
template <class Scene, class TimeLoop, class Number, int d>
void replace(Snapshot<Number, d> const& from, bool has_bounds, Scene& scene, TimeLoop& time_loop,
             char const* call)
{
    using Sets = typename Scene::Sets;
    Sets sets = scene.sets.emptied(scene.lattice, Scene::Kernel::degree, scene.backend);
    Sets::for_each([&](auto k) {
        auto& table = sets.template particles<k>();
        restore_particles(table, from.materials[k]);
        if constexpr (Sets::template may_object<k>)
            for_each_particle(table, [&](std::uint32_t row, auto const& particle) {
                sets.template require_bearable<k>(table, row, particle, call);
            });
    });
    StepBounds const bounds =
        has_bounds ? from.bounds : time_loop.next_step().bounds_of(scene, sets, from.bounds);
    auto isolated = from.isolated;
    typename Scene::GridStateType grid_state(scene.lattice, scene.transfer, scene.backend);
    Sets::for_each([&](auto k) { // from here on nothing can fail
        auto &now = sets.template particles<k>().cells(),
             &before = scene.sets.template particles<k>().cells();
        if constexpr (requires { now.take_workspace(before); }) now.take_workspace(before);
    });
    scene.sets = std::move(sets);
    scene.known_marks.forget();
    go_on_from(from, bounds, std::move(grid_state), std::move(isolated), scene, time_loop);
}

/// Replaces a scene by that of a snapshot; see Solver::restore.
template <class Scene, class TimeLoop, class Number, int d>
void restore(Snapshot<Number, d> const& from, Scene& scene, TimeLoop& time_loop)
{
    using Sets = typename Scene::Sets;
    using Kernel = typename Scene::Kernel;
    if constexpr (spans_ranks<typename Scene::Backend>) {
        std::ostringstream text;
        text.precision(17);
        text << "the snapshot at t = " << from.time << " s, before particle " << from.next_id;
        require_same_on_ranks(scene.backend, "Solver::restore", text.str());
    }
    bool const same_bounds = require_fits<Kernel>(from, scene.sets, scene.lattice, scene.transfer);
    constexpr auto call = "Solver::restore";
    require_whole(from, Sets::CellOrder::largest_coordinate, call,
                  "Restore what Solver::snapshot has returned.");
    replace(from, same_bounds, scene, time_loop, call);
}

} // namespace firn::detail
