// SPDX-License-Identifier: MIT
#pragma once

namespace firn
{

/// What phases know of the step that they take. It lies where they run, for it is found there when the step
/// before is through (see FinishStep), and the phases may be queued before.
template <class Number, class Actions>
struct StepContext
{
    Number dt;          ///< [s]
    Number forces;      ///< for how long they act in it [s]
    Number next_forces; ///< for how long stresses act in the step after this one [s]
    Actions actions;    ///< of the effects
};

} // namespace firn
