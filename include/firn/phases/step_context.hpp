// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <cstddef>

namespace firn
{

/// The values of a step that its phases read. They lie where the phases run, because they are computed there
/// at the end of the step before (see FinishStep), when the phases may be queued already.
template <class Number, class Actions>
struct StepContext
{
    Number dt;          ///< [s]
    Number forces;      ///< for how long forces act in it [s]
    Number next_forces; ///< for how long stresses act in the step after this one [s]
    Actions actions;    ///< of the effects
};

/// Stores the context of a step without effects that takes no time.
template <class Context>
struct ClearContext
{
    Context* to;

    FIRN_HOST_DEVICE void operator()(std::size_t) const { *to = Context{}; }
};

} // namespace firn
