// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_begins.hpp>
#include <firn/cuda/empty_blocks.hpp>
#include <firn/cuda/new_order.hpp>
#include <firn/cuda/readback.hpp>
#include <firn/cuda/shared_memory.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

// How a step ends: the results of its loops are merged, and the phase that chooses the next step is called
// with them, on the device. Later loops are stopped if the host must act first.
namespace firn::cuda::detail
{

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

/// Finishes a step by a loop of its own.
template <class Finish>
__global__ void __launch_bounds__(scanning_threads) finish_alone(Finish finish)
{
    finish(shared_memory());
}

/// An order of cells after its items have moved.
template <int dimension, class Number>
struct MovedOrder
{
    static constexpr int d = dimension;

    Signal signal;
    Leavers<Number> leavers;
    Destinations<d> to;
    bool is_to_find;    ///< the loop that moved the leavers did not find their new cells
    BlockBegins begins; ///< no blocks: there are no items
    bool small, spreads;

    /// What there was no room for: what the host is told if steps stop.
    __device__ Stop lacking() const
    {
        if (begins.blocks == 0) return {1, 0, 0, 0};
        return {1, __ldcg(&leavers.counters->outgoing), __ldcg(to.set.born_count), 0};
    }
    __device__ bool lacks_room(Stop const& what) const
    {
        return what.leavers > leavers.most || what.births > 0;
    }
    /// Never where no block holds items: the blocks are then kept for items that may come.
    __device__ bool is_crowded(std::uint32_t live) const
    {
        return live > 0 && begins.blocks > live + most_empty_blocks(live, small, spreads);
    }
};

/// For one thread of a group: whether `count - 1` groups were here before. What they wrote is then visible.
__device__ inline bool comes_last(std::uint32_t* arrived, std::uint32_t count)
{
    __threadfence();
    bool const last = atomicAdd(arrived, 1u) + 1 == count;
    __threadfence();
    if (last) *arrived = 0;
    return last;
}

/// Ends a step when the items of all orders have moved. One group of threads finishes the step; `each` groups
/// per order find the new cells of its leavers if that is still to be done, and the last of them finds where
/// the blocks begin. The last group of all stops later loops if steps shall not go on, or if there was no
/// room for all leavers.
template <class Moved, int orders, class Finish>
__global__ void __launch_bounds__(scanning_threads)
    end_step(Signal signal, std::array<Moved, orders> of, Finish finish)
{
    if (signal.stops()) return;
    if (blockIdx.x == 0) {
        bool const goes_on = finish(shared_memory());
        if (threadIdx.x == 0) signal.words[3] = goes_on;
    }
    std::uint32_t const each = (gridDim.x - 1) / orders;
#pragma unroll
    for (unsigned k = 0; k < orders; ++k) {
        std::uint32_t const first = 1 + k * each;
        if (blockIdx.x < first || blockIdx.x >= first + each) continue;
        Moved const& mine = of[k];
        if (mine.begins.blocks == 0) {
            if (blockIdx.x > first) return;
            continue;
        }
        if (mine.is_to_find) find_new_cells<Moved::d>(mine.leavers, mine.to, blockIdx.x - first, each);
        __syncthreads();
        if (each > 1) {
            __shared__ bool last;
            if (threadIdx.x == 0) last = comes_last(&mine.leavers.counters->searched, each);
            __syncthreads();
            if (!last) return;
        }
        std::uint32_t const live =
            mine.lacks_room(mine.lacking()) ? 0 : find_block_begins(mine.begins, mine.to.changes);
        if (threadIdx.x == 0) mine.leavers.counters->live = live;
    }
    if (threadIdx.x != 0 || !comes_last(signal.words + 2, 1 + orders)) return;

    Stop why[orders];
    bool lack = false, crowded = false;
#pragma unroll
    for (int k = 0; k < orders; ++k) {
        why[k] = of[k].lacking();
        lack = lack || of[k].lacks_room(why[k]);
    }
#pragma unroll
    for (int k = 0; k < orders; ++k) {
        if (of[k].begins.blocks == 0) continue;
        of[k].leavers.counters->rebinned = why[k].leavers;
        why[k].crowded = !lack && of[k].is_crowded(__ldcg(&of[k].leavers.counters->live));
        crowded = crowded || why[k].crowded != 0;
    }
    if (__ldcg(signal.words + 3) != 0 && !lack && !crowded) return;
#pragma unroll
    for (int k = 0; k < orders; ++k) of[k].signal.stop(why[k]);
}

/// Ends a step and rebins its items in one loop, where there are few blocks. The first group of threads
/// finishes the step. The others, one per block, write the new order as if the step will succeed (see
/// CellOrder::rollback), and call `then(block, what came into the thread's cell, teams)`. The loop's number
/// is above 0 and differs from those of the loops queued near it.
template <int d, class Number, class Finish, class Then>
__global__ void __launch_bounds__(most_teams_that_rebin * 64, 1)
    finish_and_rearrange(MovedOrder<d, Number> order, std::uint32_t number, std::uint32_t const* begin,
                         NewOrder to, std::array<typename CellOffset<Number>::Stored*, d> offset,
                         Finish finish, Then then)
{
    Signal const& signal = order.signal;
    if (signal.stops(number)) return;
    std::uint32_t const blocks = order.begins.blocks;
    Stop why = order.lacking();
    bool const lacks = order.lacks_room(why);
    if (blockIdx.x > 0) {
        if (lacks) return;
        std::uint32_t const block = blockIdx.x - 1, teams = blockDim.x / 64;
        auto const find_begin = [&](std::uint32_t b) { return find_block_begin(b, order.to.changes); };
        ArrivedInCell const came = rearrange_block<d>(block, blocks, begin, order.to.changes, find_begin,
                                                      order.leavers, to, offset, teams);
        then(block, came, teams);
        return;
    }
    std::uint32_t const live = count_live_blocks(blocks, order.to.changes);
    bool const goes_on = finish(shared_memory());
    if (threadIdx.x != 0) return;
    order.leavers.counters->rebinned = why.leavers;
    why.crowded = !lacks && order.is_crowded(live);
    if (lacks)
        signal.stop(why);
    else if (!goes_on || why.crowded != 0)
        signal.stop_behind(number, {1, 0, 0, why.crowded});
    signal.has_chosen(number);
}

} // namespace firn::cuda::detail
