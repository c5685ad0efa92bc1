// SPDX-License-Identifier: MIT
#pragma once

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
