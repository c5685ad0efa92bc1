// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/scan.hpp>

#include <array>
#include <cstdint>

// The loops that write the new order of items: those that stay in their cells, and those that come in.
namespace firn::cuda::detail
{

/// Orders the incoming items of one crowded cell by where they came from, on one warp.
template <class Leavers>
__device__ void sort_crowd(Leavers const& leavers, std::uint32_t* arrived, std::uint32_t* spare,
                           std::uint32_t count)
{
    auto const origin = [&](std::uint32_t item) { return leavers.origin(item, leavers.slot[item]); };
    for (std::uint32_t i = threadIdx.x % 32; i < count; i += 32) {
        std::uint32_t const item = arrived[i];
        auto const mine = origin(item);
        std::uint32_t rank = 0;
        for (std::uint32_t j = 0; j < count; ++j) rank += origin(arrived[j]) < mine;
        spare[rank] = item;
    }
    __syncwarp();
    for (std::uint32_t i = threadIdx.x % 32; i < count; i += 32) arrived[i] = spare[i];
    __syncwarp();
}

/// Where the new order is written, and what it is written from.
struct NewOrder
{
    std::uint32_t const* source; ///< where items lie; null: at their slots
    unsigned char const* left;   ///< per slot: whether the item left; null: none did
    std::uint32_t* begin;        ///< per cell
    std::uint32_t* arrived_begin;
    std::uint32_t* arrived; ///< list of leavers by cell
    std::uint32_t* order;
    std::uint32_t* spare; ///< scratch for as many as come in
};

/// Where a block's part of the new order is written: in shared memory first, if there is room. Cells write
/// one item after the other, and together they write memory in whole lines.
struct OrderOfBlock
{
    static constexpr std::uint32_t room = 768;

    std::uint32_t* to;
    std::uint32_t first; ///< of the block in the order, if it is in shared memory

    __device__ std::uint32_t& operator[](std::uint32_t at) const { return to[at - first]; }
};

/// The items that lay in the thread's cell before.
struct StayedInCell
{
    std::uint32_t begin, count;
    bool all_stay;

    __device__ StayedInCell(std::uint32_t const* begins, std::uint32_t c, Changes const& changes,
                            bool none_left)
    {
        begin = begins[c];
        count = begins[c + 1] - begin;
        all_stay = none_left || changes.group_left[c / 32] == 0;
    }
};

/// Writes the items that stay, in the order in which they lie, from `at` on. Eight loads are in flight at
/// once to hide the latency of memory.
static __device__ void keep_those_that_stay(StayedInCell const& lay, NewOrder const& to,
                                            OrderOfBlock const& order, std::uint32_t at)
{
    constexpr int at_once = 8;
    for (std::uint32_t rank = 0; rank < lay.count; rank += at_once) {
        bool stays[at_once];
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i)
            stays[i] = rank + i < lay.count && (lay.all_stay || to.left[lay.begin + rank + i] == 0);
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i)
            if (stays[i]) {
                std::uint32_t const slot = lay.begin + rank + i;
                order[at++] = to.source ? to.source[slot] : slot;
            }
    }
}

/// The offsets of items whose leavers are listed so.
template <class Leavers, int d>
using OffsetsOf = std::array<typename CellOffset<typename Leavers::Number>::Stored*, std::size_t(d)>;

/// Writes the items that come into the thread's cell, in the order of their origins, from `at` on, and into
/// the list of leavers by cell. They come as a linked list in any order: each is inserted into a sorted list
/// in shared memory while the next one is loaded. Wraps their offsets into the new cells.
template <int d, class Leavers>
__device__ void append_incoming(std::uint32_t first_incoming, ArrivedInCell came, Leavers const& leavers,
                                NewOrder const& to, OrderOfBlock const& order, std::uint32_t at,
                                OffsetsOf<Leavers, d> const& offset)
{
    using Number = typename Leavers::Number;
    constexpr std::uint32_t few = 12;
    __shared__ std::uint32_t near[2][few][64]; // leavers that come into the thread's cell, and where they lie
    std::uint32_t const own = threadIdx.x % 64;
    std::uint32_t* const arrived = to.arrived + came.begin;
    std::uint32_t leaver = came.count == 0 ? absent : first_incoming, where = 0, next = absent;
    if (leaver != absent) where = leavers.slot[leaver], next = leavers.next[leaver];
    for (std::uint32_t placed = 0; leaver != absent; ++placed) {
        typename CellOffset<Number>::Stored stored[d];
        if (offset[0] != nullptr)
            for (int a = 0; a < d; ++a) stored[a] = offset[a][where];
        std::uint32_t where_next = 0, after = absent;
        if (next != absent) where_next = leavers.slot[next], after = leavers.next[next];
        if (came.count <= few) {
            std::uint32_t place = placed;
            auto const origin = leavers.origin(leaver, where);
            for (; place > 0 && leavers.origin(near[0][place - 1][own], near[1][place - 1][own]) > origin;
                 --place)
                for (auto& of : near) of[place][own] = of[place - 1][own];
            near[0][place][own] = leaver;
            near[1][place][own] = where;
        }
        else
            arrived[placed] = leaver;
        if (offset[0] != nullptr)
            for (int a = 0; a < d; ++a) {
                CellOffset<Number>::wrap(stored[a]);
                offset[a][where] = stored[a];
            }
        leaver = next, where = where_next, next = after;
    }
    __syncwarp();
    for (std::uint32_t crowded = __ballot_sync(~0u, came.count > few); crowded != 0; crowded &= crowded - 1) {
        int const lane = __ffs(static_cast<int>(crowded)) - 1;
        std::uint32_t const from = __shfl_sync(~0u, came.begin, lane);
        sort_crowd(leavers, to.arrived + from, to.spare + from, __shfl_sync(~0u, came.count, lane));
    }
    for (std::uint32_t i = 0; i < came.count; ++i) {
        if (came.count <= few) arrived[i] = near[0][i][own];
        order[at + i] = came.count <= few ? near[1][i][own] : leavers.slot[arrived[i]];
    }
}

/// Writes a block's new cells and its part of the new order: items that stay keep their order within the
/// cell, incoming ones follow in the order of their origins. One team of 64 threads does all of it; of
/// several teams, the second appends the incoming items while the first writes those that stay.
template <int d, class Leavers, class FindBegin>
__device__ ArrivedInCell rearrange_block(std::uint32_t block, std::uint32_t blocks,
                                         std::uint32_t const* begin, Changes const& changes,
                                         FindBegin const& find_begin, Leavers const& leavers,
                                         NewOrder const& to, OffsetsOf<Leavers, d> const& offset,
                                         std::uint32_t teams = 1)
{
    std::uint32_t const team = teams == 1 ? 0 : threadIdx.x / 64, place = threadIdx.x % 64;
    std::uint32_t const c = block * 64 + place;
    std::uint32_t const incoming = changes.incoming[c], stay = changes.stay[c],
                        first_incoming = changes.first_incoming[c];
    StayedInCell const lay(begin, c, changes,
                           to.left == nullptr); // loaded before threads wait for one another
    std::uint64_t total;
    std::uint64_t const of_block = find_begin(block);
    std::uint64_t mine = of_block;
    mine += sum_before_in_block<64>((std::uint64_t(incoming) << 32) | (stay + incoming), total);
    __shared__ std::uint32_t near[OrderOfBlock::room];
    auto const begins = static_cast<std::uint32_t>(of_block), items = static_cast<std::uint32_t>(total);
    bool const is_near = items <= OrderOfBlock::room;
    OrderOfBlock const order{is_near ? near : to.order, is_near ? begins : 0};
    auto const first = static_cast<std::uint32_t>(mine);
    ArrivedInCell const came{static_cast<std::uint32_t>(mine >> 32), incoming};
    if (team == 0) {
        to.begin[c] = first;
        to.arrived_begin[c] = came.begin;
        if (block + 1 == blocks && place == 63) {
            to.begin[c + 1] = first + stay + incoming;
            to.arrived_begin[c + 1] = came.begin + incoming;
        }
        keep_those_that_stay(lay, to, order, first);
    }
    if (team == 1 || teams == 1)
        append_incoming<d>(first_incoming, came, leavers, to, order, first + stay, offset);
    if (is_near) {
        __syncthreads();
        for (std::uint32_t i = threadIdx.x; i < items; i += blockDim.x) to.order[begins + i] = near[i];
    }
    return came;
}

/// The same for all blocks.
template <int d, class Leavers>
__global__ void __launch_bounds__(64)
    rearrange(Signal signal, std::uint32_t const* begin, Changes changes, std::uint64_t const* block_begin,
              Leavers leavers, NewOrder to, OffsetsOf<Leavers, d> offset)
{
    if (signal.stops()) return;
    rearrange_block<d>(
        blockIdx.x, gridDim.x, begin, changes, [&](std::uint32_t block) { return block_begin[block]; },
        leavers, to, offset);
}

/// The blocks that a device has of those that several share.
struct PartOfBlocks
{
    std::uint32_t const* list;
    std::uint32_t count;       ///< of these
    unsigned char const* here; ///< per block of all: whether it is one of them
    std::uint32_t all;

    /// How many groups of threads write the beginnings of the cells of those blocks, and of all others.
    unsigned groups() const { return count + groups_of(all, 64); }
};

/// The same where a device has some of the blocks; the others hold no items here.
template <int d, class Leavers>
__global__ void __launch_bounds__(64)
    rearrange_part(Signal signal, std::uint32_t const* begin, Changes changes,
                   std::uint64_t const* block_begin, Leavers leavers, NewOrder to,
                   OffsetsOf<Leavers, d> offset, PartOfBlocks part)
{
    if (signal.stops()) return;
    auto const find_begin = [&](std::uint32_t block) { return block_begin[block]; };
    if (blockIdx.x < part.count) {
        rearrange_block<d>(part.list[blockIdx.x], part.all, begin, changes, find_begin, leavers, to, offset);
        return;
    }
    __shared__ std::uint64_t begins[64];
    __shared__ unsigned char is_here[64];
    std::uint32_t const first = (blockIdx.x - part.count) * 64, mine = first + threadIdx.x;
    if (mine < part.all) {
        begins[threadIdx.x] = block_begin[mine];
        is_here[threadIdx.x] = part.here[mine];
    }
    __syncthreads();
    for (std::uint32_t i = 0; i < 64 && first + i < part.all; ++i) {
        if (is_here[i] != 0) continue;
        std::uint32_t const c = (first + i) * 64 + threadIdx.x;
        auto const items = static_cast<std::uint32_t>(begins[i]),
                   arrived = static_cast<std::uint32_t>(begins[i] >> 32);
        to.begin[c] = items;
        to.arrived_begin[c] = arrived;
        if (first + i + 1 < part.all || threadIdx.x != 63) continue;
        to.begin[c + 1] = items;
        to.arrived_begin[c + 1] = arrived;
    }
}

/// Replaces the places of items by their new ones.
static __global__ void renumber(std::uint32_t* order, std::uint32_t count, std::uint32_t const* place)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) order[i] = place[order[i]];
}

/// Undoes the wrapping of the leavers' offsets.
template <int d, class Number>
__global__ void unwrap(Leavers<Number> leavers, std::array<typename CellOffset<Number>::Stored*, d> offset)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= leavers.counters->rebinned) return;
    std::uint32_t way = leavers.way[i];
    for (int a = d - 1; a >= 0; --a, way /= 3)
        CellOffset<Number>::unwrap(offset[a][leavers.slot[i]], static_cast<int>(way % 3) - 1);
}

} // namespace firn::cuda::detail
