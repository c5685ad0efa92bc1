// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/effect.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace firn
{

/// A planned step and what bounds its length.
struct PlannedStep
{
    Interval interval{};
    StepLimit limit = StepLimit::duration;
    double longest = 0; ///< its length before rounding to a whole share of the remaining time [s]
};

/// The time state of a batch of steps.
struct TimeState
{
    double time = 0;     ///< [s]
    StepBounds bounds{}; ///< of the step that begins now
    double previous = 0; ///< `longest` of the last step that did not fill a duration alone; its length, if it
                         ///< was retried [s]; 0: none
    double last = 0;     ///< the last step [s]; 0: there was none
    int retries = 0;     ///< failed attempts of the step that begins now
    PlannedStep scattered{}; ///< the step for which particles have scattered already
    PlannedStep now{};       ///< the step to take
    PlannedStep next{};      ///< the step after it, for which they scatter during `now`
    /// The longest step that is as accurate as is asked for, and takes as few linear systems, by what the
    /// last implicit one had of both.
    ChosenStep solvable{};
    bool ready = false; ///< `now` and `next` are up to date, for the same call as the step before
    double stable = 0;  ///< stable length of the step that begins now [s]
};

/// The time step controller of one call: what stays the same from step to step.
template <int materials>
struct TimeStepController
{
    StepControl control{};
    double cell_size = 0;                                        ///< [m]
    std::array<MaterialLimits, std::size_t(materials)> limits{}; ///< of each material
    double acceleration = 0;                                     ///< of the effects [m/s^2]
    double obstacle_speed = 0;                                   ///< of the effects [m/s]
    double field = std::numeric_limits<double>::infinity();      ///< largest step of carried fields [s]
    double duration = 0;                                         ///< of the call [s]
    double end = 0;                                              ///< when it ends [s]
    double equal = 0; ///< length of all steps [s]; 0: they are as long as is stable
    bool cuts =
        true; ///< steps are whole shares of the time that is left; false: all are as long as is stable
    bool forces_act_throughout = false; ///< each step's for its length: implicit ones, at its end
    /// Whether waves and shear bound steps: not implicit ones. Their limits say all the same which material's
    /// wave is kept, for an explicit solver that goes on from the state.
    bool waves_bound = true;

    /// A step planned one step ahead is kept if its length is within these multiples of what the current
    /// bounds allow. StepControl's safety factors have room for the longer one; the shorter one still costs
    /// less than scattering afresh.
    static constexpr double longest_plan = 1.02, shortest_plan = 0.75;

    FIRN_HOST_DEVICE ChosenStep stable(StepBounds now) const
    {
        now.acceleration = max(now.acceleration, acceleration);
        now.obstacle_speed = max(now.obstacle_speed, obstacle_speed);
        MaterialLimits const none{.wave = std::numeric_limits<double>::infinity()};
        ChosenStep step = stable_time_step(
            control, now, cell_size, waves_bound ? limits[static_cast<std::size_t>(now.material)] : none);
        step.bound(control.wave * field, StepLimit::field);
        return step;
    }

    /// Adds the fastest wave [m/s] in a material to the bounds, which keep the wave that bounds the step
    /// most.
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

    /// Chooses the step that begins now, and plans the one after it. Returns false if particles have not
    /// scattered for the chosen step.
    FIRN_HOST_DEVICE bool choose(TimeState& time_state) const
    {
        ChosenStep longest_now = stable(time_state.bounds);
        time_state.stable = longest_now.dt;
        auto const forces = [&](PlannedStep const& step, double before, int retries) {
            return retries > 0 || forces_act_throughout
                       ? step.interval.length()
                       : time_of_forces(step.interval.length(), before, longest_now.dt);
        };
        if (equal > 0) { // expects more steps of this length
            time_state.now = {{time_state.time, time_state.time + equal}, StepLimit::duration, equal};
            time_state.now.interval.forces = forces(time_state.now, time_state.last, 0);
            time_state.next = {{time_state.now.interval.end, time_state.now.interval.end + equal},
                               StepLimit::duration,
                               equal};
            time_state.next.interval.forces = forces(time_state.next, time_state.now.interval.length(), 0);
            return exactly_equal(time_state.scattered.interval.forces, time_state.now.interval.forces);
        }
        longest_now.bound(time_state.solvable.dt, time_state.solvable.limit);
        PlannedStep best = plan(longest_now, time_state.time, end, time_state.previous, time_state.retries);
        best.interval.forces = forces(best, time_state.last, time_state.retries);
        double const planned = time_state.scattered.interval.length(), longest = best.interval.length();
        bool const fits =
            planned > 0 && exactly_equal(time_state.scattered.interval.begin, time_state.time) &&
            (!cuts || reaches(time_state.scattered.interval)) && planned <= longest_plan * longest &&
            planned >= shortest_plan * longest && time_state.retries == 0;
        time_state.now = fits ? time_state.scattered : best;
        // the step after it, predicted from the bounds at the begin of this one
        double const next_end = time_state.now.interval.end < end ? end : end + duration;
        double const previous =
            time_state.now.limit != StepLimit::duration ? time_state.now.longest : time_state.previous;
        time_state.next = plan(longest_now, time_state.now.interval.end, next_end, previous, 0);
        time_state.next.interval.forces = forces(time_state.next, time_state.now.interval.length(), 0);
        return fits;
    }

    /// Whether the chosen step is long enough to advance time.
    FIRN_HOST_DEVICE bool gets_on(TimeState const& time_state) const
    {
        return time_state.now.interval.length() > control.smallest * duration &&
               time_state.now.interval.end > time_state.time;
    }

    /// Whether the chosen step ends in time: one that was not cut may not.
    FIRN_HOST_DEVICE bool fits(TimeState const& time_state) const
    {
        return cuts || time_state.now.interval.end <= end;
    }

    /// Whether time is left.
    FIRN_HOST_DEVICE bool goes_on(TimeState const& time_state) const
    {
        return equal > 0 || time_state.time < end;
    }

    /// Advances to the end of the step taken, which found the bounds `found`.
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

    /// For how long forces act in a step of this length after one of length `before`; 0: after none [s].
    ///
    /// Velocities belong to the middles of steps, positions to their ends. So a force at the end of a step
    /// acts for half of that step and half of the next one. If it acted for all of the next one, changing
    /// lengths would cause an error of first order: the sum of force times half of each change. The time is
    /// limited to what a plan may be, so that a step is stable after one that was far longer.
    FIRN_HOST_DEVICE static double time_of_forces(double length, double before, double stable)
    {
        if (exactly_equal(before, 0)) return length;
        return min(0.5 * (before + length), longest_plan * max(length, stable));
    }

private:
    /// Whether a step ends in time, and not a rounding before the end: in a call that is one step long, that
    /// was planned by the end of the call before.
    FIRN_HOST_DEVICE bool reaches(Interval const& step) const
    {
        double const left = end - step.end;
        return exactly_equal(left, 0) || left > 1e-9 * step.length();
    }

    /// A step from `begin` that is as long as is stable, not much longer than the one before, and with `cuts`
    /// a whole share of the time until `until`. Each of `retries` failures halves it.
    FIRN_HOST_DEVICE PlannedStep plan(ChosenStep step, double begin, double until, double previous,
                                      int retries) const
    {
        double const remaining = until - begin;
        if (previous > 0) step.bound(control.growth * previous, StepLimit::growth);
        double const longest = step.dt;
        bool const ends = longest >= remaining && (cuts || !is_finite(longest)), last = ends && retries == 0;
        if (ends)
            step = {remaining, StepLimit::duration};
        else if (cuts)
            step.dt = remaining / std::ceil(remaining / longest);
        // half of what failed, also where that was all the remaining time
        for (int i = 0; i < retries; ++i) step.dt /= 2;
        return {{begin, last ? until : begin + step.dt}, step.limit, longest};
    }
};

} // namespace firn
