// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <chrono>
#include <cstring>
#include <sys/resource.h>
#include <vector>

// What the machine can do, measured in the run whose speeds are compared with it.
namespace firn::bench
{

/// The processor time this program has spent outside the kernel, all threads together [s].
inline double user_seconds()
{
    rusage used{};
    getrusage(RUSAGE_SELF, &used);
    return double(used.ru_utime.tv_sec) + 1e-6 * double(used.ru_utime.tv_usec);
}

/// Bytes read and written per second by one thread that copies 256 MB; the best of five.
inline double copy_bandwidth()
{
    static double const best = [] {
        std::vector<char> from(256 << 20, 1), to(256 << 20, 2);
        double shortest = 1e9;
        for (int i = 0; i < 5; ++i) {
            auto const start = std::chrono::steady_clock::now();
            std::memcpy(to.data(), from.data(), from.size());
            std::chrono::duration<double> const took = std::chrono::steady_clock::now() - start;
            shortest = std::min(shortest, took.count());
            from[i] = to[from.size() - 1 - i];
        }
        return 2 * double(from.size()) / shortest;
    }();
    return best;
}

} // namespace firn::bench
