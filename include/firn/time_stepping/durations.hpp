// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/time_stepping/report.hpp>

#include <cstddef>
#include <limits>
#include <new>
#include <vector>

// Checks the times that a caller asks for. `time` is the solver's own [s], `Number` is its precision.
namespace firn::detail
{

/// Refuses a time [s] that would be lost to rounding: a program that passed such times in a loop would never
/// end.
template <class Number>
void require_to_last(double time, double duration, char const* where)
{
    require(time + duration > time && static_cast<Number>(duration) >= std::numeric_limits<Number>::min(),
            "the time is too short: beside the solver's own, or in its precision, it is none", where,
            "Pass a longer one.");
    require(is_finite(time + duration),
            "the time is too long: with the solver's own it is beyond all numbers", where,
            "Pass a shorter one.");
}

/// Refuses a number of steps, or their length [s], that cannot be taken.
template <class Number>
void validate_steps(double time, std::size_t count, double dt)
{
    require(is_finite(dt) && dt > 0, "the time step is not a finite number above 0", "Solver::step",
            "Pass seconds.");
    require(count <= std::vector<StepReport>().max_size(),
            "the number of steps is below 0, or beyond what memory has room to report", "Solver::steps",
            "Pass how many there are to be, 0 or above.");
    require_to_last<Number>(time, dt, "Solver::step");
    require(is_finite(time + double(count) * dt), "the steps end beyond all numbers", "Solver::steps",
            "Pass fewer or shorter ones.");
}

/// An empty list with room for the reports of so many steps.
inline std::vector<StepReport> room_for_reports(std::size_t count)
{
    std::vector<StepReport> reports;
    try {
        reports.reserve(count);
    }
    catch (std::bad_alloc const&) {
        throw Error{"there is not enough memory for the reports of so many steps", "Solver::steps",
                    "Take fewer in one call."};
    }
    return reports;
}

/// Refuses a duration [s] that time cannot advance by.
template <class Number>
void validate_duration(double time, double duration)
{
    require(is_finite(duration) && duration >= 0, "the duration is not a finite number, 0 or above",
            "Solver::advance", "Pass seconds, e.g. 1.0 / 24.");
    if (duration > 0) require_to_last<Number>(time, duration, "Solver::advance");
}

} // namespace firn::detail
