// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/cuda/block_set.hpp>
#include <firn/cuda/scan.hpp>
#include <firn/cuda/tuning.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/periods.hpp>

#include <cstdint>
#include <utility>

// Blocks that hold no items: how many may stay, how the others are dropped, and which are created early.
namespace firn::cuda::detail
{

/// How many blocks may be empty beside `live` occupied ones. With many blocks memory matters; in a `small`
/// scene (see CellOrder::is_small) and in one that `spreads` (see RateOfBirths) the host should seldom be
/// needed.
FIRN_HOST_DEVICE inline std::uint32_t most_empty_blocks(std::uint32_t live, bool small, bool spreads = false)
{
    return small ? 32 + 2 * live : spreads ? 8 + live / 2 : live <= 4096 ? 8 + live / 8 : live / 32;
}

/// Whether a scene spreads: blocks are missing in more than 8 of 32 steps, so that the host is needed often.
/// A body that flies needs blocks in one or two steps of forty.
class RateOfBirths
{
public:
    void count_step() { ++steps_; }
    void undo_steps(int count) { steps_ -= count; }
    /// Called for a step in which blocks were missing.
    void count_births()
    {
        if (std::exchange(last_, steps_) == steps_) return; // again, since there was no room for them
        // a scene that was found to spread has fewer of them, and is asked again after many steps
        if (steps_ - since_ > (spreads_ ? asked_again_after : 32)) {
            spreads_ = false;
            since_ = steps_;
            with_births_ = 0;
        }
        if (!spreads_ && ++with_births_ > 8) {
            spreads_ = true;
            since_ = steps_;
        }
    }
    /// A scene in which no blocks are missing any more is not asked, and no longer spreads after as many
    /// steps.
    bool spreads() const { return spreads_ && steps_ - since_ <= asked_again_after; }

private:
    static constexpr std::int64_t asked_again_after = 512;
    std::int64_t steps_ = 0, since_ = 0, last_ = -1;
    int with_births_ = 0;
    bool spreads_ = false;
};

/// Requests the missing blocks around each block that items reach as soon as they leave one of its outer
/// cells. An item elsewhere crosses a cell first, for which it takes ten steps or more in most scenes.
template <int d>
__global__ void __launch_bounds__(64)
    want_around(std::uint64_t const* keys, std::uint32_t const* begin, BlockSet::View set, Periods<d> periods)
{
    constexpr int ways = d == 3 ? 27 : 9; // three digits of base 3, as of Leavers::way
    using Shape = BlockShape<d>;
    __shared__ bool holds[Shape::cells];
    std::uint32_t const c = blockIdx.x * Shape::cells + threadIdx.x;
    holds[threadIdx.x] = begin[c + 1] > begin[c];
    __syncthreads();
    if (threadIdx.x >= ways) return;
    Coordinates<d> way;
    for (int a = d - 1, rest = static_cast<int>(threadIdx.x); a >= 0; --a, rest /= 3) way[a] = rest % 3 - 1;
    bool is_reached = false;
    for (int place = 0; place < Shape::cells; ++place) {
        Coordinates<d> const next = Shape::cell(place) + way;
        bool leads_there = holds[place];
        for (int a = 0; a < d; ++a) leads_there = leads_there && next[a] >> Shape::bits == way[a];
        is_reached = is_reached || leads_there;
    }
    if (is_reached) set.want(block_key<d>(periods.wrapped(block_of_key<d>(keys[blockIdx.x]) + way)));
}

/// The same, and returns how many blocks are missing then, with those that were requested before.
template <int d>
std::uint32_t missing_around(Queue const& queue, BlockSet& set, std::uint32_t const* begin,
                             Periods<d> const& periods)
{
    launch_after("want_around", queue, want_around<d>, set.size(), 64, set.keys(), begin, set.view(),
                 periods);
    return set.births();
}

/// Counts the blocks that hold items.
static __global__ void count_live_blocks(std::uint32_t const* begin, std::uint32_t blocks,
                                         std::uint32_t* live_count)
{
    std::uint32_t const b = blockIdx.x * blockDim.x + threadIdx.x;
    bool const holds = b < blocks && begin[(b + 1) * 64] > begin[b * 64];
    std::uint32_t const with_me = __ballot_sync(~0u, holds);
    if (threadIdx.x % 32 == 0) atomicAdd(live_count, static_cast<std::uint32_t>(__popc(with_me)));
}

/// Lists the blocks that hold items, in their order.
static __global__ void __launch_bounds__(scanning_threads)
    find_live_blocks(std::uint32_t const* begin, std::uint32_t blocks, std::uint32_t* live,
                     std::uint32_t* live_count)
{
    constexpr unsigned at_once = 8; // loads in flight
    std::uint32_t before = 0;
    for (std::uint32_t first = 0; first < blocks; first += at_once * scanning_threads) {
        bool holds[at_once];
        std::uint64_t count = 0, total;
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i) {
            std::uint32_t const b = first + threadIdx.x * at_once + i;
            holds[i] = b < blocks && begin[(b + 1) * 64] > begin[b * 64];
        }
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i) count += holds[i];
        std::uint32_t to =
            before + static_cast<std::uint32_t>(sum_before_in_block<scanning_threads>(count, total));
#pragma unroll
        for (unsigned i = 0; i < at_once; ++i)
            if (holds[i]) live[to++] = first + threadIdx.x * at_once + i;
        before += static_cast<std::uint32_t>(total);
    }
    if (threadIdx.x == 0) *live_count = before;
}

/// Lists them at `to`. Returns how many there are.
inline std::uint32_t list_live_blocks(Queue const& queue, std::uint32_t const* begin, std::uint32_t blocks,
                                      Array<std::uint32_t>& to)
{
    to.renew(std::size_t(blocks) + 1); // one more for their count
    launch_after("find_live_blocks", queue, find_live_blocks, 1, scanning_threads, begin, blocks, to.data(),
                 to.data() + blocks);
    std::uint32_t count = 0;
    to.download(blocks, {&count, 1});
    return count;
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

} // namespace firn::cuda::detail
