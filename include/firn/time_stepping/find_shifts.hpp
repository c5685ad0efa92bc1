// SPDX-License-Identifier: MIT
#pragma once

#include <firn/phases/gather_shifts.hpp>
#include <firn/phases/keep_volume.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/time_stepping/step_scene.hpp>

#include <cmath>

namespace firn
{

/// Finds how far the particles of fluids that keep their volume are to be moved in a step that corrects it:
/// particles scatter volumes in the place of the next step's sums, nodes solve for the potential, and
/// particles gather its gradient. `now` is the context of the step, whose obstacles are in their places.
template <class Backend, class Sets, class Kernel, class Transfer, class Actions>
void find_shifts(StepMemory<Backend, Sets, Transfer>& memory,
                 StepScene<Backend, Sets, Kernel, Transfer> const& scene,
                 StepContext<typename Sets::Space::Scalar, Actions> const* now)
{
    static_assert(Actions::obstacles == 0 && Actions::groups == 0 &&
                      Actions::groups_on_particles <= Actions::groups_at_surface,
                  "a fluid that keeps its volume needs obstacles that act at their surface: pass "
                  "Obstacles<Shape, ActsOn::surface>, or choose Fluid");
    static_assert(!Sets::are_bodies, "Bodies know no fluid that keeps its volume: choose Fluid");
    using Space = typename Sets::Space;
    using Number = typename Space::Scalar;
    auto const& backend = memory.backend;
    auto& grid = scene.grid_state.grid();
    auto const per_cell =
        static_cast<Number>(scene.mass_unit / std::pow(memory.lattice.cell_size, Space::dimension));
    grid.swap(); // volumes take the room of the next step's sums
    Sets::for_each([&](auto k) {
        using Material = typename Sets::template MaterialTraits<k>;
        auto layer = grid.layer(k);
        auto& table = scene.sets.template particles<k>();
        backend.for_each_cell(
            table.cells(), layer,
            ScatterVolumes<Space, typename Material::Model, Kernel, typename Material::Stored>{
                scene.sets.template model<k>(), table.current(), table.mass_groups(), per_cell});
    });
    auto const orders = scene.sets.orders();
    memory.volumes.solve(grid, orders, memory.lattice, most_sweeps(scene.sets), [&](auto const& nodes) {
        backend.for_each_node(orders, grid, FindVolumes<Space, Kernel, Actions>{now, memory.lattice, nodes});
    });
    grid.swap();
    Sets::for_each([&](auto k) {
        using Material = typename Sets::template MaterialTraits<k>;
        if constexpr (KeepsItsVolume<typename Material::Model>) {
            auto layer = grid.layer(k);
            auto& table = scene.sets.template particles<k>();
            backend.for_each_cell(
                table.cells(), layer,
                GatherShifts<Space, Kernel, typename Material::Stored, Actions>{
                    now, memory.lattice, table.current(), memory.volumes.shifts(k, table.size())});
        }
    });
}

} // namespace firn
