// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/failure_cause.hpp>
#include <firn/effects/chain.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/time_stepping/step_controller.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace firn
{

/// The state of a batch of steps after a step, or where one failed.
struct StepLog
{
    TimeState time_state;
    std::uint64_t failed = 0;                ///< failed particles in the step; if any, it changed nothing
    FailureCause cause = FailureCause::none; ///< of the first of them
    int material = 0;                        ///< the material of that particle
    std::uint32_t particle = 0;              ///< its row in the material's table
};

/// What one step of a batch did.
template <int obstacles, int materials>
struct StepRecord
{
    double dt = 0;     ///< [s]
    double forces = 0; ///< for how long forces acted [s]
    double stable = 0; ///< the bound before it [s]
    StepLimit limit{}; ///< what bounded dt
    std::array<std::uint64_t, std::size_t(materials)>
        capped{};                   ///< particles whose model is at a cap, of each material
    Reactions<obstacles> reactions; ///< impulses per mass unit
};

/// The log of a batch of steps, in memory where they run; the host reads it when they are done. Every step
/// has its own entries, so that a repeated step simply overwrites them.
template <int obstacles, int materials>
struct BatchLog
{
    using Record = StepRecord<obstacles, materials>;

    std::uint64_t* taken; ///< steps that did not fail
    StepLog* at;          ///< before the first step, after each, and one more entry without failures
    Record* records;

    static std::size_t places(std::size_t steps) { return steps + 2; }
    static std::size_t bytes(std::size_t steps)
    {
        return sizeof(std::uint64_t) + places(steps) * sizeof(StepLog) + steps * sizeof(Record);
    }

    /// The log of this many steps at `memory`.
    static BatchLog over(void* memory, std::size_t steps)
    {
        auto* const taken = static_cast<std::uint64_t*>(memory);
        auto* const at = reinterpret_cast<StepLog*>(taken + 1);
        return {taken, at, reinterpret_cast<Record*>(at + places(steps))};
    }
};

/// What stays the same during a batch of steps, in memory where they run.
template <class Effects, int materials>
struct BatchPlan
{
    TimeStepController<materials> steps;
    std::array<double, std::size_t(materials)> density; ///< of each material at rest [kg/m^3]
    Effects effects;
};

/// Prepares the log for a batch of steps that begins at the host's time state: called for every entry.
template <int obstacles, int materials>
struct BeginBatch
{
    TimeState time_state;
    BatchLog<obstacles, materials> log;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        log.at[place].failed = 0;
        if (place > 0) return;
        *log.taken = 0;
        log.at[0].time_state = time_state;
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
    BatchLog<Actions::obstacles, materials> log;
    int step;                            ///< of the batch
    StepContext<Number, Actions>* after; ///< the next step's context

    /// `reactions` are those of the obstacles to nodes, `found` are the results of moving the particles of
    /// each material. Returns false if the next step must not be taken yet.
    template <class... Found>
    FIRN_HOST_DEVICE bool operator()(Reactions<Actions::obstacles> const& reactions,
                                     Found const&... found) const
    {
        return went_well(found...) && goes_on(reactions, found...);
    }

private:
    /// Logs failures; false if there are any.
    template <class... Found>
    FIRN_HOST_DEVICE bool went_well(Found const&... found) const
    {
        static_assert(sizeof...(Found) == materials);
        bool const failed = note_failures(log.at[step + 1], found...);
        *log.taken = std::uint64_t(step + (failed ? 0 : 1));
        if (!failed) return true;
        log.at[step + 1].time_state = log.at[step].time_state;
        log.at[step + 1].time_state.ready = false;
        return false;
    }

    /// After a step without failures: logs it and chooses the next one. Returns false if that must not be
    /// taken yet: all steps are done, or particles have scattered for a length that no longer fits.
    template <class... Found>
    FIRN_HOST_DEVICE bool goes_on(Reactions<Actions::obstacles> reactions, Found const&... found) const
    {
        TimeState time_state = log.at[step].time_state; // copies, so that they are loaded once
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
        if constexpr (Actions::touching > 0) (reactions.merge(found.reactions), ...);
        record.reactions = reactions;
        log.records[step] = record;
        controller.finish(time_state, bounds);
        if (controller.goes_on(time_state) && controller.choose(time_state) && controller.gets_on(time_state))
            time_state.ready =
                !(controller.equal > time_state.stable); // else the host handles a step that may fail
        log.at[step + 1].time_state = time_state;
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
