// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/failure_cause.hpp>
#include <firn/core/host_device.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <cstddef>

// What the solve of an implicit step writes to the log of steps, where loops run.
namespace firn
{

/// Logs that a step was not solved, or not as accurately as it should: it failed, as if a particle had.
template <class Entry>
struct LogUnsolved
{
    Entry* log;
    int step;
    FailureCause cause;

    FIRN_HOST_DEVICE void operator()(std::size_t) const
    {
        Entry& mine = log[step + 1];
        mine.after.time_state = log[step].after.time_state;
        mine.after.time_state.ready = false;
        mine.after.cause = cause;
        mine.after.failed = 1;
        mine.after.material = 0;
        mine.after.particle = 0;
        mine.taken = 0;
    }
};

/// Notes how long the next step may be, by the error of one that is being taken, and by its linear systems.
template <class Entry>
struct NoteLongest
{
    Entry* log;
    int step;
    ChosenStep longest;

    FIRN_HOST_DEVICE void operator()(std::size_t) const { log[step].after.time_state.solvable = longest; }
};

} // namespace firn
