// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/groups.hpp>
#include <firn/time_stepping/grid_state.hpp>
#include <firn/time_stepping/solve_memory.hpp>
#include <firn/time_stepping/step_controller.hpp>
#include <firn/time_stepping/typed_storage.hpp>
#include <firn/time_stepping/volume_keeping.hpp>

#include <type_traits>
#include <vector>

namespace firn
{

/// What steps change, and the values they need for it.
template <class Backend, class Sets, class Kernel, class Transfer>
struct StepScene
{
    Sets& sets;
    GridState<Backend, Sets, Kernel, Transfer>& grid_state;
    TimeState& time_state;
    double mass_unit;                                ///< of masses [kg]
    typename Sets::Space::Scalar smallest_node_mass; ///< below it a node's momentum is rounding [mass units]
    bool may_lose_particles;                         ///< after a failed step
    /// of the call's effects
    std::vector<GroupMemory<Backend, typename Sets::Space::Scalar, Sets::Space::dimension>*> const& groups;
};

/// What steps use from one call to the next: where they run, and the memory of their plain values.
template <class Backend, class Sets, class Transfer>
struct StepMemory
{
    StepMemory(Lattice where, Transfer const& scheme, Backend const& on)
        : lattice(where), transfer(scheme), backend(on), storage(on), volumes(on), solve(on)
    {}

    Lattice lattice;
    Transfer transfer;
    Backend backend;
    TypedStorage<Backend> storage;
    std::conditional_t<Sets::keep_volume, VolumeKeeping<Backend, typename Sets::Space, Sets::count>,
                       NoVolumeKeeping>
        volumes;
    SolveMemoryFor<Backend, Sets, Transfer> solve; ///< of implicit steps
    int turn = 0;                                  ///< which of the two contexts the next step reads
    bool nodes_spoiled = false; ///< the last step failed: nodes lack the velocities of the last good one
};

} // namespace firn
