// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>

#include <cstdint>
#include <cstring>

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

/// Each warp merges a run of results.
template <class Result>
__global__ void __launch_bounds__(32) merge_results(Result const* from, std::uint32_t count, Result* to)
{
    std::uint64_t const threads = std::uint64_t(gridDim.x) * 32, me = blockIdx.x * 32 + threadIdx.x;
    Result result{};
    for (auto i = me * count / threads; i < (me + 1) * count / threads; ++i) result.merge(from[i]);
    result = merged_in_warp(result);
    if (threadIdx.x == 0) store_words(result, to + blockIdx.x);
}
} // namespace detail

/// A result that becomes known when a queue has come so far: converts to it, and waits.
template <class Result>
class Later
{
public:
    Later(Queue const& queue, void const* where) : queue_(queue), where_(where) {}

    operator Result() const
    {
        if (!where_) return Result{};
        queue_.wait();
        Result result;
        std::memcpy(static_cast<void*>(&result), where_, sizeof result);
        return result;
    }

private:
    Queue queue_;
    void const* where_;
};

/// The results of a loop's warps, merged in a fixed order on their way to the host.
class Results
{
    static constexpr std::uint32_t warps = 128; ///< that merge

public:
    explicit Results(Queue const& queue) : queue_(queue), partial_(queue) {}
    Results(Results&& other) noexcept : queue_(other.queue_), partial_(std::move(other.partial_))
    {
        std::swap(host_, other.host_);
        std::swap(bytes_, other.bytes_);
    }
    Results& operator=(Results&& other) noexcept
    {
        std::swap(queue_, other.queue_);
        std::swap(partial_, other.partial_);
        std::swap(host_, other.host_);
        std::swap(bytes_, other.bytes_);
        return *this;
    }
    ~Results()
    {
        if (host_) static_cast<void>(cudaFreeHost(host_));
    }

    /// Room for the results of so many warps.
    template <class Result>
    Result* expect(std::size_t count)
    {
        partial_.renew((count + warps + 1) * sizeof(Result));
        return reinterpret_cast<Result*>(partial_.data());
    }

    /// Merges them, once the loop that writes them is queued.
    template <class Result>
    Later<Result> merge(std::size_t count)
    {
        auto* from = reinterpret_cast<Result*>(partial_.data());
        auto left = static_cast<std::uint32_t>(count);
        auto* to = from + count;
        if (left > 4 * warps) {
            detail::merge_results<<<warps, 32, 0, queue_.stream>>>(from, left, to);
            from = to;
            to += warps;
            left = warps;
        }
        detail::merge_results<<<1, 32, 0, queue_.stream>>>(from, left, to);
        check_launch("merge_results");
        if (bytes_ < sizeof(Result)) {
            if (host_) check(cudaFreeHost(host_), "cudaFreeHost");
            host_ = nullptr;
            check(cudaMallocHost(&host_, sizeof(Result)), "cudaMallocHost");
            bytes_ = sizeof(Result);
        }
        check(cudaMemcpyAsync(host_, to, sizeof(Result), cudaMemcpyDeviceToHost, queue_.stream),
              "cudaMemcpyAsync");
        return {queue_, host_};
    }

    std::size_t memory() const { return partial_.memory(); }

private:
    Queue queue_;
    Array<unsigned char> partial_;
    void* host_ = nullptr;
    std::size_t bytes_ = 0;
};

} // namespace firn::cuda
