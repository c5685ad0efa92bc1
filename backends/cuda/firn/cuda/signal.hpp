// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// How queued loops stop the loops behind them and tell the host why.
namespace firn::cuda::detail
{

/// What the host is told when loops have stopped.
struct Stop
{
    std::uint32_t stopped; ///< 1; the host clears it
    std::uint32_t leavers; ///< if more than there is room for, the others were not listed
    std::uint32_t births;  ///< blocks that were requested and do not exist
    std::uint32_t crowded; ///< whether many blocks hold no items
};

/// What loops tell the host while it queues more.
struct Told
{
    Stop stop;
    std::uint32_t chosen; ///< the last loop that finished a step early
};

/// What a loop calls first that is launched by launch_behind(): waits for the loop before, and lets the next
/// one launch.
__device__ inline void wait_for_the_loop_before()
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    cudaTriggerProgrammaticLaunchCompletion();
    cudaGridDependencySynchronize();
#endif
}

/// Tells queued loops whether they have work to do: each asks first. A loop that finds that the ones behind
/// it must not run stops them, and the host resolves it.
struct Signal
{
    /// [0] whether a loop has stopped those behind it; [1] the number of the early-finishing loop that
    /// stopped those behind it; [2] how many thread groups of end_step are through; [3] what its call of
    /// `finish` returned.
    std::uint32_t* words;
    static constexpr std::size_t count = 4;
    Told* told; ///< in host memory

    /// The state of the signal before a loop.
    struct Heard
    {
        std::uint32_t stopped, by;
        /// A loop that finishes a step early has a number; it ignores a stop that bears its own.
        __device__ bool stops(std::uint32_t number = 0) const
        {
            return stopped != 0 || (by != 0 && by != number);
        }
    };

    /// Every loop calls this first. It waits for the loop before (see launch_behind), lets the next one
    /// launch, and loads the signal. Loads that a loop issues before it looks at the answer overlap with this
    /// one.
    __device__ Heard hear() const
    {
        wait_for_the_loop_before();
        return {words[0], words[1]};
    }
    __device__ bool stops(std::uint32_t number = 0) const { return hear().stops(number); }
    /// Stops the loops behind.
    __device__ void stop(Stop const& why) const
    {
        words[0] = 1;
        told->stop = why;
    }
    /// Stops the loops behind the loop with this number.
    __device__ void stop_behind(std::uint32_t number, Stop const& why) const
    {
        words[1] = number;
        told->stop = why;
    }
    /// Says that the loop with this number has finished its step.
    __device__ void has_chosen(std::uint32_t number) const
    {
        *static_cast<std::uint32_t volatile*>(&told->chosen) = number;
    }
};

} // namespace firn::cuda::detail
