// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/results_of_devices.hpp>
#include <firn/cuda/strays.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

// What a step has found on a device becomes known to all that share its scene, in few loops: each takes some
// 3 us to begin, however little it has to do.
namespace firn::cuda::detail
{

/// What loops over nodes, and over the items of each order of cells, have found is told. This is not a part
/// of the search for new cells: results need many registers, and there would be room for few threads.
template <class ResultOfNodes, class OfItems, std::size_t orders>
struct TellStep
{
    using OfNodes = ResultOfNodes;

    TellResults<OfNodes> nodes;
    std::array<TellResults<OfItems>, orders> items;

    static constexpr unsigned groups = static_cast<unsigned>(1 + orders) * telling_groups;
};

template <class OfNodes, class OfItems, std::size_t orders>
__global__ void __launch_bounds__(telling_threads) tell_step(TellStep<OfNodes, OfItems, orders> step)
{
    std::uint32_t const loop = blockIdx.x / telling_groups, group = blockIdx.x % telling_groups;
    if (loop == 0) step.nodes(group);
#pragma unroll
    for (unsigned k = 0; k < orders; ++k)
        if (loop == 1 + k) step.items[k](group);
}

/// The leavers of all orders of cells search for their new cells, each on `each` groups of threads.
template <class Search, std::size_t orders>
__global__ void __launch_bounds__(searching_threads)
    search_step(std::array<Search, orders> search, unsigned each)
{
#pragma unroll
    for (unsigned k = 0; k < orders; ++k)
        if (blockIdx.x / each == k && search[k].blocks > 0) search[k](blockIdx.x % each, each);
}

/// The first words of what each device has told, for the host.
struct Heads
{
    unsigned char const* told; ///< `stride` bytes of each device
    std::size_t stride, words;
    std::uint32_t devices;
    std::uint32_t* host;
    std::uint32_t* own; ///< so many words of what this device has told, to be cleared for the next step
    std::size_t own_words;

    /// Called by a group of threads for each device.
    __device__ void tell(std::uint32_t device) const
    {
        auto const* const from = reinterpret_cast<std::uint32_t const*>(told + device * stride);
        for (std::size_t i = threadIdx.x; i < words; i += blockDim.x) host[device * words + i] = from[i];
        __syncthreads(); // it may be the same memory, if there is one device
        if (device == 0)
            for (std::size_t i = threadIdx.x; i < own_words; i += blockDim.x) own[i] = 0;
    }
};

/// The loops behind the messages: what all devices have told is put to where it belongs, and the host is
/// told; then it is merged.
template <class ResultOfNodes, class OfItems, std::size_t orders>
struct HearStep
{
    using OfNodes = ResultOfNodes;

    MergeTold<OfNodes> nodes;
    std::array<MergeTold<OfItems>, orders> items;
    unsigned putting, merging; ///< groups of threads for each loop

    void set_groups()
    {
        putting = nodes.groups_that_put();
        merging = nodes.groups_that_merge();
        for (auto const& of : items) {
            putting = std::max(putting, of.groups_that_put());
            merging = std::max(merging, of.groups_that_merge());
        }
    }
    /// Calls `use(loop)` for the loop of this number.
    template <class Use>
    __device__ void with_loop(std::uint32_t number, Use const& use) const
    {
        if (number == 0) use(nodes);
#pragma unroll
        for (unsigned k = 0; k < orders; ++k)
            if (number == 1 + k) use(items[k]);
    }
};

template <class OfNodes, class OfItems, std::size_t orders>
__global__ void __launch_bounds__(MergeTold<OfNodes>::putting_threads)
    hear_step(HearStep<OfNodes, OfItems, orders> step, Heads heads)
{
    if (blockIdx.x < heads.devices) {
        heads.tell(blockIdx.x);
        return;
    }
    std::uint32_t const group = blockIdx.x - heads.devices;
    step.with_loop(group / step.putting, [&](auto const& of) { of.put(group % step.putting); });
}

template <class OfNodes, class OfItems, std::size_t orders>
__global__ void __launch_bounds__(MergeTold<OfNodes>::merging_threads)
    merge_step(HearStep<OfNodes, OfItems, orders> step)
{
    constexpr unsigned at_once = MergeTold<OfNodes>::merging_threads / 32;
    step.with_loop(blockIdx.x / step.merging,
                   [&](auto const& of) { of.merge(blockIdx.x % step.merging * at_once + threadIdx.x / 32); });
}

} // namespace firn::cuda::detail
