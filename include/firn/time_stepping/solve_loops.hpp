// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/cell_work.hpp>
#include <firn/phases/solve_phase.hpp>
#include <firn/phases/solve_search.hpp>

#include <type_traits>
#include <utility>

namespace firn
{

/// The loops over nodes of which the solve of an implicit step consists. `Memory` is a StepMemory, and
/// `Scene` a StepScene.
template <class Memory, class Scene>
class SolveLoops
{
    using Backend = std::remove_cvref_t<decltype(std::declval<Memory&>().backend)>;

public:
    SolveLoops(Memory& memory, Scene const& scene) : memory_(&memory), scene_(&scene) {}

    /// Calls a phase for all nodes; returns what they found, or a handle to it.
    template <class Phase>
    auto on_nodes(Phase const& phase) const
    {
        auto const found = memory_->backend.for_each_node(scene_->sets.orders(), grid(), phase);
        if constexpr (spans_ranks<Backend> && !std::is_same_v<typename Phase::Result, NothingFound>)
            memory_->backend.for_each_other_node(scene_->sets.orders(), grid(), phase);
        return found;
    }
    /// What they found, once the loop has finished.
    template <class Phase>
    auto sums_on_nodes(Phase const& phase) const
    {
        if constexpr (Backend::queues) {
            memory_->solve.sums.resize(1);
            on_nodes(phase, StoreResult<typename Phase::Result>{memory_->solve.sums.data()});
            return *memory_->solve.sums.read();
        }
        else
            return merged_result(memory_->backend, memory_->solve.sums, on_nodes(phase));
    }
    /// Calls a phase for all nodes, and then `body(what they found)` where loops run. Returns the same as
    /// on_nodes().
    template <class Phase, class Body>
    auto on_nodes(Phase const& phase, Body const& body) const
    {
        if constexpr (Backend::queues)
            return memory_->backend.for_each_node(scene_->sets.orders(), grid(), phase, body);
        else {
            auto const found = on_nodes(phase);
            call_with(memory_->backend, found, body);
            return found;
        }
    }
    /// Such loops with the sums of a pass, which are the next step's until then.
    template <class Loop>
    auto on_passed(Loop const& loop) const
    {
        grid().swap();
        auto const found = loop();
        grid().swap();
        return found;
    }

private:
    auto& grid() const { return scene_->grid_state.grid(); }

    Memory* memory_;
    Scene const* scene_;
};

} // namespace firn
