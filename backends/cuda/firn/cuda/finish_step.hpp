// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/readback.hpp>
#include <firn/cuda/signal.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

// How a step ends: the results of its loops are merged, and the phase that chooses the next step is called
// with them, on the device.
namespace firn::cuda::detail
{

/// In groups of threads that scan a whole list by themselves.
inline constexpr int scanning_threads = 512;

/// What finishes a step: the results of the loops over nodes and over the items of each order of cells, and
/// the phase that is called with them.
template <class OfNodes, class OfItems, int orders, class Call>
struct MergeAndFinish
{
    Partial<OfNodes> of_nodes;
    std::array<Partial<OfItems>, orders> of_items;
    Call call;

    static constexpr std::size_t all_of_one_warp = sizeof(OfNodes) + orders * sizeof(OfItems);
    /// How many warps merge results of each kind; fewer with many obstacles, since their results need memory.
    /// A group with fewer warps merges in several rounds, with the same bits.
    static constexpr std::uint32_t warps = [] {
        std::uint32_t most = scanning_threads / 64;
        while (most > 1 && most * all_of_one_warp > 32 * 1024) most /= 2;
        return most;
    }();
    /// Shared memory that this needs.
    static constexpr std::size_t bytes = warps * all_of_one_warp;

    /// Called by a whole group of threads; returns in its first thread what the call returned.
    __device__ bool operator()(unsigned char* memory) const
    {
        return finish(memory, std::make_integer_sequence<int, orders>{});
    }

private:
    template <int... k>
    __device__ bool finish(unsigned char* memory, std::integer_sequence<int, k...>) const
    {
        // plain values, although Eigen's types are not trivially copyable
        auto* const items = reinterpret_cast<OfItems*>(memory);
        auto* const nodes = reinterpret_cast<OfNodes*>(items + orders * warps);
        for (std::uint32_t warp = threadIdx.x / 32; warp < 2 * warps; warp += blockDim.x / 32)
            if (warp < warps)
                (of_items[k].merge(warp, warps, items + k * warps), ...);
            else
                of_nodes.merge(warp - warps, warps, nodes);
        __syncthreads();
        if (threadIdx.x >= 32) return false;
        OfItems const all_items[]{Partial<OfItems>::whole(items + k * warps, warps)...};
        OfNodes const all_nodes = Partial<OfNodes>::whole(nodes, warps);
        return threadIdx.x == 0 && ask(call, all_nodes, all_items[k]...);
    }

    /// Not inlined: the registers of this one thread must not count for all threads of a loop. It is also the
    /// same code, with the same rounding, in every loop.
    template <class... Items>
    __device__ __noinline__ static bool ask(Call call, OfNodes nodes, Items... items)
    {
        return call(nodes, items...);
    }
};

} // namespace firn::cuda::detail
