// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/readback.hpp>
#include <firn/cuda/signal.hpp>
#include <firn/cuda/teams.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

// The loops that need no nodes: over the places of all items, and over the numbers below a count.
namespace firn::cuda::detail
{

/// Visits all items: at their slots, or where the order says they lie. Tells their slots, too, if the visit
/// asks for them.
template <class Order, class Visit>
__global__ void __launch_bounds__(block_threads)
    for_each_place(Signal signal, Visit visit, typename Order::View cells, bool at_slots)
{
    if (signal.stops()) return;
    std::uint32_t const c = blockIdx.x * block_threads + threadIdx.x;
    auto const cell = cells.cell(c);
    for (std::uint32_t slot = cells.begin[c], end = cells.begin[c + 1]; slot < end; ++slot) {
        std::size_t const place = at_slots ? slot : cells.order[slot];
        if constexpr (std::is_invocable_v<Visit const&, std::size_t, decltype(cell), std::size_t>)
            visit(place, cell, std::size_t{slot});
        else
            visit(place, cell);
    }
}

template <class Body>
__global__ void for_each(Body body, std::size_t count)
{
    std::size_t const i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) body(i);
}

/// The same in a step, whose loops do nothing if steps have stopped.
template <class Body>
__global__ void __launch_bounds__(256, 2) for_each_in_step(Signal signal, Body body, std::size_t count)
{
    if (signal.stops()) return;
    std::size_t const i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count) body(i);
}

/// One of several loops that run one after the other.
template <class Body>
struct LoopInTurn
{
    std::size_t count;
    Body body;
};

inline constexpr unsigned threads_in_turn = 512;

/// Loops that are too short to be spread, one after the other by one group of threads. Unless `body` is
/// NothingBehind, it then merges what a loop over nodes found before, and calls `body` with that.
template <class Result, class Body, class... Bodies>
__global__ void __launch_bounds__(threads_in_turn)
    for_each_in_turn(Partial<Result> of, Body body, LoopInTurn<Bodies>... loops)
{
    __shared__ __align__(16) unsigned char parts[merging_warps * sizeof(Result)];
    wait_for_the_loop_before();
    auto const run = [](auto const& loop) {
        if (loop.count == 0) return;
        for (std::size_t i = threadIdx.x; i < loop.count; i += blockDim.x) loop.body(i);
        __syncthreads();
    };
    (run(loops), ...);
    if constexpr (!std::is_same_v<Body, NothingBehind>)
        merge_in_group(of, reinterpret_cast<Result*>(parts), body);
}

/// Stops the steps of all orders, each of which has a signal, if any of these numbers is not 0.
template <std::size_t orders>
__global__ void stop_steps_if(std::array<Signal, orders> signals, std::uint32_t const* numbers, int count,
                              std::uint32_t* stopped)
{
    if (signals[0].stops()) return;
    bool any = false;
    for (int i = 0; i < count; ++i) any = any || numbers[i] != 0;
    if (!any) return;
    *stopped = 1;
    for (auto const& signal : signals) signal.stop({1, 0, 0, 0});
}

} // namespace firn::cuda::detail
