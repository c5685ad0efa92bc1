// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/queue_outcome.hpp>
#include <firn/time_stepping/step_driver.hpp>

#include <algorithm>
#include <cstddef>
#include <type_traits>

namespace firn
{

/// The steps of a batch, as a backend that queues runs them: it commits and rebins a step before the step's
/// outcome is known. The loops behind a step that went wrong do nothing, and what the host booked for them is
/// rolled back.
template <class Backend, class Sets, class Kernel, class Transfer, class Effects>
class QueuedSteps : public StepPhases<Backend, Sets, Kernel, Transfer, Effects>
{
    using Phases = StepPhases<Backend, Sets, Kernel, Transfer, Effects>;

public:
    using Phases::Phases;

    /// Rebins each material's particles by `rebin<Scatter>(cells, layer, offsets)`, where the leavers scatter
    /// to their new cells by the phase `Scatter`.
    template <class Rebin>
    void rebin_by(Rebin const& rebin)
    {
        Sets::for_each([&](auto k) {
            this->template particles<k>().sort([&](auto& cells, auto const& offsets) {
                auto layer = this->grid().layer(k);
                rebin.template operator()<typename Phases::GridStateType::template P2g<k>>(cells, layer,
                                                                                           offsets);
            });
        });
    }

    /// Undoes so many `commits` and `rebins` by commit() and rebin_by(), for steps that were queued and then
    /// not taken: see ParticleTable::rollback, which also undoes what the backend's order of cells did.
    void rollback(int commits, int rebins)
    {
        Sets::for_each(
            [&](auto k) { this->template particles<k>().rollback(commits, rebins, this->wrote_derived(k)); });
        if (commits % 2 != 0) this->grid().swap(); // an odd number of swaps is undone by one
    }
};

/// Takes the steps of a scene in batches, on a backend that queues them: as many as it queues before the host
/// reads the log. A step is that of StepDriver, by the same members.
template <class Backend, class Sets, class Kernel, class Transfer>
class StepQueue
{
public:
    using Memory = StepMemory<Backend, Sets, Transfer>;
    using Scene = StepScene<Backend, Sets, Kernel, Transfer>;
    using Controller = TimeStepController<static_cast<int>(Sets::count)>;
    template <class Effects>
    using Steps = QueuedSteps<Backend, Sets, Kernel, Transfer, Effects>;

    /// How many steps of `most` to take at once: as many as the backend queues. The host takes part in each
    /// implicit one.
    int steps_at_once(Memory const& memory, Scene const& scene, std::size_t most) const
    {
        if (StepsImplicitly<Transfer>) return 1;
        return static_cast<int>(std::min(most, memory.backend.steps_to_queue(scene.sets.orders(), blindly_)));
    }

    /// Takes the chosen step and those after it, as long as they go as planned. Calls `visit` with the record
    /// of each. Otherwise as StepDriver::take.
    ///
    /// If memory runs out or a device fails in the middle, there is no state to go on from.
    template <class Effects, class Visit>
    FIRN_COLD StepLog const& take(Steps<Effects>& steps, Visit const& visit)
    {
        steps.rebin();
        steps.activate_grid();
        steps.scatter_missing();
        steps.find_shifts();
        QueueOutcome ran{.queued = 1};
        if (steps.solve())
            ran = steps.backend().run_steps(steps, steps.most());
        else
            steps.read_log(1);

        int const taken = steps.taken();
        bool const has_failed = taken < ran.queued && steps.has_failed();
        bool const has_begun = has_failed || (taken < ran.queued && steps.has_stopped());
        int const failed = has_failed ? 1 : 0, dropped = ran.queued - 1 - taken;
        if (taken == ran.queued)
            steps.commit();
        else
            steps.rollback(dropped, dropped + (has_begun ? 0 : 1));
        steps.adopt(taken + failed, taken, has_begun || ran.rebinned_early);
        steps.end(taken, has_failed);
        learn(taken, taken == steps.most() && !ran.lacked_room);
        for (int i = 1; i <= taken; ++i) visit(steps.entry(i).record);
        return steps.entry(taken + failed).after;
    }

private:
    /// Learns from a batch of `taken` steps how many to queue next time.
    void learn(int taken, bool as_planned)
    {
        unstopped_ += static_cast<std::size_t>(taken);
        if (as_planned)
            blindly_ = std::max<std::size_t>(blindly_, std::size_t(2 * taken));
        else {
            blindly_ = std::max<std::size_t>(unstopped_ / 2, 1);
            unstopped_ = 0;
        }
    }

    std::size_t blindly_ = 1;   ///< how many steps may be queued blindly: half as many succeeded
    std::size_t unstopped_ = 0; ///< steps since queued ones were last stopped
};

/// What takes the steps on a backend.
template <class Backend, class Sets, class Kernel, class Transfer>
using StepsOn = std::conditional_t<Backend::queues, StepQueue<Backend, Sets, Kernel, Transfer>,
                                   StepDriver<Backend, Sets, Kernel, Transfer>>;

} // namespace firn
