// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/results.hpp>
#include <firn/cuda/signal.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

// How a step ends: what its loops found is merged, and who knows what follows is called with it, on the
// device.
namespace firn::cuda::detail
{

/// In the groups of threads that look at all of something by themselves.
inline constexpr int scanning_threads = 512;

/// What concludes a step: the results of the loops over nodes and over the items of each order of cells, and
/// who is called with them.
///
/// Where nobody waits for what comes next it is only asked whether the step went well, and the results are
/// kept for who then asks how things go on (choose).
template <class OfNodes, class OfItems, int orders, class Call>
struct Conclusion
{
    Partial<OfNodes> of_nodes;
    std::array<Partial<OfItems>, orders> of_items;
    Call call;
    unsigned char* kept = nullptr; ///< room for the results; none: all is asked at once

    static constexpr std::size_t kept_bytes = sizeof(OfNodes) + orders * sizeof(OfItems);
    __device__ OfItems* kept_items() const { return reinterpret_cast<OfItems*>(kept); }
    __device__ OfNodes* kept_nodes() const { return reinterpret_cast<OfNodes*>(kept_items() + orders); }
    __host__ __device__ bool leaves_a_choice() const { return kept != nullptr; }

    /// Called by a whole group of threads; true in its first one if the call was.
    __device__ bool operator()() const { return conclude(std::make_integer_sequence<int, orders>{}); }

    /// For one thread of a later loop: how things go on after a step that went well.
    __device__ bool choose() const { return choose(std::make_integer_sequence<int, orders>{}); }

private:
    template <int... k>
    __device__ bool conclude(std::integer_sequence<int, k...>) const
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
        if (warp > 0) return false;
        OfItems const all_items[]{Partial<OfItems>::whole(items + k * half, half)...};
        OfNodes const all_nodes = Partial<OfNodes>::whole(nodes, half);
        if (threadIdx.x != 0) return false;
        if (!leaves_a_choice())
            return call.went_well(all_items[k]...) && goes_on(call, all_nodes, all_items[k]...);
        (store_words(all_items[k], kept_items() + k), ...);
        store_words(all_nodes, kept_nodes());
        return call.went_well(all_items[k]...);
    }

    template <int... k>
    __device__ bool choose(std::integer_sequence<int, k...>) const
    {
        return goes_on(call, load_words(kept_nodes()), load_words(kept_items() + k)...);
    }

    /// A function of its own, which no loop takes in: one thread's registers are not to be those of all, and
    /// it is the same code, with the same rounding, whoever asks.
    template <class... Items>
    __device__ __noinline__ static bool goes_on(Call call, OfNodes nodes, Items... items)
    {
        return call.goes_on(nodes, items...);
    }
};

} // namespace firn::cuda::detail
