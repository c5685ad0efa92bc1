// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

// For each thread, the sum of a value over the threads before it: in a warp, or in a whole group.
namespace firn::cuda::detail
{

/// In groups of threads that scan a whole list by themselves.
inline constexpr int scanning_threads = 512;

/// The sum of a value over the warp's lanes before this one; `total` becomes the sum over all.
__device__ inline std::uint64_t sum_before(std::uint64_t value, std::uint64_t& total)
{
    int const lane = static_cast<int>(threadIdx.x % 32);
    std::uint64_t sum = value;
    for (int step = 1; step < 32; step *= 2) {
        std::uint64_t const other = __shfl_up_sync(~0u, sum, step);
        if (lane >= step) sum += other;
    }
    total = __shfl_sync(~0u, sum, 31);
    return sum - value;
}

/// The same over the first `threads` threads of a group. Each further set of that many holds the same values
/// and gets the same sums.
template <int threads>
__device__ std::uint64_t sum_before_in_block(std::uint64_t value, std::uint64_t& total)
{
    __shared__ std::uint64_t of_warp[threads / 32];
    std::uint64_t of_mine;
    std::uint64_t before = sum_before(value, of_mine);
    if (threadIdx.x < threads && threadIdx.x % 32 == 31) of_warp[threadIdx.x / 32] = of_mine;
    __syncthreads();
    total = 0;
    for (unsigned w = 0; w < threads / 32; ++w) {
        if (w < threadIdx.x % threads / 32) before += of_warp[w];
        total += of_warp[w];
    }
    __syncthreads();
    return before;
}

} // namespace firn::cuda::detail
