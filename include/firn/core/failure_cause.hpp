// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace firn
{

/// What may happen to a particle or a step. Nothing else does, and all of it is reported.
enum class FailureCause : std::uint8_t
{
    none,
    lost,       ///< a particle vanished from the table
    escaped,    ///< a particle left the range of cell coordinates
    inverted,   ///< det F <= 0 where the model has no stress for it
    capped,     ///< a model's state reached a stated cap (a warning: the step stands)
    not_finite, ///< NaN or infinity in a particle's state or stress
    rejected,   ///< a particle moved by a cell, or deformed by more than the step's limit
    stalled,    ///< no step that is stable for a particle advances time
    overflowed, ///< an obstacle would receive more than its reaction can hold
    unsolved,   ///< an implicit step did not converge; the particle is near its largest residual
    inaccurate, ///< an implicit step has an error beyond Implicit::error; the particle is near the largest
                ///< one
};

/// The failure in words.
constexpr char const* describe(FailureCause cause)
{
    switch (cause) {
    case FailureCause::none:
        return "nothing happened";
    case FailureCause::lost:
        return "was lost";
    case FailureCause::escaped:
        return "left the range of cell coordinates";
    case FailureCause::inverted:
        return "was turned inside out (det F <= 0)";
    case FailureCause::capped:
        return "reached a cap of its model";
    case FailureCause::not_finite:
        return "has a state that is not finite";
    case FailureCause::rejected:
        return "moved by a cell or more, or deformed by more than a step may";
    case FailureCause::stalled:
        return "is too fast, or its waves are, for any time step that makes progress";
    case FailureCause::overflowed:
        return "pushes an obstacle by an impulse that is too large to be added up";
    case FailureCause::unsolved:
        return "is where an implicit step did not converge";
    case FailureCause::inaccurate:
        return "is where an implicit step has its largest error, which is more than was allowed";
    }
    return "";
}

} // namespace firn
