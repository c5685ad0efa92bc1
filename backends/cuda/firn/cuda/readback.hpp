// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/signal.hpp>

#include <cstddef>
#include <cstdint>

namespace firn::cuda
{

namespace detail
{
/// A value as words. Copies padding too, and shuffles take nothing larger than a word.
template <class T>
struct Words
{
    static_assert(sizeof(T) % sizeof(std::uint32_t) ==
                  0); // plain values, although Eigen's types are not trivially copyable
    static constexpr int count = sizeof(T) / sizeof(std::uint32_t);
    std::uint32_t of[count];
};

template <class T>
__device__ void store_words(T const& value, T* to)
{
    Words<T> words{};
    memcpy(&words, static_cast<void const*>(&value), sizeof words);
#pragma unroll
    for (int i = 0; i < Words<T>::count; ++i) reinterpret_cast<std::uint32_t*>(to)[i] = words.of[i];
}

/// Loads what another group of threads stored, bypassing this multiprocessor's cache.
template <class T>
__device__ T load_words(T const* from)
{
    Words<T> words;
#pragma unroll
    for (int i = 0; i < Words<T>::count; ++i)
        words.of[i] = __ldcg(reinterpret_cast<std::uint32_t const*>(from) + i);
    T value;
    memcpy(static_cast<void*>(&value), &words, sizeof words);
    return value;
}

/// Loads what a thread of this group stored in shared memory.
template <class T>
__device__ T load_shared(T const* from)
{
    Words<T> words;
#pragma unroll
    for (int i = 0; i < Words<T>::count; ++i) words.of[i] = reinterpret_cast<std::uint32_t const*>(from)[i];
    T value;
    memcpy(static_cast<void*>(&value), &words, sizeof words);
    return value;
}

/// Merges the results of a warp's lanes in their order; valid in lane 0.
template <class Result>
__device__ Result merged_in_warp(Result result)
{
#pragma unroll 1
    for (int step = 1; step < 32; step *= 2) {
        Words<Result> words;
        memcpy(&words, static_cast<void const*>(&result), sizeof words);
#pragma unroll
        for (int i = 0; i < Words<Result>::count; ++i)
            words.of[i] = __shfl_down_sync(~0u, words.of[i], static_cast<unsigned>(step));
        Result other;
        memcpy(static_cast<void*>(&other), &words, sizeof words);
        result.merge(other);
    }
    return result;
}

/// Where the groups of threads of a loop store their results. If there are many groups, the last one of each
/// bunch merges those of the bunch, so that few are left for the loop that finishes the step. The order of
/// merging is fixed.
template <class Result>
struct ResultsOfGroups
{
    Result *of_groups, *of_bunches; ///< the same array where a bunch is one group
    std::uint32_t* finished;        ///< per bunch: how many groups are through; behind that, of all of them
    std::uint32_t groups, bunch;

    __host__ __device__ std::uint32_t bunches() const { return (groups + bunch - 1) / bunch; }
    /// How many groups a bunch has.
    __device__ std::uint32_t size(std::uint32_t b) const
    {
        std::uint32_t const behind = groups - b * bunch;
        return bunch < behind ? bunch : behind;
    }

    /// Merges the results of a bunch on one warp.
    __device__ void merge_bunch(std::uint32_t b) const
    {
        std::uint32_t const lane = threadIdx.x % 32, in_bunch = size(b);
        Result of_bunch{};
#pragma unroll 1
        for (std::uint32_t i = lane * in_bunch / 32; i < (lane + 1) * in_bunch / 32; ++i)
            of_bunch.merge(load_words(of_groups + b * bunch + i));
        of_bunch = merged_in_warp(of_bunch);
        if (lane == 0) store_words(of_bunch, of_bunches + b);
    }

    /// Called by all threads of a group with their results; `memory` is shared memory for all of these. Each
    /// lane of one warp merges those of every 32nd thread.
    __device__ void take_in(Result const& of_thread, std::uint32_t* memory, std::uint32_t group) const
    {
        Words<Result> words{};
        memcpy(&words, static_cast<void const*>(&of_thread), sizeof words);
#pragma unroll
        for (int i = 0; i < Words<Result>::count; ++i)
            memory[i * int(blockDim.x) + int(threadIdx.x)] = words.of[i];
        __syncthreads();
        if (threadIdx.x >= 32) return;
        Result mine = of_thread;
#pragma unroll 1
        for (unsigned thread = threadIdx.x + 32; thread < blockDim.x; thread += 32) {
#pragma unroll
            for (int i = 0; i < Words<Result>::count; ++i)
                words.of[i] = memory[i * int(blockDim.x) + int(thread)];
            Result other;
            memcpy(static_cast<void*>(&other), &words, sizeof words);
            mine.merge(other);
        }
        finish(mine, group);
    }

    /// Called by all threads of a group with their results; `parts` is shared memory for one value per warp.
    __device__ void take(Result const& of_thread, Result* parts, std::uint32_t group) const
    {
        std::uint32_t const warp = threadIdx.x / 32, lane = threadIdx.x % 32, warps = blockDim.x / 32;
        Result mine = merged_in_warp(of_thread);
        if (lane == 0) store_words(mine, parts + warp);
        __syncthreads();
        if (warp > 0) return;
        finish(lane < warps ? load_shared(parts + lane) : Result{}, group);
    }

    /// Called by a group's first warp once its results are stored: whether those of all groups are.
    __device__ bool are_complete() const { return is_last(finished + bunches(), groups); }

private:
    /// Called by one warp with what its lanes have of the group's results.
    __device__ void finish(Result const& of_lane, std::uint32_t group) const
    {
        std::uint32_t const lane = threadIdx.x % 32;
        Result const mine = merged_in_warp(of_lane);
        if (lane == 0) store_words(mine, of_groups + group);
        if (bunch == 1) return;
        std::uint32_t const b = group / bunch;
        if (!is_last(finished + b, size(b))) return;
        merge_bunch(b);
    }

    /// Whether this warp is the last of `of` to come here; if so, resets the count.
    __device__ static bool is_last(std::uint32_t* count, std::uint32_t of)
    {
        std::uint32_t before = 0;
        if (threadIdx.x % 32 == 0) {
            __threadfence();
            before = atomicAdd(count, 1u);
            if (before + 1 == of) *count = 0;
            __threadfence();
        }
        return __shfl_sync(~0u, before, 0) + 1 == of;
    }
};
} // namespace detail

/// What a loop found, to be merged by a later one; empty if no loop ran.
template <class Result>
struct Partial
{
    Result const* of;
    std::uint32_t count;
    std::uint32_t const* held = nullptr; ///< on the device: how many of them are not empty; null: all may be

    /// Merges them in a fixed order on `warps` consecutive warps, of which this is number `warp`; each leaves
    /// its part in `parts`.
    __device__ void merge(std::uint32_t warp, std::uint32_t warps, Result* parts) const
    {
        std::uint32_t const thread = warp * 32 + threadIdx.x % 32, threads = warps * 32,
                            each = (count + threads - 1) / threads, all = held == nullptr ? count : *held;
        Result mine{};
#pragma unroll 1
        for (std::uint32_t i = thread * each; i < (thread + 1) * each && i < all; ++i)
            mine.merge(detail::load_words(of + i));
        mine = detail::merged_in_warp(mine);
        if (threadIdx.x % 32 == 0) detail::store_words(mine, parts + warp);
    }
    /// Merges the parts of all warps on one warp; valid in its lane 0.
    __device__ static Result whole(Result const* parts, std::uint32_t warps)
    {
        std::uint32_t const lane = threadIdx.x % 32;
        return detail::merged_in_warp(lane < warps ? detail::load_shared(parts + lane) : Result{});
    }
};

namespace detail
{
inline constexpr std::uint32_t merging_warps = 8;

/// Called by all threads of a group: merges what a loop found, and calls a function object with it. The order
/// of merging is the same for any number of threads. `parts` is shared memory for as many as `merging_warps`.
template <class Result, class Body>
__device__ void merge_in_group(Partial<Result> const& of, Result* parts, Body const& body)
{
    std::uint32_t const warp = threadIdx.x / 32, warps = blockDim.x / 32;
#pragma unroll 1
    for (std::uint32_t i = warp; i < merging_warps; i += warps) of.merge(i, merging_warps, parts);
    __syncthreads();
    if (warp > 0) return;
    Result const all = Partial<Result>::whole(parts, merging_warps);
    if (threadIdx.x == 0) body(all);
}

/// Merges what a loop found, and calls a function object with it.
template <class Result, class Body>
__global__ void __launch_bounds__(merging_warps * 32) merge_and_call(Partial<Result> of, Body body)
{
    __shared__ __align__(16) unsigned char parts[merging_warps * sizeof(Result)];
    wait_for_the_loop_before();
    merge_in_group(of, reinterpret_cast<Result*>(parts), body);
}

/// For loops behind which nothing is called.
struct NothingBehind
{};

/// Called by all threads of each group of a loop once they have stored their results: those of the last one
/// merge all, and call a function object with that.
template <class Result, class Body>
__device__ void call_behind(ResultsOfGroups<Result> const& results, Body const& body)
{
    __shared__ __align__(16) unsigned char parts[merging_warps * sizeof(Result)];
    __shared__ bool are_complete;
    if (threadIdx.x < 32) {
        bool const complete = results.are_complete();
        if (threadIdx.x == 0) are_complete = complete;
    }
    __syncthreads();
    if (!are_complete) return;
    merge_in_group(Partial<Result>{results.of_bunches, results.bunches()}, reinterpret_cast<Result*>(parts),
                   body);
}
} // namespace detail

/// The results of a loop's groups of threads.
class Results
{
public:
    static constexpr std::uint32_t most_bunches = 1024;

    explicit Results(Queue const& queue) : queue_(queue), partial_(queue), finished_(queue) {}

    /// From now on loops leave the results of each group by themselves: they are to be merged with those of
    /// other devices, see ResultsOfDevices.
    void keep_apart() { are_apart_ = true; }

    /// Room for the results of this many groups of threads.
    template <class Result>
    detail::ResultsOfGroups<Result> expect(std::uint32_t groups)
    {
        detail::ResultsOfGroups<Result> results{};
        results.groups = groups;
        results.bunch = are_apart_ ? 1 : (groups + most_bunches - 1) / most_bunches;
        std::uint32_t const bunches = results.bunches(), more = results.bunch == 1 ? 0 : bunches;
        if (std::size_t const bytes = (std::size_t(groups) + more) * sizeof(Result); partial_.size() < bytes)
            partial_.renew(bytes + (are_apart_ ? bytes / 8 : 0)); // all devices wait while one allocates
        if (finished_.size() < bunches + 1) {
            finished_.renew(bunches + 1);
            finished_.fill_bytes(0, finished_.size(), 0);
        }
        results.of_groups = reinterpret_cast<Result*>(partial_.data());
        results.of_bunches = results.of_groups + (more == 0 ? 0 : groups);
        results.finished = finished_.data();
        partial_count_ = bunches;
        first_partial_ = results.of_bunches;
        return results;
    }

    /// The results of the last loop.
    template <class Result>
    Partial<Result> partial() const
    {
        return {static_cast<Result const*>(first_partial_), partial_count_};
    }

    /// How many there are of them.
    std::uint32_t count() const { return partial_count_; }

    std::size_t memory() const { return partial_.memory() + finished_.memory(); }

private:
    Queue queue_;
    bool are_apart_ = false;
    Array<unsigned char> partial_;
    Array<std::uint32_t> finished_;
    void const* first_partial_ = nullptr;
    std::uint32_t partial_count_ = 0;
};

} // namespace firn::cuda
