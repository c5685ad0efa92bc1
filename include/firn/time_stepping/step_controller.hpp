// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/effect.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <array>
#include <cmath>
#include <cstddef>

namespace firn
{

/// A step to come and what bounds its length.
struct PlannedStep
{
    Interval interval{};
    StepLimit limit = StepLimit::duration;
    double longest = 0; ///< what it might have been, were it not a part of what remains [s]
};

/// Where a run of steps stands.
struct TimeState
{
    double time = 0;     ///< [s]
    StepBounds bounds{}; ///< of the step that begins now
    double previous = 0; ///< what the last step might have been that filled no duration alone [s]; 0: none
    double last = 0;     ///< the last step [s]; 0: there was none
    int retries = 0;     ///< how many times the step that begins now was tried in vain
    PlannedStep scattered{}; ///< that for which particles have given to the grid already
    PlannedStep now{};       ///< that which is taken
    PlannedStep next{};      ///< the one after it, for which they give as they take it
    bool ready =
        false; ///< `now` and `next` are those of the step that begins now, of the same call as that before
    double stable = 0; ///< length that is stable in it [s]
};

/// How the steps of one call are chosen: what stays the same from step to step.
template <int materials>
struct TimeStepController
{
    StepControl control{};
    double cell_size = 0;                                        ///< [m]
    std::array<MaterialLimits, std::size_t(materials)> limits{}; ///< of each material
    double acceleration = 0;                                     ///< of the effects [m/s^2]
    double obstacle_speed = 0;                                   ///< of the effects [m/s]
    double duration = 0;                                         ///< of the call [s]
    double end = 0;                                              ///< when it ends [s]
    double equal = 0; ///< length of all steps [s]; 0: they are as long as is stable

    /// A step that was planned by the bounds of one step before may be so much longer than the bounds of now,
    /// for which StepControl's safety factors have room, and so much shorter: giving afresh costs more.
    static constexpr double longest_plan = 1.02, shortest_plan = 0.75;

    FIRN_HOST_DEVICE ChosenStep stable(StepBounds now) const
    {
        now.acceleration = max(now.acceleration, acceleration);
        now.obstacle_speed = max(now.obstacle_speed, obstacle_speed);
        return stable_time_step(control, now, cell_size, limits[static_cast<std::size_t>(now.material)]);
    }

    /// Takes account of the fastest wave [m/s] in a material: the one that bounds the step most is kept.
    FIRN_HOST_DEVICE void admit(StepBounds& bounds, int material, double wave_speed) const
    {
        auto const longest = [&](int of, double speed) {
            return stable_for_material(control, speed, cell_size, limits[static_cast<std::size_t>(of)]).dt;
        };
        if (material == bounds.material)
            bounds.wave_speed = max(bounds.wave_speed, wave_speed);
        else if (longest(material, wave_speed) < longest(bounds.material, bounds.wave_speed)) {
            bounds.wave_speed = wave_speed;
            bounds.material = material;
        }
    }

    /// Chooses the step that begins now, and plans the one after it. False if it is not that for which
    /// particles have given.
    FIRN_HOST_DEVICE bool choose(TimeState& time_state) const
    {
        ChosenStep const longest_now = stable(time_state.bounds);
        time_state.stable = longest_now.dt;
        auto const forces = [&](PlannedStep const& step, double before, int retries) {
            return retries > 0 ? step.interval.length()
                               : time_of_forces(step.interval.length(), before, longest_now.dt);
        };
        if (equal > 0) { // who takes equal steps is expected to go on so
            time_state.now = {{time_state.time, time_state.time + equal}, StepLimit::duration};
            time_state.now.interval.forces = forces(time_state.now, time_state.last, 0);
            time_state.next = {{time_state.now.interval.end, time_state.now.interval.end + equal},
                               StepLimit::duration};
            time_state.next.interval.forces = forces(time_state.next, time_state.now.interval.length(), 0);
            return exactly_equal(time_state.scattered.interval.forces, time_state.now.interval.forces);
        }
        PlannedStep best = plan(longest_now, time_state.time, end, time_state.previous, time_state.retries);
        best.interval.forces = forces(best, time_state.last, time_state.retries);
        double const planned = time_state.scattered.interval.length(), longest = best.interval.length();
        bool const fits = planned > 0 &&
                          exactly_equal(time_state.scattered.interval.begin, time_state.time) &&
                          time_state.scattered.interval.end <= end && planned <= longest_plan * longest &&
                          planned >= shortest_plan * longest && time_state.retries == 0;
        time_state.now = fits ? time_state.scattered : best;
        // the one after it, as far as it can be told from the state before this one
        double const next_end = time_state.now.interval.end < end ? end : end + duration;
        double const previous =
            time_state.now.limit != StepLimit::duration ? time_state.now.longest : time_state.previous;
        time_state.next = plan(longest_now, time_state.now.interval.end, next_end, previous, 0);
        time_state.next.interval.forces = forces(time_state.next, time_state.now.interval.length(), 0);
        return fits;
    }

    /// Whether the step that was chosen gets on.
    FIRN_HOST_DEVICE bool gets_on(TimeState const& time_state) const
    {
        return time_state.now.interval.length() > control.smallest * duration &&
               time_state.now.interval.end > time_state.time;
    }

    /// Whether there is something left to do.
    FIRN_HOST_DEVICE bool goes_on(TimeState const& time_state) const
    {
        return equal > 0 || time_state.time < end;
    }

    /// Goes to the end of the step that was taken, whose bounds were found.
    FIRN_HOST_DEVICE static void finish(TimeState& time_state, StepBounds const& found)
    {
        time_state.time = time_state.now.interval.end;
        time_state.bounds = found.finite();
        time_state.last = time_state.now.interval.length();
        if (time_state.retries > 0)
            time_state.previous = time_state.last;
        else if (time_state.now.limit != StepLimit::duration)
            time_state.previous = time_state.now.longest;
        time_state.retries = 0;
        time_state.scattered = time_state.next;
    }

    /// For how long forces act in a step of a length, behind one of another; 0: behind none [s].
    ///
    /// Velocities belong to the middles of steps, positions to their ends: of a force at the end of a step
    /// they get half of that step and half of the next one. Were it all of the next one, a length that
    /// changes would bring an error of first order, the sum of force times half of each change. It is no
    /// longer than a plan may be, so that a step is stable behind one that was far longer.
    FIRN_HOST_DEVICE static double time_of_forces(double length, double before, double stable)
    {
        if (exactly_equal(before, 0)) return length;
        return min(0.5 * (before + length), longest_plan * max(length, stable));
    }

private:
    /// A step from `begin` that is as long as is stable, not much longer than the one before, and a whole
    /// share of what remains before `until`; after `retries` failures, half as long each time.
    FIRN_HOST_DEVICE PlannedStep plan(ChosenStep step, double begin, double until, double previous,
                                      int retries) const
    {
        double const remaining = until - begin;
        if (previous > 0) step.bound(control.growth * previous, StepLimit::growth);
        double const longest = step.dt;
        bool const last = longest >= remaining && retries == 0;
        if (longest >= remaining)
            step = {remaining, StepLimit::duration};
        else
            step.dt = remaining / std::ceil(remaining / longest);
        // half of what was tried, also where that was all that remained
        for (int i = 0; i < retries; ++i) step.dt /= 2;
        return {{begin, last ? until : begin + step.dt}, step.limit, longest};
    }
};

} // namespace firn
