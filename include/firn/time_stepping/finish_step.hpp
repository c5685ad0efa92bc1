// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/chain.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/time_stepping/step_controller.hpp>
#include <firn/time_stepping/step_log.hpp>

#include <array>
#include <cstddef>
#include <cstring>
#include <type_traits>

namespace firn
{

/// What stays the same during a batch of steps, in memory where they run.
template <class Effects, int materials>
struct BatchPlan
{
    TimeStepController<materials> steps;
    std::array<double, std::size_t(materials)> density; ///< of each material at rest [kg/m^3]
    Effects effects;
};

/// The plain values that the steps of a call need where they run. A step reads one context and computes the
/// other, which is the next step's.
template <class Number, int materials, class Effects, class Actions>
struct StepStorage
{
    using Now = StepContext<Number, Actions>;
    using Plan = BatchPlan<Effects, materials>;
    static_assert(std::is_trivially_destructible_v<Now>, "an effect's action is a plain value");
    static_assert(std::is_trivially_destructible_v<Plan>, "an effect, as steps know it, is a plain value");

    Now now[2];
    Plan plan;
};

/// Prepares the log for a batch of steps that begins at the host's time state: called for every entry.
template <int obstacles, int materials>
struct BeginBatch
{
    TimeState time_state;
    StepEntry<obstacles, materials>* log;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        log[place].after.failed = 0;
        log[place].taken = 0;
        if (place == 0) log[0].after.time_state = time_state;
    }
};

/// The same where the time state is not ready: controller and effects may be new, and the first step's
/// context has not been computed yet.
template <class Number, int d, int materials, class Effects, class Actions>
struct BeginSteps
{
    BeginBatch<Actions::obstacles, materials> begin_batch;
    BatchPlan<Effects, materials> controller;
    BatchPlan<Effects, materials>* plan;
    StepContext<Number, Actions>* now;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        begin_batch(place);
        if (place > 0) return;
        // padding too; otherwise initcheck reports it
        std::memcpy(static_cast<void*>(plan), &controller, sizeof controller);
        TimeState const& time_state = begin_batch.time_state;
        now->dt = static_cast<Number>(time_state.now.interval.length());
        now->forces = static_cast<Number>(time_state.now.interval.forces);
        now->next_forces = static_cast<Number>(time_state.next.interval.forces);
        now->actions = controller.effects.template over<Number, d>(time_state.now.interval);
    }
};

/// Phase 4: chooses the next step by the bounds that moving the particles found, and places its obstacles
/// where they are then. Called once, after the other phases; once more if the step is repeated. A backend may
/// rebin particles for the next step at the same time.
template <class Number, int d, int materials, class Effects, class Actions>
struct FinishStep
{
    BatchPlan<Effects, materials> const* plan;
    StepEntry<Actions::obstacles, materials>* log;
    int step;                            ///< of the batch, from 0 on
    StepContext<Number, Actions>* after; ///< the next step's context

    /// `reactions` are those of the obstacles to nodes, `found` are the results of moving the particles of
    /// each material. Returns false if the next step must not be taken yet.
    template <class... Found>
    FIRN_HOST_DEVICE bool operator()(Reactions<Actions::obstacles> const& reactions,
                                     Found const&... found) const
    {
        Reactions<Actions::obstacles> all = reactions;
        if constexpr (Actions::touching > 0) (all.merge(found.reactions), ...);
        return went_well(all, found...) && goes_on(all, found...);
    }

private:
    /// Logs failures; false if there are any.
    template <class... Found>
    FIRN_HOST_DEVICE bool went_well(Reactions<Actions::obstacles> const& reactions,
                                    Found const&... found) const
    {
        static_assert(sizeof...(Found) == materials);
        StepEntry<Actions::obstacles, materials>& mine = log[step + 1];
        bool failed = note_failures(mine.after, found...);
        if (!failed && (reactions.overflow() || plan->effects.overflow(static_cast<std::size_t>(step)))) {
            // no particle failed by itself: the host names one
            failed = true;
            mine.after.cause = FailureCause::overflowed;
            mine.after.failed = 1;
        }
        mine.taken = failed ? 0 : 1;
        if (!failed) return true;
        mine.after.time_state = log[step].after.time_state;
        mine.after.time_state.ready = false;
        return false;
    }

    /// After a step without failures: logs it and chooses the next one. Returns false if that must not be
    /// taken yet: all steps are done, or particles have scattered for a length that no longer fits.
    template <class... Found>
    FIRN_HOST_DEVICE bool goes_on(Reactions<Actions::obstacles> const& reactions, Found const&... found) const
    {
        TimeState time_state = log[step].after.time_state; // copies, so that they are loaded once
        BatchPlan<Effects, materials> const fixed = *plan;
        TimeStepController<materials> const& controller = fixed.steps;
        time_state.ready = false;
        StepBounds bounds;
        StepRecord<Actions::obstacles, materials> record{time_state.now.interval.length(),
                                                         time_state.now.interval.forces,
                                                         time_state.stable,
                                                         time_state.now.limit,
                                                         {found.capped...},
                                                         {}};
        int material = 0;
        auto const ask = [&](auto const& of) {
            controller.admit(bounds, material,
                             sqrt(double(of.wave_modulus) / fixed.density[static_cast<unsigned>(material)]));
            bounds.speed = max(bounds.speed, sqrt(double(of.speed2)));
            bounds.deformation_rate = max(bounds.deformation_rate, sqrt(double(of.deformation)));
            ++material;
        };
        (ask(found), ...);
        bounds.obstacle_speed = sqrt(reactions.largest_surface_speed2);
        record.reactions = reactions;
        log[step + 1].record = record;
        controller.finish(time_state, bounds);
        if (controller.goes_on(time_state) && controller.choose(time_state) && controller.gets_on(time_state))
            time_state.ready =
                controller.fits(time_state) &&
                !(controller.equal > time_state.stable); // else the host handles it: it may fail
        log[step + 1].after.time_state = time_state;
        if (!time_state.ready) return false;
        after->dt = static_cast<Number>(time_state.now.interval.length());
        after->forces = static_cast<Number>(time_state.now.interval.forces);
        after->next_forces = static_cast<Number>(time_state.next.interval.forces);
        after->actions = fixed.effects.template over<Number, d>(time_state.now.interval);
        return true;
    }

    /// Logs failures; true if there are any.
    template <class... Found>
    FIRN_HOST_DEVICE static bool note_failures(StepLog& note, Found const&... found)
    {
        note.failed = 0;
        int material = 0;
        auto const ask = [&](auto const& of) {
            if (note.failed == 0) {
                note.cause = of.cause;
                note.material = material;
                note.particle = of.particle;
            }
            note.failed += of.failed;
            ++material;
        };
        (ask(found), ...);
        return note.failed > 0;
    }
};

} // namespace firn
