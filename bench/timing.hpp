// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <ctime>
#include <vector>

namespace firn::bench
{

/// The processor time of this program, all threads together [s].
inline double processor_seconds()
{
    timespec used{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
    return double(used.tv_sec) + 1e-9 * double(used.tv_nsec);
}

/// The upper one of two in the middle where their number is even.
inline double median(std::vector<double> of)
{
    std::sort(of.begin(), of.end());
    return of[of.size() / 2];
}

} // namespace firn::bench
