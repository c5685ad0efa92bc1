// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/copy_elements.hpp>
#include <firn/cuda/migration.hpp>

#include <cstddef>
#include <cstdint>

// Where several devices share an order of cells: the items that leave for blocks which another device has,
// and those that come from there.
namespace firn::cuda::detail
{

/// Takes a place in one of several lists, behind those that others have taken: `counts` counts them. One
/// thread of a warp takes the places of all that ask for the same list: else all threads of a device would
/// wait for one another at one number.
static __device__ std::uint32_t take_place(std::uint32_t* counts, std::uint32_t which)
{
    std::uint32_t const with_me = __match_any_sync(__activemask(), which), lane = threadIdx.x % 32;
    int const first = __ffs(static_cast<int>(with_me)) - 1;
    std::uint32_t begin = 0;
    if (static_cast<int>(lane) == first)
        begin = atomicAdd(counts + which, static_cast<std::uint32_t>(__popc(with_me)));
    return __shfl_sync(with_me, begin, first) +
           static_cast<std::uint32_t>(__popc(with_me & ((1u << lane) - 1)));
}

/// A leaver whose new cell is not here.
struct Stray
{
    std::uint32_t leaver, slot;
    std::uint32_t cell, way; ///< where it came from, and where it goes: see Leavers
    std::uint32_t block;     ///< its new one, or absent if that does not exist
    std::uint32_t at;        ///< its place among those that go to the same rank
};

/// What a search for the new cells of leavers has found. All is 0 before.
struct Searched
{
    std::uint32_t leavers; ///< how many there are; if there was no room for all of them, nothing else holds
    std::uint32_t strays;
    std::uint32_t births;     ///< blocks that are missing
    std::uint32_t live;       ///< blocks that hold items when those have come that stay on this device
    std::uint32_t lacks_room; ///< 1 if there was no room for all leavers
    std::uint32_t through;    ///< groups of threads that have searched
};

inline constexpr unsigned searching_threads = 256, most_searching_groups = 2048;

/// Finds the new cells of an order's leavers, and lists those whose blocks are not here. Requests blocks that
/// are missing. Counts what goes to each rank.
template <int dimension, class Number>
struct SearchHere
{
    static constexpr int d = dimension;

    std::uint32_t blocks; ///< 0: there are no items
    Leavers<Number> leavers;
    Destinations<d> to;
    std::uint32_t const* owners; ///< which device has a block
    std::uint32_t rank;          ///< this one
    Stray* strays;
    Searched* searched;
    std::uint32_t* of_ranks;

    /// How many groups of threads do so.
    unsigned groups() const
    {
        std::size_t const most = leavers.most > blocks ? leavers.most : blocks;
        unsigned const all = groups_of(most, searching_threads);
        return blocks == 0 ? 0 : all < most_searching_groups ? all : most_searching_groups;
    }

    /// Called by all threads of each of these groups.
    __device__ void operator()(std::uint32_t group, std::uint32_t all_groups) const
    {
        std::uint32_t const first = group * blockDim.x + threadIdx.x, stride = all_groups * blockDim.x,
                            count = leavers.counters->outgoing;
        std::uint32_t live = 0;
        for (std::uint32_t b = first; b < blocks; b += stride) live += to.changes.block_stay[b] > 0;
        if (count <= leavers.most)
            for (std::uint32_t leaver = first; leaver < count; leaver += stride) live += find(leaver);
#pragma unroll
        for (int step = 16; step > 0; step /= 2) live += __shfl_down_sync(~0u, live, step);
        if (threadIdx.x % 32 == 0 && live > 0) atomicAdd(&searched->live, live);
        __syncthreads();
        if (threadIdx.x != 0) return;
        __threadfence();
        if (atomicAdd(&searched->through, 1u) + 1 < all_groups) return;
        searched->births = __ldcg(to.set.born_count);
        searched->leavers = count;
        searched->lacks_room = count > leavers.most;
    }

private:
    /// Returns whether a block holds items that would not without this one.
    __device__ bool find(std::uint32_t leaver) const
    {
        std::uint32_t const from = leavers.cell[leaver], way = leavers.way[leaver];
        std::uint32_t block = from / BlockShape<d>::cells;
        WayOut<d> const out(from % BlockShape<d>::cells, way);
        if (out.leaves_block) {
            Coordinates<d> const left = block_of_key<d>(to.keys[block]);
            block = to.set.find(block_key<d>(to.periods.wrapped(left + out.beyond)));
            if (block == absent)
                out.request(left, to.periods, to.ahead, [&](std::uint64_t key) { to.set.want(key); });
            if (block == absent || owners[block] != rank) {
                std::uint32_t at = 0;
                if (block != absent) at = take_place(of_ranks, owners[block]);
                strays[take_place(&searched->strays, 0)] = {leaver, leavers.slot[leaver], from, way, block,
                                                            at};
                return false;
            }
        }
        return arrive(leavers, to.changes, leaver, block, out.place) && to.changes.block_stay[block] == 0;
    }
};

/// Leavers, of which those from `first` on came from other devices.
template <class Number>
struct LeaversOfDevices : Leavers<Number>
{
    std::uint32_t first;
    std::uint64_t const* origins; ///< of those that came
    std::uint32_t* spare;         ///< as much room as there are leavers

    /// The same: whatever device has the neighbour, this is the order in which one device alone would have
    /// had them.
    __device__ std::uint64_t origin(std::uint32_t leaver, std::uint32_t where) const
    {
        return leaver < first ? Leavers<Number>::origin(leaver, where) : origins[leaver - first];
    }
    std::uint32_t* scratch() const { return spare; }
};

/// Lets items that came from one other device into their cells: they are listed from `before` on, of those
/// that came from all, and lie at `place` and behind it.
template <class Number>
struct Admit
{
    LeaversOfDevices<Number> leavers;
    Changes changes;
    std::uint64_t const* from; ///< their origins
    std::uint32_t const* cells;
    std::uint64_t* origins;
    std::uint32_t before, place;

    __device__ void operator()(std::uint32_t i) const
    {
        std::uint32_t const leaver = leavers.first + before + i, cell = cells[i];
        origins[before + i] = from[i];
        leavers.slot[leaver] = place + i;
        arrive<Number>(leavers, changes, leaver, cell / 64, cell % 64);
    }
};

/// Counts the items of each block.
static __global__ void count_items(std::uint32_t const* begin, std::uint32_t blocks, std::uint32_t* counts)
{
    std::uint32_t const b = blockIdx.x * blockDim.x + threadIdx.x;
    if (b < blocks) counts[b] = begin[(b + 1) * 64] - begin[b * 64];
}

/// Lists strays rank by rank, where those of each rank begin, and where they lie.
static __global__ void list_by_rank(Stray const* strays, std::uint32_t count, std::uint32_t const* owners,
                                    std::uint32_t const* begins, Stray* sorted, std::uint32_t* places)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    Stray const stray = strays[i];
    std::uint32_t const at = begins[owners[stray.block]] + stray.at;
    sorted[at] = stray;
    places[at] = stray.slot;
}

/// Writes what the new cells of strays must know: where they come from, their cells there, and what they
/// scatter.
template <int d, class Number>
__global__ void note_strays(Stray const* strays, std::uint32_t count, Leavers<Number> leavers,
                            std::uint64_t* origins, std::uint32_t* cells, Number* contributions)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    constexpr std::uint32_t of_block = BlockShape<d>::cells;
    Stray const stray = strays[i];
    WayOut<d> const out(stray.cell % of_block, stray.way);
    origins[i] = Leavers<Number>::origin_of(stray.way, stray.slot);
    cells[i] = stray.block * of_block + out.place;
    auto const channels = static_cast<std::size_t>(leavers.channels);
    for (std::size_t c = 0; c < channels; ++c)
        contributions[i * channels + c] = leavers.contribution[stray.leaver * channels + c];
}

/// A block all of whose items leave for another device, and where these begin among all that leave.
struct BlockOfItems
{
    std::uint32_t block, first;
};

/// Lists the items of such blocks, with a group of 64 threads for each: where they lie, by `order`, or at
/// their slots if it is null; where they come from, and their cells there, without the first `before` of all.
static __global__ void __launch_bounds__(64)
    list_items_of_blocks(BlockOfItems const* blocks, std::uint32_t const* begin, std::uint32_t const* order,
                         std::uint32_t before, std::uint32_t* places, std::uint64_t* origins,
                         std::uint32_t* cells, std::uint32_t* block_stay)
{
    BlockOfItems const of = blocks[blockIdx.x];
    std::uint32_t const cell = of.block * 64 + threadIdx.x, first = begin[of.block * 64];
    for (std::uint32_t slot = begin[cell]; slot < begin[cell + 1]; ++slot) {
        std::uint32_t const at = of.first + slot - first;
        places[at] = order != nullptr ? order[slot] : slot;
        origins[at - before] = slot; // in their order: no others come into these cells
        cells[at - before] = cell;
    }
    if (threadIdx.x == 0) block_stay[of.block] = 0;
}

/// Tells apart the places of items that have gone: those before `left` are holes, and those behind are
/// marked.
static __global__ void find_holes(std::uint32_t const* places, std::uint32_t gone, std::uint32_t left,
                                  std::uint32_t* is_gone, std::uint32_t* holes, std::uint32_t* count)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= gone) return;
    std::uint32_t const place = places[i];
    if (place >= left)
        is_gone[place - left] = 1;
    else
        holes[atomicAdd(count, 1u)] = place;
}
/// Gives each item that lies behind the first `left` places a hole.
static __global__ void fill_holes(std::uint32_t const* is_gone, std::uint32_t behind, std::uint32_t left,
                                  std::uint32_t const* holes, std::uint32_t* place, std::uint32_t* from,
                                  std::uint32_t* to, std::uint32_t* count)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= behind || is_gone[i] != 0) return;
    std::uint32_t const at = atomicAdd(count, 1u);
    from[at] = left + i;
    to[at] = place[i] = holes[at];
}

inline constexpr unsigned relocated_at_once = 4;

/// Items that lay at places from `first` on lie at `place[where it lay - first]` now. `where` begins at a
/// multiple of 16 bytes, since few threads that read much of it take a third of the time.
static __global__ void relocate(std::uint32_t* where, std::size_t count, std::uint32_t first,
                                std::uint32_t const* place)
{
    struct alignas(16) Some
    {
        std::uint32_t of[relocated_at_once];
    };
    std::size_t const i = (std::size_t(blockIdx.x) * blockDim.x + threadIdx.x) * relocated_at_once;
    if (i + relocated_at_once <= count) {
        Some const lay = reinterpret_cast<Some const*>(where)[i / relocated_at_once];
#pragma unroll
        for (unsigned k = 0; k < relocated_at_once; ++k)
            if (lay.of[k] >= first) where[i + k] = place[lay.of[k] - first];
    }
    else
        for (std::size_t k = i; k < count; ++k)
            if (where[k] >= first) where[k] = place[where[k] - first];
}

} // namespace firn::cuda::detail
