// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/time_stepping/pace.hpp>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>

namespace firn
{

/// How far a call of Solver::advance has come.
struct Progress
{
    double begin = 0;        ///< the solver's time when the call began [s]
    double time = 0;         ///< the solver's time now [s]
    double end = 0;          ///< what it is to be at the end of the call [s]
    std::uint64_t steps = 0; ///< taken by the call
    double seconds = 0;      ///< that the call has run for, by a clock
};

namespace detail
{
class BudgetPace;
}

/// What a call of Solver::advance may spend, and how it is watched and stopped:
///
///     auto const report = solver.advance(frame + owed, Budget{.seconds = 0.010}, gravity, floor);
///     owed = report.left;
///
/// A call that is stopped leaves a scene from which the next one goes on, as after any other call.
struct Budget
{
    /// Seconds by a clock. A step is taken only if it is expected to end in time, by the average of the
    /// call's steps so far; the first one is always taken, unless this is 0, and a step that fails is
    /// repeated until it succeeds. On a backend that queues steps the host waits for the first one, and then
    /// for groups that at most double.
    double seconds = std::numeric_limits<double>::infinity();
    /// The most steps of a call.
    std::uint64_t steps = std::numeric_limits<std::uint64_t>::max();
    /// Whether the last steps are shortened so that the call ends exactly with its duration. Where it is
    /// false, what is shorter than a step is left for the next call, so that calls of any length take no more
    /// steps than one long call does: pass all of `left` with the next one. The solver's time is then behind
    /// by less than a step. A step that may be of any length is cut all the same.
    ///
    /// Where it is true a call takes its duration over the stable step, rounded up: two steps for a call of
    /// 1.1. Sixteen calls to a frame of 15 to 40 steps take 1.1 to 1.4 times as many in all, and 64 up to 4.3
    /// times (REAL_TIME.md).
    bool cut_last_step = true;
    /// Called after each step, or on a backend that queues steps after each group of them. It does not call
    /// the solver, of which a step is under way: a call that changes it or copies from it is an Error, as
    /// from `cancelled`. What it throws leaves advance(), after which Solver::until_error() has the report.
    std::function<void(Progress const&)> progress{};
    /// Asked before each step or group: the call stops where it returns true. For a flag that another part of
    /// the program sets, read it here.
    std::function<bool()> cancelled{};
    /// The longest time between two calls of them by a clock [s], where steps are queued: a group takes as
    /// long by the average of the call's steps.
    double respond_within = 0.02;

    /// Throws an Error if a number is out of its range.
    void validate() const
    {
        require(seconds >= 0, "the budget's seconds are below 0 or not a number", "Solver::advance",
                "Pass seconds, 0 or above, or infinity.");
        require(is_number(respond_within) && respond_within > 0, "respond_within is not above 0",
                "Solver::advance", "Pass seconds, e.g. 0.02.");
    }

    /// What keeps to the budget during a call.
    using Pace = detail::BudgetPace;
};

namespace detail
{
/// Keeps to a budget during one call; see FullPace for the members.
class BudgetPace
{
    using Clock = std::chrono::steady_clock;

public:
    BudgetPace(Budget const& budget, double time)
        : budget_(budget), is_watched_(budget.progress || budget.cancelled),
          is_timed_(is_watched_ || is_finite(budget.seconds)), simulated_(time)
    {
        if (is_timed_) began_ = Clock::now();
    }

    bool cuts_last_step() const { return budget_.cut_last_step; }
    StoppedBy stopped_by() const { return stopped_by_; }

    std::size_t steps_allowed(AdvanceReport const& so_far)
    {
        if (budget_.cancelled && budget_.cancelled()) return stop(StoppedBy::cancel);
        std::uint64_t allowed = budget_.steps - std::min(budget_.steps, so_far.substeps);
        if (allowed == 0) return stop(StoppedBy::steps);
        if (is_timed_) {
            double const now = seconds();
            double const attempts = double(so_far.substeps + so_far.rejected);
            double const a_step = attempts > 0 ? now / attempts : 0;
            if (budget_.seconds <= 0 || (attempts > 0 && now + a_step > budget_.seconds))
                return stop(StoppedBy::seconds);
            double group = 1; // nothing is known of the first one
            if (attempts > 0) {
                group = (budget_.seconds - now) / a_step;
                if (is_watched_) group = std::min(group, budget_.respond_within / a_step);
                // what is known of few steps says little of many: the first ones have more to prepare
                group = std::min(group, attempts);
            }
            if (group < double(allowed)) allowed = std::max<std::uint64_t>(std::uint64_t(group), 1);
        }
        return static_cast<std::size_t>(
            std::min<std::uint64_t>(allowed, std::numeric_limits<std::size_t>::max()));
    }

    void tell(double time, double end, AdvanceReport const& so_far) const
    {
        if (budget_.progress) budget_.progress({simulated_, time, end, so_far.substeps, seconds()});
    }

private:
    double seconds() const { return std::chrono::duration<double>(Clock::now() - began_).count(); }

    std::size_t stop(StoppedBy why)
    {
        stopped_by_ = why;
        return 0;
    }

    Budget const& budget_;
    bool is_watched_, is_timed_;
    double simulated_; ///< the solver's time at the begin
    Clock::time_point began_{};
    StoppedBy stopped_by_ = StoppedBy::nothing;
};
} // namespace detail

} // namespace firn
