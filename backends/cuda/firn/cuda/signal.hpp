// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// How loops that are queued stop those behind them, and tell the host why.
namespace firn::cuda::detail
{

/// What the host is told when loops have stopped.
struct Stop
{
    std::uint32_t stopped;  ///< 1; the host clears it
    std::uint32_t departed; ///< items; more than there is room for: the others were not noted
    std::uint32_t births;   ///< blocks that are wanted and not there
    std::uint32_t crowded;  ///< whether there are many blocks without items
};

/// What loops tell the host while they are queued.
struct Told
{
    Stop stop;
    std::uint32_t chosen; ///< the last loop that concluded while it was at work
};

/// Whether loops that are queued have something to do: each asks first. Where one finds that those after it
/// have not, it stops them, and the host will look after it.
struct Signal
{
    /// Whether a loop has stopped those behind it; which of those that conclude while they are at work; and
    /// how many groups of threads of the one that only ends a step are through, and what it concluded.
    std::uint32_t* words;
    static constexpr std::size_t count = 4;
    Told* told; ///< in memory of the host

    /// What was said before a loop.
    struct Heard
    {
        std::uint32_t stopped, by;
        /// One that concludes while it is at work is stopped by the others only: it has a number.
        __device__ bool stops(std::uint32_t number = 0) const
        {
            return stopped != 0 || (by != 0 && by != number);
        }
    };

    /// The first thing that a loop does: waits for the loop before (see launch_behind), lets the next one be
    /// made ready, and asks. What else it asks for before it looks at the answer comes as soon.
    __device__ Heard hear() const
    {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
        cudaTriggerProgrammaticLaunchCompletion();
        cudaGridDependencySynchronize();
#endif
        return {words[0], words[1]};
    }
    __device__ bool stops(std::uint32_t number = 0) const { return hear().stops(number); }
    /// Stops the loops behind.
    __device__ void stop(Stop const& why) const
    {
        words[0] = 1;
        told->stop = why;
    }
    /// Stops the loops behind the one with this number.
    __device__ void stop_behind(std::uint32_t number, Stop const& why) const
    {
        words[1] = number;
        told->stop = why;
    }
    /// Says that the loop with this number concluded.
    __device__ void has_chosen(std::uint32_t number) const
    {
        *static_cast<std::uint32_t volatile*>(&told->chosen) = number;
    }
};

} // namespace firn::cuda::detail
