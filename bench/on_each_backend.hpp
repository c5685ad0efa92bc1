// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>
#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#else
#include <firn/openmp.hpp>
#endif

#include <chrono>

// What benchmarks share that are compiled for a processor and, from the same file, for a device.
namespace firn::bench
{

#if defined(__CUDACC__)
using Backend = Cuda;
inline constexpr bool on_a_device = true;
inline Backend backend() { return {}; }
#else
using Backend = OpenMP;
inline constexpr bool on_a_device = false;
/// One thread, which is what results are compared by.
inline Backend backend() { return {.threads = 1}; }
#endif

/// Seconds per step of a call of ten steps.
template <class Solver, class... Effects>
double seconds_per_step(Solver& solver, double dt, Effects const&... effects)
{
    auto const start = std::chrono::steady_clock::now();
    solver.steps(10, dt, Gravity{}, effects...);
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / 10;
}

} // namespace firn::bench
