// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>

#include <cstdint>

namespace firn::cuda
{

namespace detail
{
/// A value as words: padding is copied too, and shuffles take nothing larger.
template <class T>
struct Words
{
    static_assert(sizeof(T) % sizeof(std::uint32_t) ==
                  0); // plain values, although Eigen's types do not say so
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

/// Loads what another group of threads stored, past the cache of this one.
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

/// The results of a warp's lanes, merged in their order: in lane 0.
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

/// Where the warps of a loop leave their results; the last of each bunch of warps merges those of the bunch,
/// and the last bunch those of the bunches: no loop of its own is needed, and the order is always the same.
template <class Result>
struct ResultsOfWarps
{
    static constexpr std::uint32_t bunch = 64;

    Result *of_warps, *of_bunches;
    std::uint32_t* finished; ///< per bunch, and last the bunches: how many are through
    std::uint32_t warps;
    Result* merged;

    /// All lanes of a warp bring their results; called once by each warp.
    __device__ void take(Result const& of_lane, std::uint32_t warp) const
    {
        bool const leads = threadIdx.x % 32 == 0;
        Result const mine = merged_in_warp(of_lane);
        if (leads) store_words(mine, of_warps + warp);
        std::uint32_t const b = warp / bunch, bunches = (warps + bunch - 1) / bunch;
        if (!is_last(finished + b, min(bunch, warps - b * bunch))) return;
        Result const of_bunch = merge(of_warps + b * bunch, min(bunch, warps - b * bunch));
        if (leads) store_words(of_bunch, of_bunches + b);
        if (!is_last(finished + bunches, bunches)) return;
        Result const all = merge(of_bunches, bunches);
        if (leads) store_words(all, merged);
    }

private:
    __device__ static std::uint32_t min(std::uint32_t a, std::uint32_t b) { return a < b ? a : b; }

    /// Whether all others were here before this warp; then the count begins anew.
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

    __device__ static Result merge(Result const* from, std::uint32_t count)
    {
        std::uint64_t const lane = threadIdx.x % 32;
        Result result{};
        for (auto i = lane * count / 32; i < (lane + 1) * count / 32; ++i) result.merge(load_words(from + i));
        return merged_in_warp(result);
    }
};
} // namespace detail

/// A merged result where later loops find it: converts to it there. Without a place, of nothing.
template <class Result>
struct Merged
{
    Result const* where;
    __device__ operator Result() const { return where ? *where : Result{}; }
};

/// The results of a loop's warps, merged in a fixed order.
class Results
{
public:
    explicit Results(Queue const& queue) : partial_(queue), finished_(queue), merged_(queue) {}

    /// Room for the results of so many warps.
    template <class Result>
    detail::ResultsOfWarps<Result> expect(std::uint32_t warps)
    {
        std::uint32_t const bunches = groups_of(warps, detail::ResultsOfWarps<Result>::bunch);
        partial_.renew((std::size_t(warps) + bunches) * sizeof(Result));
        if (finished_.size() < bunches + 1) {
            finished_.renew(bunches + 1);
            finished_.fill_bytes(0, finished_.size(), 0);
        }
        auto* const results = reinterpret_cast<Result*>(partial_.data());
        merged_.renew(sizeof(Result));
        return {results, results + warps, finished_.data(), warps, reinterpret_cast<Result*>(merged_.data())};
    }

    /// Those of the last loop.
    template <class Result>
    Merged<Result> known() const
    {
        return {reinterpret_cast<Result const*>(merged_.data())};
    }

    std::size_t memory() const { return partial_.memory() + finished_.memory(); }

private:
    Array<unsigned char> partial_;
    Array<std::uint32_t> finished_;
    Array<unsigned char> merged_;
};

} // namespace firn::cuda
