// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/changes.hpp>
#include <firn/cuda/signal.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/grid/periods.hpp>

#include <array>
#include <cstdint>

// The items that leave their cells: what is listed of them, and how they find their new cells.
namespace firn::cuda::detail
{

/// Counters through which concurrent groups of threads coordinate the leavers.
struct LeaverCounters
{
    std::uint32_t outgoing; ///< leavers of the current step
    std::uint32_t searched; ///< groups of threads that have found new cells
    std::uint32_t live;     ///< blocks that will hold items
    std::uint32_t rebinned; ///< leavers of the step that was rebinned last
};

/// What is loaded of a list at once, 16 bytes.
template <class Number>
struct alignas(16) NumbersAtOnce
{
    static constexpr int count = 16 / int(sizeof(Number));
    Number of[count];
};
/// So many numbers and what fills up the last of these vectors.
template <class Number>
constexpr int in_whole_vectors(int numbers)
{
    constexpr int at_once = NumbersAtOnce<Number>::count;
    return (numbers + at_once - 1) / at_once * at_once;
}

/// Items on their way to other cells.
template <class NumberType>
struct Leavers
{
    using Number = NumberType;
    LeaverCounters* counters;
    std::uint32_t most;   ///< capacity
    int channels;         ///< of a leaver's contribution, in whole vectors
    std::uint32_t* slot;  ///< where the item lies
    std::uint32_t* cell;  ///< where it came from
    std::uint8_t* way;    ///< the neighbour it goes to: three digits of base 3, first axis highest
    std::uint32_t* next;  ///< the next leaver that comes into the same cell, or absent
    Number* contribution; ///< what each leaver scatters in its new cell; leaver by leaver

    /// Those that come into one cell follow one another by this: which neighbour they come from, and where
    /// they lay. Those of one cell lay there in their order. How blocks are numbered is of no account, since
    /// that depends on when each was created.
    FIRN_HOST_DEVICE static std::uint64_t origin_of(std::uint32_t way, std::uint32_t where)
    {
        return std::uint64_t{way} << 32 | where;
    }
    /// The origin of a leaver that lies at `where`.
    __device__ std::uint64_t origin(std::uint32_t leaver, std::uint32_t where) const
    {
        return origin_of(way[leaver], where);
    }
    /// What is no longer needed once leavers have found their new cells.
    std::uint32_t* scratch() const { return cell; }
};

/// The items that came into a cell: a range in the list of leavers by cell.
struct ArrivedInCell
{
    std::uint32_t begin, count;
};

/// Clears the incoming items of `blocks` blocks, and the count of leavers.
struct ArrivalsToForget
{
    Changes changes;
    std::uint32_t blocks;
    LeaverCounters* counters; ///< null if nothing has ever left

    /// Called by groups of 64 threads, at least one per block.
    __device__ void forget(std::uint32_t group) const
    {
        if (group >= blocks) return;
        forget_incoming(changes, group);
        if (group == 0 && threadIdx.x == 0 && counters != nullptr) counters->outgoing = 0;
    }
};

/// Where leavers find their new cells.
template <int d>
struct Destinations
{
    Changes changes;
    BlockSet::View set;
    std::uint64_t const* keys; ///< of blocks
    Periods<d> periods;        ///< of blocks
    int ahead;                 ///< with each missing block, this many beyond it are requested too
    bool at_once;              ///< the loop that moves items also searches; otherwise end_step does
};

/// Adds a leaver to the list of its new cell, and counts it there and in the block. Returns whether the
/// thread counted it, perhaps with others, as the first in the block.
template <class Number>
__device__ bool arrive(Leavers<Number> const& leavers, Changes const& changes, std::uint32_t leaver,
                       std::uint32_t block, std::uint32_t place)
{
    std::uint32_t const cell = block * 64 + place;
    leavers.next[leaver] = atomicExch(changes.first_incoming + cell, leaver);
    atomicAdd(changes.incoming + cell, 1u);
    // neighbouring leavers come into the same few blocks: one atomic per block and warp
    std::uint32_t const with_me = __match_any_sync(__activemask(), block);
    return static_cast<int>(threadIdx.x % 32) == __ffs(static_cast<int>(with_me)) - 1 &&
           atomicAdd(changes.block_arrived + block, static_cast<std::uint32_t>(__popc(with_me))) == 0;
}

/// Where a leaver goes: how many blocks beyond its own, and the place in the block there.
template <int d>
struct WayOut
{
    using Shape = BlockShape<d>;
    Coordinates<d> beyond;
    bool leaves_block = false;
    std::uint32_t place;

    /// From a place in a block, to a neighbour of its cell (see Leavers::way).
    FIRN_HOST_DEVICE WayOut(std::uint32_t from, std::uint32_t way)
    {
        Coordinates<d> cell = Shape::cell(static_cast<int>(from));
        for (int a = d - 1; a >= 0; --a, way /= 3) {
            int const moved = cell[a] + static_cast<int>(way % 3) - 1;
            beyond[a] = moved >> Shape::bits;
            cell[a] = moved & (Shape::extent - 1);
            leaves_block = leaves_block || beyond[a] != 0;
        }
        place = static_cast<std::uint32_t>(Shape::place(cell));
    }

    /// Calls `use(key)` for the missing block there, and for some beyond it.
    template <class Use>
    FIRN_HOST_DEVICE void request(Coordinates<d> const& from, Periods<d> const& periods, int ahead,
                                  Use const& use) const
    {
        for (int i = 1; i <= ahead + 1; ++i) use(block_key<d>(periods.wrapped(from + i * beyond)));
    }
};

/// Finds the new cell of a leaver from the cell `from`, or requests its block.
template <int d, class Number>
__device__ void find_new_cell(Leavers<Number> const& leavers, Destinations<d> const& to, std::uint32_t leaver,
                              std::uint32_t from, std::uint32_t way)
{
    std::uint32_t block = from / BlockShape<d>::cells;
    WayOut<d> const out(from % BlockShape<d>::cells, way);
    if (out.leaves_block) {
        Coordinates<d> const left = block_of_key<d>(to.keys[block]);
        block = to.set.find(block_key<d>(to.periods.wrapped(left + out.beyond)));
        if (block == absent) {
            out.request(left, to.periods, to.ahead, [&](std::uint64_t key) { to.set.want(key); });
            return;
        }
    }
    arrive(leavers, to.changes, leaver, block, out.place);
}

/// The same for new items, which come with their cells.
template <int d, class Number>
__global__ void find_cells(Leavers<Number> leavers, Coordinates<d> const* cells, std::uint32_t first,
                           std::uint32_t count, Changes changes, BlockSet::View set, Periods<d> periods)
{
    using Shape = BlockShape<d>;
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    Coordinates<d> cell, in_block;
    for (int a = 0; a < d; ++a) {
        in_block[a] = cells[i][a] & (Shape::extent - 1);
        cell[a] = cells[i][a] >> Shape::bits;
    }
    std::uint64_t const key = block_key<d>(periods.wrapped(cell)); // of the block
    std::uint32_t const block = set.find(key);
    if (block == absent) {
        set.want(key);
        return;
    }
    leavers.slot[i] = first + i;
    leavers.way[i] = 0; // new items come from no cell, and follow one another by where they lie
    arrive(leavers, changes, i, block, static_cast<std::uint32_t>(Shape::place(in_block)));
}

/// Clears all incoming items and the count of leavers.
static __global__ void __launch_bounds__(64) forget_all_incoming(Signal signal, ArrivalsToForget to_forget)
{
    if (signal.stops()) return;
    to_forget.forget(blockIdx.x);
}

/// Finds the new cells of all leavers; called by each of several groups of threads.
template <int d, class Number>
__device__ void find_new_cells(Leavers<Number> const& leavers, Destinations<d> const& to, std::uint32_t group,
                               std::uint32_t groups)
{
    std::uint32_t const all = leavers.counters->outgoing, noted = all < leavers.most ? all : leavers.most;
    for (std::uint32_t leaver = group * blockDim.x + threadIdx.x; leaver < noted;
         leaver += groups * blockDim.x)
        find_new_cell<d>(leavers, to, leaver, leavers.cell[leaver], leavers.way[leaver]);
}

} // namespace firn::cuda::detail
