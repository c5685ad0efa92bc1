// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/cuda/check.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <map>
#include <mutex>
#include <string>
#include <utility>

// How many threads share the work on a block of cells, the shared memory that they may use, and how loops
// over blocks are launched with it.
namespace firn::cuda::detail
{

inline constexpr unsigned block_threads = 64; ///< one per cell, and one per node
/// Shared memory that a device grants without a request, and the same less the little that loops declare
/// [bytes].
inline constexpr std::size_t given_shared = 48 * 1024, unasked_shared = 40 * 1024;
/// The most that every device grants, less that too, and the same of those for which the program is compiled
/// [bytes]: 64 KiB at compute capability 7.5, and 99 KiB or more from 8.0 on. Sums are added up chunk by
/// chunk, so it may not depend on the device at hand.
inline constexpr std::size_t least_shared = 60 * 1024, most_shared = [] {
#ifdef __CUDA_ARCH_LIST__
    if (std::min({__CUDA_ARCH_LIST__}) >= 800) return std::size_t(95 * 1024);
#endif
    return least_shared;
}();

/// Where there are few blocks, at most this many teams of `block_threads` rebin one and scatter its incoming
/// items: each every n-th one of a cell.
inline constexpr unsigned most_teams_that_rebin = 4;

/// Lets a loop use this much dynamic shared memory [bytes]. cudaFuncSetAttribute of CUDA 13 forgets the last
/// error. While another library's is there, the runtime is only asked for a loop that is new to the device.
template <class... Parameters>
void allow_shared(Queue const& queue, void (*loop)(Parameters...), std::size_t bytes)
{
    static std::mutex one_at_a_time;
    static std::map<std::pair<int, void (*)(Parameters...)>, std::size_t> allowed;
    std::lock_guard const lock(one_at_a_time);
    std::size_t& most = allowed[{queue.device, loop}];
    if (bytes <= most && cudaPeekAtLastError() != cudaSuccess) return;
    std::size_t const wanted = std::max(bytes, most); // another thread may be about to launch it
    cudaError_t const status =
        cudaFuncSetAttribute(loop, cudaFuncAttributeMaxDynamicSharedMemorySize, static_cast<int>(wanted));
    if (status == cudaErrorInvalidValue) {
        static_cast<void>(cudaGetLastError());
        throw Error{"the device's shared memory is short: " + std::to_string(bytes) +
                        " bytes were needed, beside what a loop declares",
                    "CUDA", "Pass fewer obstacles to a call, or use a device with more shared memory."};
    }
    check(status, "cudaFuncSetAttribute");
    most = wanted;
}

/// Launches a loop over blocks with its shared memory.
template <class... Parameters, class... Arguments>
void launch(char const* name, Queue const& queue, void (*loop)(Parameters...), std::uint32_t blocks,
            unsigned threads, std::size_t shared, Arguments const&... arguments)
{
    if (shared > unasked_shared) allow_shared(queue, loop, shared);
    launch_behind(name, queue, loop, blocks, threads, shared, arguments...);
}

} // namespace firn::cuda::detail
