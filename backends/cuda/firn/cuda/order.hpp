// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/cuda/block_set.hpp>
#include <firn/cuda/finish_step.hpp>
#include <firn/cuda/shared_memory.hpp>
#include <firn/cuda/signal.hpp>
#include <firn/cuda/teams.hpp>
#include <firn/cuda/tuning.hpp>

#include <array>
#include <cstdint>

// The loops that keep the order of cells up to date.
namespace firn::cuda::detail
{

/// Counters through which concurrent groups of threads coordinate the leavers.
struct LeaverCounters
{
    std::uint32_t departed; ///< leavers of the current step
    std::uint32_t searched; ///< groups of threads that have found new cells
    std::uint32_t live;     ///< blocks that will hold items
    std::uint32_t rebinned; ///< leavers of the step that was rebinned last
};

/// Items on their way to other cells.
template <class Number>
struct Leavers
{
    LeaverCounters* counters;
    std::uint32_t most;   ///< capacity
    int channels;         ///< of a leaver's contribution
    std::uint32_t* slot;  ///< where the item lies
    std::uint32_t* cell;  ///< where it came from
    std::uint8_t* way;    ///< the neighbour it goes to: three digits of base 3, first axis highest
    std::uint32_t* next;  ///< the next leaver that comes into the same cell, or absent
    Number* contribution; ///< what each leaver scatters, without its offset; leaver by leaver
};

/// What changes in cells when items move.
struct Changes
{
    std::uint32_t* stay;           ///< per cell: how many items stay
    std::uint32_t* incoming;       ///< per cell: how many items come in
    std::uint32_t* first_incoming; ///< per cell: one of these, or absent
    std::uint32_t* group_left;     ///< per group of cells: how many items leave
    std::uint32_t* block_stay;     ///< per block: how many items stay in their cells
    std::uint32_t* block_arrived;  ///< per block: how many items come into its cells
};

/// Clears the incoming items of a block's cells; called by 64 threads.
static __device__ void forget_incoming(Changes const& changes, std::uint32_t block)
{
    std::uint32_t const c = block * 64 + threadIdx.x;
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    if (threadIdx.x == 0) changes.block_arrived[block] = 0;
}

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
        if (group == 0 && threadIdx.x == 0 && counters != nullptr) counters->departed = 0;
    }
};

/// Where leavers find their new cells.
struct Destinations
{
    Changes changes;
    BlockSet::View set;
    std::uint64_t const* keys; ///< of blocks
    int ahead;                 ///< with each missing block, this many beyond it are requested too
    bool at_once;              ///< the loop that moves items also searches; otherwise end_step does
};

/// Adds a leaver to the list of its new cell, and counts it there and in the block.
template <class Number>
__device__ void arrive(Leavers<Number> const& leavers, Changes const& changes, std::uint32_t leaver,
                       std::uint32_t block, std::uint32_t place)
{
    std::uint32_t const cell = block * 64 + place;
    leavers.next[leaver] = atomicExch(changes.first_incoming + cell, leaver);
    atomicAdd(changes.incoming + cell, 1u);
    // neighbouring leavers come into the same few blocks: one atomic per block and warp
    std::uint32_t const with_me = __match_any_sync(__activemask(), block);
    if (static_cast<int>(threadIdx.x % 32) == __ffs(static_cast<int>(with_me)) - 1)
        atomicAdd(changes.block_arrived + block, static_cast<std::uint32_t>(__popc(with_me)));
}

/// How many blocks may be empty beside `live` occupied ones. With many blocks memory matters; in a `small`
/// scene (see CellOrder::is_small) the host should seldom be needed.
__device__ inline std::uint32_t most_empty_blocks(std::uint32_t live, bool small)
{
    return small ? 32 + 2 * live : live <= 4096 ? 8 + live / 8 : live / 32;
}

/// Finds the new cell of a leaver from the cell `from`, or requests its block.
template <int d, class Number>
__device__ void find_new_cell(Leavers<Number> const& leavers, Destinations const& to, std::uint32_t leaver,
                              std::uint32_t from, std::uint32_t way)
{
    using Shape = BlockShape<d>;
    std::uint32_t block = from / Shape::cells;
    Coordinates<d> cell = Shape::cell(static_cast<int>(from % Shape::cells)), beyond;
    bool leaves_block = false;
    for (int a = d - 1; a >= 0; --a, way /= 3) {
        int const moved = cell[a] + static_cast<int>(way % 3) - 1;
        beyond[a] = moved >> Shape::bits;
        cell[a] = moved & (Shape::extent - 1);
        leaves_block = leaves_block || beyond[a] != 0;
    }
    if (leaves_block) {
        Coordinates<d> const there = block_of_key<d>(to.keys[block]) + beyond;
        std::uint64_t const key = block_key<d>(there);
        block = to.set.find(key);
        if (block == absent) {
            to.set.want(key);
            for (int i = 1; i <= to.ahead; ++i) to.set.want(block_key<d>(there + i * beyond));
            return;
        }
    }
    arrive(leavers, to.changes, leaver, block, static_cast<std::uint32_t>(Shape::place(cell)));
}

/// The same for new items, which come with their cells.
template <int d, class Number>
__global__ void find_cells(Leavers<Number> leavers, std::array<int, d> const* cells, std::uint32_t first,
                           std::uint32_t count, Changes changes, BlockSet::View set)
{
    using Shape = BlockShape<d>;
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= count) return;
    Coordinates<d> cell, in_block;
    for (int a = 0; a < d; ++a) {
        in_block[a] = cells[i][a] & (Shape::extent - 1);
        cell[a] = cells[i][a] >> Shape::bits;
    }
    std::uint64_t const key = block_key<d>(cell);
    std::uint32_t const block = set.find(key);
    if (block == absent) {
        set.want(key);
        return;
    }
    leavers.slot[i] = first + i;
    arrive(leavers, changes, i, block, static_cast<std::uint32_t>(Shape::place(in_block)));
}

/// Clears all incoming items and the count of leavers.
static __global__ void __launch_bounds__(64) forget_all_incoming(Signal signal, ArrivalsToForget to_forget)
{
    if (signal.stops()) return;
    to_forget.forget(blockIdx.x);
}

/// Cells of new blocks are empty and begin behind all items; nothing comes into any cell.
static __global__ void clear_cells(std::uint32_t first, std::uint32_t cells, std::uint32_t items,
                                   std::uint32_t* begin, Changes changes)
{
    std::uint32_t const c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= cells) return;
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    if (c % 64 == 0) changes.block_arrived[c / 64] = 0;
    if (c < first) return;
    if (c == 0) begin[0] = items;
    begin[c + 1] = items;
    changes.stay[c] = 0;
    if (c % 32 == 0) changes.group_left[c / 32] = 0;
    if (c % 64 == 0) changes.block_stay[c / 64] = 0;
}

/// The changes if no item moves.
static __global__ void stay_all(std::uint32_t const* begin, std::uint32_t cells, Changes changes)
{
    std::uint32_t const c = blockIdx.x * blockDim.x + threadIdx.x;
    if (c >= cells) return;
    changes.stay[c] = begin[c + 1] - begin[c];
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    if (c % 32 == 0) changes.group_left[c / 32] = 0;
    if (c % 64 != 0) return;
    changes.block_stay[c / 64] = begin[c + 64] - begin[c];
    changes.block_arrived[c / 64] = 0;
}

/// The changes if items are erased and none moves: those for which `gone[where it lies]` is not 0. `order`
/// says where items lie; null: at their slots.
static __global__ void __launch_bounds__(64)
    leave(std::uint32_t const* begin, std::uint32_t const* order, unsigned char const* gone, Changes changes,
          unsigned char* left)
{
    __shared__ std::uint32_t block_stays;
    if (threadIdx.x == 0) block_stays = 0;
    __syncthreads();
    std::uint32_t const c = blockIdx.x * 64 + threadIdx.x, first = begin[c], count = begin[c + 1] - first,
                        below = (1u << threadIdx.x % 32) - 1;
    std::uint32_t slot = begin[c - threadIdx.x % 32], stay = count;
    for (std::uint32_t rank = 0;; ++rank) {
        std::uint32_t const pattern = __ballot_sync(~0u, rank < count);
        if (pattern == 0) break;
        std::uint32_t const here = slot + __popc(pattern & below);
        slot += __popc(pattern);
        if (rank >= count) continue;
        bool const leaves = gone[order ? order[first + rank] : here] != 0;
        left[here] = leaves;
        stay -= leaves;
    }
    changes.stay[c] = stay;
    changes.incoming[c] = 0;
    changes.first_incoming[c] = absent;
    bool const some_leave = __any_sync(~0u, stay < count);
    if (c % 32 == 0) changes.group_left[c / 32] = some_leave;
    atomicAdd(&block_stays, stay);
    __syncthreads();
    if (threadIdx.x != 0) return;
    changes.block_stay[blockIdx.x] = block_stays;
    changes.block_arrived[blockIdx.x] = 0;
}

/// Replaces the places of items by their new ones.
static __global__ void renumber(std::uint32_t* order, std::uint32_t count, std::uint32_t const* place)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) order[i] = place[order[i]];
}

/// The sum of a value over the warp's lanes before this one; `total` becomes the sum over all.
__device__ inline std::uint64_t sum_before(std::uint64_t value, std::uint64_t& total)
{
    int const lane = static_cast<int>(threadIdx.x % 32);
    std::uint64_t sum = value;
    for (int step = 1; step < 32; step *= 2) {
        std::uint64_t const other = __shfl_up_sync(~0u, sum, step);
        if (lane >= step) sum += other;
    }
    total = __shfl_sync(~0u, sum, 31);
    return sum - value;
}

/// The same over the first `threads` threads of a group. Each further set of that many holds the same values
/// and gets the same sums.
template <int threads>
__device__ std::uint64_t sum_before_in_block(std::uint64_t value, std::uint64_t& total)
{
    __shared__ std::uint64_t of_warp[threads / 32];
    std::uint64_t of_mine;
    std::uint64_t before = sum_before(value, of_mine);
    if (threadIdx.x < threads && threadIdx.x % 32 == 31) of_warp[threadIdx.x / 32] = of_mine;
    __syncthreads();
    total = 0;
    for (unsigned w = 0; w < threads / 32; ++w) {
        if (w < threadIdx.x % threads / 32) before += of_warp[w];
        total += of_warp[w];
    }
    __syncthreads();
    return before;
}

inline constexpr int scanned_at_once = 8;

/// Where each block's items, and its incoming items, begin.
struct BlockBegins
{
    std::uint32_t blocks;
    std::uint64_t* of_block; ///< both counts in one number, items in the lower half
};

/// Finds them with one group of threads, since blocks are few. Returns how many hold items.
__device__ inline std::uint32_t find_block_begins(BlockBegins const& begins, Changes const& changes)
{
    std::uint32_t const blocks = begins.blocks;
    std::uint64_t before = 0;
    std::uint32_t live = 0;
    for (std::uint32_t first = 0; first < blocks; first += scanning_threads * scanned_at_once) {
        std::uint64_t count[scanned_at_once], sum = 0;
#pragma unroll
        for (int i = 0; i < scanned_at_once; ++i) {
            std::uint32_t const b = first + threadIdx.x * scanned_at_once + static_cast<std::uint32_t>(i);
            count[i] = 0;
            if (b >= blocks) continue;
            std::uint32_t const arrived =
                __ldcg(changes.block_arrived + b); // other multiprocessors have just counted it
            count[i] = (std::uint64_t(arrived) << 32) | (changes.block_stay[b] + arrived);
            live += count[i] != 0;
        }
#pragma unroll
        for (int i = 0; i < scanned_at_once; ++i) sum += count[i];
        std::uint64_t total;
        std::uint64_t mine = before + sum_before_in_block<scanning_threads>(sum, total);
#pragma unroll
        for (int i = 0; i < scanned_at_once; ++i) {
            std::uint32_t const b = first + threadIdx.x * scanned_at_once + static_cast<std::uint32_t>(i);
            if (b < blocks) begins.of_block[b] = mine;
            mine += count[i];
        }
        before += total;
    }
    std::uint64_t all_live;
    sum_before_in_block<scanning_threads>(live, all_live);
    return static_cast<std::uint32_t>(all_live);
}

/// The same as a loop of its own.
static __global__ void __launch_bounds__(scanning_threads)
    find_all_block_begins(BlockBegins begins, Changes changes)
{
    find_block_begins(begins, changes);
}

/// For one thread of a group: whether `count - 1` groups were here before. What they wrote is then visible.
__device__ inline bool comes_last(std::uint32_t* arrived, std::uint32_t count)
{
    __threadfence();
    bool const last = atomicAdd(arrived, 1u) + 1 == count;
    __threadfence();
    if (last) *arrived = 0;
    return last;
}

/// Finds the new cells of all leavers; called by each of several groups of threads.
template <int d, class Number>
__device__ void find_new_cells(Leavers<Number> const& leavers, Destinations const& to, std::uint32_t group,
                               std::uint32_t groups)
{
    std::uint32_t const all = leavers.counters->departed, noted = all < leavers.most ? all : leavers.most;
    for (std::uint32_t leaver = group * blockDim.x + threadIdx.x; leaver < noted;
         leaver += groups * blockDim.x)
        find_new_cell<d>(leavers, to, leaver, leavers.cell[leaver], leavers.way[leaver]);
}

/// An order of cells after its items have moved.
template <int dimension, class Number>
struct MovedOrder
{
    static constexpr int d = dimension;

    Signal signal;
    Leavers<Number> leavers;
    Destinations to;
    bool is_to_find;    ///< the loop that moved the leavers did not find their new cells
    BlockBegins begins; ///< no blocks: there are no items
    bool small;

    /// What there was no room for: what the host is told if steps stop.
    __device__ Stop lacking() const
    {
        if (begins.blocks == 0) return {1, 0, 0, 0};
        return {1, __ldcg(&leavers.counters->departed), __ldcg(to.set.born_count), 0};
    }
    __device__ bool lacks_room(Stop const& what) const
    {
        return what.departed > leavers.most || what.births > 0;
    }
    /// Never where no block holds items: the blocks are then kept for items that may come.
    __device__ bool is_crowded(std::uint32_t live) const
    {
        return live > 0 && begins.blocks > live + most_empty_blocks(live, small);
    }
};

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
        of[k].leavers.counters->rebinned = why[k].departed;
        why[k].crowded = !lack && of[k].is_crowded(__ldcg(&of[k].leavers.counters->live));
        crowded = crowded || why[k].crowded != 0;
    }
    if (__ldcg(signal.words + 3) != 0 && !lack && !crowded) return;
#pragma unroll
    for (int k = 0; k < orders; ++k) of[k].signal.stop(why[k]);
}

/// Lists the blocks that hold items, in their order.
static __global__ void __launch_bounds__(scanning_threads)
    find_live_blocks(std::uint32_t const* begin, std::uint32_t blocks, std::uint32_t* live,
                     std::uint32_t* live_count)
{
    std::uint32_t before = 0;
    for (std::uint32_t first = 0; first < blocks; first += scanning_threads) {
        std::uint32_t const b = first + threadIdx.x;
        bool const holds = b < blocks && begin[(b + 1) * 64] > begin[b * 64];
        std::uint64_t total;
        std::uint64_t const mine = sum_before_in_block<scanning_threads>(holds, total);
        if (holds) live[before + mine] = b;
        before += static_cast<std::uint32_t>(total);
    }
    if (threadIdx.x == 0) *live_count = before;
}

/// Copies the cells of the blocks that stay to their new places.
static __global__ void keep_blocks(std::uint32_t const* blocks_before, std::uint32_t const* begin,
                                   std::uint32_t const* arrived_begin, std::uint32_t* new_begin,
                                   std::uint32_t* new_arrived_begin)
{
    std::uint32_t const from = blocks_before[blockIdx.x] * 64 + threadIdx.x,
                        to = blockIdx.x * 64 + threadIdx.x;
    new_begin[to] = begin[from];
    new_arrived_begin[to] = arrived_begin[from];
    if (blockIdx.x + 1 != gridDim.x || threadIdx.x != 63) return;
    new_begin[to + 1] = begin[from + 1];
    new_arrived_begin[to + 1] = arrived_begin[from + 1];
}

/// Orders the incoming items of one crowded cell by where they lie, on one warp.
template <class Number>
__device__ void sort_crowd(Leavers<Number> const& leavers, std::uint32_t* arrived, std::uint32_t* spare,
                           std::uint32_t count)
{
    for (std::uint32_t i = threadIdx.x % 32; i < count; i += 32) {
        std::uint32_t const item = arrived[i], slot = leavers.slot[item];
        std::uint32_t rank = 0;
        for (std::uint32_t j = 0; j < count; ++j) rank += leavers.slot[arrived[j]] < slot;
        spare[rank] = item;
    }
    __syncwarp();
    for (std::uint32_t i = threadIdx.x % 32; i < count; i += 32) arrived[i] = spare[i];
    __syncwarp();
}

/// The items that came into a cell: a range in the list of leavers by cell.
struct ArrivedInCell
{
    std::uint32_t begin, count;
};

/// Where the new order is written, and what it is written from.
struct NewOrder
{
    std::uint32_t const* source; ///< where items lie, cell by cell; null: at their slots
    unsigned char const* left;   ///< per slot: whether the item left; null: none did
    std::uint32_t* begin;        ///< per cell
    std::uint32_t* arrived_begin;
    std::uint32_t* arrived; ///< list of leavers by cell
    std::uint32_t* order;
    std::uint32_t* spare; ///< scratch for as many as come in
};

/// The items that lay in the thread's cell before.
struct StayedInCell
{
    std::uint32_t begin, count;
    std::uint32_t slot; ///< of the first item of the 32 cells
    bool all_stay;

    __device__ StayedInCell(std::uint32_t const* begins, std::uint32_t c, Changes const& changes,
                            bool none_left)
    {
        begin = begins[c];
        count = begins[c + 1] - begin;
        slot = begins[c - threadIdx.x % 32];
        all_stay = none_left || changes.group_left[c / 32] == 0;
    }
};

/// Writes the items that stay, in the order in which they lie, from `at` on, 32 cells at a time. Eight loads
/// are in flight at once to hide the latency of memory.
static __device__ void keep_those_that_stay(StayedInCell const& lay, NewOrder const& to, std::uint32_t at)
{
    constexpr int at_once = 8;
    std::uint32_t const below = (1u << threadIdx.x % 32) - 1;
    std::uint32_t slot = lay.slot;
    for (std::uint32_t rank = 0; __any_sync(~0u, rank < lay.count); rank += at_once) {
        std::uint32_t here[at_once];
        bool stays[at_once];
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i) {
            std::uint32_t const pattern = __ballot_sync(~0u, rank + i < lay.count);
            here[i] = slot + __popc(pattern & below);
            slot += __popc(pattern);
            stays[i] = rank + i < lay.count && (lay.all_stay || to.left[here[i]] == 0);
        }
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i)
            if (stays[i]) to.order[at++] = to.source ? to.source[lay.begin + rank + i] : here[i];
    }
}

/// Writes the items that come into the thread's cell, in the order in which they lie, from `at` on, and into
/// the list of leavers by cell. They come as a linked list in any order: each is inserted into a sorted list
/// in shared memory while the next one is loaded. Wraps their offsets into the new cells.
template <int d, class Number>
__device__ void append_incoming(std::uint32_t first_incoming, ArrivedInCell came,
                                Leavers<Number> const& leavers, NewOrder const& to, std::uint32_t at,
                                std::array<typename CellOffset<Number>::Stored*, d> const& offset)
{
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
            for (; place > 0 && near[1][place - 1][own] > where; --place)
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
        to.order[at + i] = came.count <= few ? near[1][i][own] : leavers.slot[arrived[i]];
    }
}

/// Writes a block's new cells and its part of the new order: items that stay keep their order within the
/// cell, incoming ones follow in the order in which they lie. One team of 64 threads does all of it; of
/// several teams, the second appends the incoming items while the first writes those that stay.
template <int d, class Number, class FindBegin>
__device__ ArrivedInCell rearrange_block(std::uint32_t block, std::uint32_t blocks,
                                         std::uint32_t const* begin, Changes const& changes,
                                         FindBegin const& find_begin, Leavers<Number> const& leavers,
                                         NewOrder const& to,
                                         std::array<typename CellOffset<Number>::Stored*, d> const& offset,
                                         std::uint32_t teams = 1)
{
    std::uint32_t const team = teams == 1 ? 0 : threadIdx.x / 64, place = threadIdx.x % 64;
    std::uint32_t const c = block * 64 + place;
    std::uint32_t const incoming = changes.incoming[c], stay = changes.stay[c],
                        first_incoming = changes.first_incoming[c];
    StayedInCell const lay(begin, c, changes,
                           to.left == nullptr); // loaded before threads wait for one another
    std::uint64_t total;
    std::uint64_t mine = find_begin(block);
    mine += sum_before_in_block<64>((std::uint64_t(incoming) << 32) | (stay + incoming), total);
    auto const first = static_cast<std::uint32_t>(mine);
    ArrivedInCell const came{static_cast<std::uint32_t>(mine >> 32), incoming};
    if (team == 0) {
        to.begin[c] = first;
        to.arrived_begin[c] = came.begin;
        if (block + 1 == blocks && place == 63) {
            to.begin[c + 1] = first + stay + incoming;
            to.arrived_begin[c + 1] = came.begin + incoming;
        }
        keep_those_that_stay(lay, to, first);
    }
    if (team == 1 || teams == 1) append_incoming<d>(first_incoming, came, leavers, to, first + stay, offset);
    return came;
}

/// The same for all blocks.
template <int d, class Number>
__global__ void __launch_bounds__(64)
    rearrange(Signal signal, std::uint32_t const* begin, Changes changes, std::uint64_t const* block_begin,
              Leavers<Number> leavers, NewOrder to,
              std::array<typename CellOffset<Number>::Stored*, d> offset)
{
    if (signal.stops()) return;
    rearrange_block<d>(
        blockIdx.x, gridDim.x, begin, changes, [&](std::uint32_t block) { return block_begin[block]; },
        leavers, to, offset);
}

/// Where a block's items, and its incoming items, begin. With few blocks each group of threads finds it by
/// itself.
__device__ inline std::uint64_t find_block_begin(std::uint32_t block, Changes const& changes)
{
    __shared__ std::uint64_t of_warp[most_teams_that_rebin * 2];
    std::uint64_t sum = 0;
#pragma unroll 4
    for (std::uint32_t b = threadIdx.x; b < block; b += blockDim.x) {
        std::uint32_t const arrived = __ldcg(changes.block_arrived + b);
        sum += (std::uint64_t(arrived) << 32) | (changes.block_stay[b] + arrived);
    }
    sum_before(sum, sum);
    if (threadIdx.x % 32 == 0) of_warp[threadIdx.x / 32] = sum;
    __syncthreads();
    sum = 0;
    for (std::uint32_t w = 0; w < blockDim.x / 32; ++w) sum += of_warp[w];
    return sum;
}

/// How many blocks will hold items, counted by all threads of a group; the first thread gets the result.
__device__ inline std::uint32_t count_live_blocks(std::uint32_t blocks, Changes const& changes)
{
    __shared__ std::uint32_t count;
    if (threadIdx.x == 0) count = 0;
    __syncthreads();
    std::uint32_t live = 0;
#pragma unroll 4
    for (std::uint32_t b = threadIdx.x; b < blocks; b += blockDim.x)
        live += changes.block_stay[b] + __ldcg(changes.block_arrived + b) > 0;
    atomicAdd(&count, live);
    __syncthreads();
    return count;
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
    order.leavers.counters->rebinned = why.departed;
    why.crowded = !lacks && order.is_crowded(live);
    if (lacks)
        signal.stop(why);
    else if (!goes_on || why.crowded != 0)
        signal.stop_behind(number, {1, 0, 0, why.crowded});
    signal.has_chosen(number);
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
