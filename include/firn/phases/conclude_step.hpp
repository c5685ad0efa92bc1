// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/mishap.hpp>
#include <firn/effects/chain.hpp>
#include <firn/phases/plan_steps.hpp>
#include <firn/phases/step_now.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

namespace firn
{

/// What is known of a run of steps where they are taken; the host reads it when they are through.
struct StepLog
{
    Course course;
    std::uint64_t taken = 0; ///< steps of this run
    std::uint64_t wrong = 0; ///< particles with a mishap in the step after these; if any, it changed nothing
    Mishap mishap = Mishap::none; ///< of the first of them
    std::uint32_t particle = 0;   ///< its id
};

/// What one step of a run did.
template <int obstacles>
struct StepRecord
{
    double dt = 0;                  ///< [s]
    double stable = 0;              ///< the bound before it [s]
    StepLimit limit{};              ///< what bounded dt
    std::uint64_t capped = 0;       ///< particles whose model is at a cap
    Reactions<obstacles> reactions; ///< impulses per mass unit
};

/// Makes ready for a run of steps from where the host says they begin.
template <class Number, int d, class Effects, class Actions>
struct BeginSteps
{
    Course course;
    Effects effects;
    StepLog* log;
    StepNow<Number, Actions>* now;

    FIRN_HOST_DEVICE void operator()(std::size_t) const
    {
        log->course = course;
        log->taken = 0;
        log->wrong = 0;
        if (!course.ready) // or it was left so by the step before
            *now = {static_cast<Number>(course.now.interval.length()),
                    static_cast<Number>(course.next.interval.length()),
                    effects.template during<Number, d>(course.now.interval)};
    }
};

/// Phase 4: what moving the particles found out bounds the next step, which is chosen, with its obstacles
/// where they are then. Called once, when the others are through.
///
/// False if the next step is not to be taken as things stand: this one went wrong, all are through, or the
/// particles have given for a length that no longer fits.
template <class Number, int d, class Effects, class Actions, class Reacted>
struct ConcludeStep
{
    StepRule rule;
    double density; ///< at rest [kg/m^3]
    Effects effects;
    Reacted reacted; ///< what nodes did to obstacles
    StepLog* log;
    StepRecord<Actions::obstacles>* records;
    StepNow<Number, Actions>* now;

    template <class Found>
    FIRN_HOST_DEVICE bool operator()(Found const& found) const
    {
        Course& course = log->course;
        course.ready = false;
        log->wrong = found.wrong;
        log->mishap = found.mishap;
        log->particle = found.particle;
        if (found.wrong > 0) return false;

        Reactions<Actions::obstacles> reactions = reacted;
        StepBounds bounds;
        bounds.wave_speed = sqrt(found.wave_modulus / density);
        bounds.speed = sqrt(found.speed2);
        bounds.deformation_rate = sqrt(found.deformation);
        bounds.obstacle_speed = sqrt(reactions.largest_surface_speed2);
        reactions.merge(found.reactions);
        records[log->taken++] = {course.now.interval.length(), course.stable, course.now.limit, found.capped,
                                 reactions};
        rule.finish(course, bounds);
        if (!rule.goes_on(course) || !rule.choose(course) || !rule.gets_on(course)) return false;
        if (rule.equal > course.stable) return false; // the host looks after what may go wrong
        course.ready = true;
        *now = {static_cast<Number>(course.now.interval.length()),
                static_cast<Number>(course.next.interval.length()),
                effects.template during<Number, d>(course.now.interval)};
        return true;
    }
};

} // namespace firn
