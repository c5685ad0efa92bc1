// SPDX-License-Identifier: MIT
#pragma once

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

} // namespace firn
