// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/results.hpp>
#include <firn/cuda/signal.hpp>

#include <cstddef>
#include <cstdint>
#include <utility>

// How a step ends: what its loops found is merged, and who knows what follows is called with it, on the
// device.
namespace firn::cuda::detail
{

/// In the groups of threads that look at all of something by themselves.
inline constexpr int scanning_threads = 512;

/// What concludes a step: the results of two loops, and who is called with them.
///
/// Where nobody waits for what comes next it is only asked whether the step went well, and the results are
/// kept for who then asks how things go on (choose).
template <class OfNodes, class OfItems, class Call>
struct Conclusion
{
    Partial<OfNodes> of_nodes;
    Partial<OfItems> of_items;
    Call call;
    unsigned char* kept = nullptr; ///< room for the results; none: all is asked at once

    static constexpr std::size_t kept_bytes = sizeof(OfNodes) + sizeof(OfItems);
    __device__ OfItems* kept_items() const { return reinterpret_cast<OfItems*>(kept); }
    __device__ OfNodes* kept_nodes() const { return reinterpret_cast<OfNodes*>(kept_items() + 1); }
    __host__ __device__ bool leaves_a_choice() const { return kept != nullptr; }

    /// Called by a whole group of threads; true in its first one if the call was.
    __device__ bool operator()() const
    {
        constexpr std::uint32_t half = scanning_threads / 64;
        // plain values, although Eigen's types do not say so
        __shared__ __align__(16) unsigned char memory[half * (sizeof(OfNodes) + sizeof(OfItems))];
        auto* const items = reinterpret_cast<OfItems*>(memory);
        auto* const nodes = reinterpret_cast<OfNodes*>(items + half);
        std::uint32_t const warp = threadIdx.x / 32;
        if (warp < half)
            of_items.merge(warp, half, items);
        else
            of_nodes.merge(warp - half, half, nodes);
        __syncthreads();
        if (warp > 0) return false;
        OfItems const all_items = Partial<OfItems>::whole(items, half);
        OfNodes const all_nodes = Partial<OfNodes>::whole(nodes, half);
        if (threadIdx.x != 0) return false;
        if (!leaves_a_choice()) return call.went_well(all_items) && goes_on(call, all_nodes, all_items);
        store_words(all_items, kept_items());
        store_words(all_nodes, kept_nodes());
        return call.went_well(all_items);
    }

    /// For one thread of a later loop: how things go on after a step that went well.
    __device__ bool choose() const
    {
        return goes_on(call, load_words(kept_nodes()), load_words(kept_items()));
    }

private:
    /// A function of its own, which no loop takes in: one thread's registers are not to be those of all, and
    /// it is the same code, with the same rounding, whoever asks.
    __device__ __noinline__ static bool goes_on(Call call, OfNodes nodes, OfItems items)
    {
        return call.goes_on(nodes, items);
    }
};

/// What concludes a step of several orders of cells: the results of a loop for each.
template <class OfNodes, class OfItems, int orders, class Call>
struct ConclusionOfSeveral
{
    Partial<OfNodes> of_nodes;
    Partial<OfItems> of_items[orders];
    Call call;

    /// Called by a whole group of threads.
    template <std::size_t... k>
    __device__ void conclude(std::index_sequence<k...>) const
    {
        constexpr std::uint32_t half = scanning_threads / 64;
        // plain values, although Eigen's types do not say so
        __shared__ __align__(16) unsigned char memory[half * (sizeof(OfNodes) + orders * sizeof(OfItems))];
        auto* const items = reinterpret_cast<OfItems*>(memory);
        auto* const nodes = reinterpret_cast<OfNodes*>(items + orders * half);
        std::uint32_t const warp = threadIdx.x / 32;
        if (warp < half)
            (of_items[k].merge(warp, half, items + k * half), ...);
        else
            of_nodes.merge(warp - half, half, nodes);
        __syncthreads();
        if (warp > 0) return;
        OfNodes const all_nodes = Partial<OfNodes>::whole(nodes, half);
        OfItems const all_items[]{Partial<OfItems>::whole(items + k * half, half)...};
        if (threadIdx.x == 0) call(all_nodes, all_items[k]...);
    }
};

/// Concludes, in a loop of its own.
template <class OfNodes, class OfItems, int orders, class Call>
__global__ void __launch_bounds__(scanning_threads)
    conclude_several(ConclusionOfSeveral<OfNodes, OfItems, orders, Call> conclusion)
{
    conclusion.conclude(std::make_index_sequence<static_cast<std::size_t>(orders)>{});
}

/// Stands for a conclusion that is yet to be made: the host listens first.
struct Pause
{
    __device__ bool operator()() const { return false; }
    static constexpr bool leaves_a_choice() { return false; }
};

/// What follows a loop over no items.
template <class Conclude>
__global__ void __launch_bounds__(scanning_threads) conclude_without_items(Signal signal, Conclude conclude)
{
    if (signal.stops() || conclude() || threadIdx.x != 0) return;
    signal.stop({1, 0, 0, 0});
}

} // namespace firn::cuda::detail
