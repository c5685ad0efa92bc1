// SPDX-License-Identifier: MIT
#pragma once

namespace firn
{

/// How a batch of queued steps ended.
struct QueueOutcome
{
    int queued = 0;              ///< steps, the last of which is not committed yet
    bool lacked_room = false;    ///< a step had to be repeated with more room, and those behind it dropped
    bool rebinned_early = false; ///< the step that was not taken has been rebinned, and its leavers scattered
};

} // namespace firn
