// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp.hpp>

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

/// Operations per second of one thread that does nothing but a * b + c on the lanes of the backend, two
/// operations each; the best of five.
template <class Number>
double multiply_add_peak()
{
    static double const best = [] {
        using Lane = openmp::NativeLane<Number>;
        constexpr int chains = 12, rounds = 1 << 20; // as many as hide the latency
        double shortest = 1e9;
        for (int i = 0; i < 5; ++i) {
            Lane sum[chains];
            for (int c = 0; c < chains; ++c) sum[c] = Lane(Number(c));
            Lane const a(Number(0.999)), b(Number(1e-3) * Number(i));
            auto const start = std::chrono::steady_clock::now();
            for (int r = 0; r < rounds; ++r) {
                FIRN_UNROLL
                for (int c = 0; c < chains; ++c) sum[c] = sum[c] * a + b;
            }
            std::chrono::duration<double> const took = std::chrono::steady_clock::now() - start;
            for (int c = 1; c < chains; ++c) sum[0] += sum[c];
            volatile Number const used = largest(sum[0]); // or all of it could be left out
            static_cast<void>(used);
            shortest = std::min(shortest, took.count());
        }
        return 2.0 * chains * rounds * lane_width<Lane> / shortest;
    }();
    return best;
}

} // namespace firn::bench
