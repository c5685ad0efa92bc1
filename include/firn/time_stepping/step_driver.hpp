// SPDX-License-Identifier: MIT
#pragma once

#include <firn/time_stepping/step_phases.hpp>

namespace firn
{

/// Takes the steps of a scene one by one, on a backend whose loops have finished when they return. This is
/// the step of the explicit Material Point Method:
///
///   rebin             particles into the cells that they have moved to
///   activate_grid     blocks of nodes under these cells
///   scatter_missing   P2G: particles that were added or changed, or for another dt, scatter to the nodes
///   find_shifts       at intervals: how far particles of a fluid that keeps its volume are moved
///   solve             implicit steps: the velocities that go with the stress at their end
///   update_grid       momentum becomes velocity; forces, gravity and obstacles act on it
///   g2p2g             G2P and P2G: particles gather velocities, move, deform, and scatter to the next grid
///   finish_step       the next dt, by the bounds that the particles found; which of them failed
///
/// Particles are read from one buffer and written to another one, so a step that failed is not committed:
/// what is stored of them is as before, and the sums on the grid are, too, for the step that repeats it.
/// StepQueue takes the same steps on a backend that queues them.
template <class Backend, class Sets, class Kernel, class Transfer>
class StepDriver
{
public:
    using Memory = StepMemory<Backend, Sets, Transfer>;
    using Scene = StepScene<Backend, Sets, Kernel, Transfer>;
    using Controller = TimeStepController<static_cast<int>(Sets::count)>;
    template <class Effects>
    using Steps = StepPhases<Backend, Sets, Kernel, Transfer, Effects>;

    /// Takes the chosen step, and calls `visit` with its record. A failed step leaves the particles, and the
    /// sums they scattered, unchanged.
    ///
    /// If memory runs out in the middle, there is no state to go on from.
    template <class Effects, class Visit>
    FIRN_COLD StepLog const& take(Steps<Effects>& step, Visit const& visit)
    {
        try {
            step.rebin();
            step.activate_grid();
            step.scatter_missing();
            step.find_shifts();
            if (step.solve()) {
                auto reactions = step.update_grid(0);
                auto found = step.g2p2g(0);
                step.share_results(reactions, found);
                step.finish_step(0, reactions, found);
                step.read_log(1);
                step.repeat_without_room(0, reactions, found);
            }
            else
                step.read_log(1);
        }
        catch (...) {
            step.finish_rebin();
            throw;
        }
        bool const failed = step.has_failed();
        if (failed)
            step.finish_rebin();
        else
            step.commit();
        step.adopt(1, failed ? 0 : 1, failed);
        step.end(failed ? 0 : 1, failed);
        if (!failed) visit(step.entry(1).record);
        return step.entry(1).after;
    }
};

} // namespace firn
