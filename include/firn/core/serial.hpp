// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace firn
{

/// Runs independent work one piece after the other: the loop for callers that pass no backend.
struct Serial
{
    /// Calls `body(i)` once for every i in [0, count); a backend's loop does so in any order and at the same
    /// time.
    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        for (std::size_t i = 0; i < count; ++i) body(i);
    }
};

} // namespace firn
