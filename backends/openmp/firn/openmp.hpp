// SPDX-License-Identifier: MIT
#pragma once

#if !defined(_OPENMP)
#error "firn/openmp.hpp needs OpenMP: link the target firn::openmp, or compile and link with -fopenmp."
#endif

#include <firn/core/error.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/cell_order.hpp>
#include <firn/openmp/grid.hpp>
#include <firn/openmp/lanes.hpp>
#include <firn/openmp/loops.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <omp.h>
#include <string>
#include <tuple>
#include <utility>

namespace firn
{

/// Runs a solver on the cores of this machine: threads work on blocks of cells, SIMD lanes on cells.
///
/// `Lanes` chooses how many numbers a lane of `Number` holds; by default as many as the compile flags allow.
/// Results do not depend on the number of threads.
template <class Lanes = openmp::NativeLanes>
struct BasicOpenMP
{
    int threads = 0;     ///< at most; 0: as many as OpenMP would use, up to 1024
    Executor executor{}; ///< threads of the host, in place of OpenMP's
    static constexpr int most_threads = 1024;
    static constexpr bool reaches_host_memory = true;
    static constexpr bool queues = false; ///< loops have finished when they return

    template <class Number>
    using Lane = typename Lanes::template Lane<Number>;
    template <class T>
    using Array = openmp::Array<T>;
    using SharedCount = std::atomic<int>; ///< several host threads may change it concurrently
    template <class T>
    using ReadbackBuffer = openmp::ReadbackBuffer<T>;
    template <class Number, int d>
    using CellOrder = openmp::CellOrder<Number, d, lane_width<Lane<Number>>>;
    static constexpr int largest_degree = 3; ///< of a stencil, which spans one node more per axis
    template <class Number, int d, int degree, int sums, int values, int layers>
    using Grid = openmp::Grid<Number, d, degree, sums, values, lane_width<Lane<Number>>, layers>;

    void validate() const
    {
        // OpenMP ends the process if the system grants fewer threads than it asks for
        require(threads >= 0 && threads <= most_threads, "the number of threads is outside [0, 1024]",
                "OpenMP", "Pass the number of cores or less, or 0 for as many as OpenMP would use.");
#if defined(__clang__) && defined(FIRN_HAS_XSIMD)
        require(openmp::functions_hold<float>() && openmp::functions_hold<double>(),
                "exponentials of packs are wrong, as -fassociative-math makes them", "OpenMP",
                "Compile with -fno-associative-math behind -ffast-math, or define FIRN_NO_XSIMD.");
#endif
    }

    /// How many steps are worth queueing before the host waits: one, since loops have finished when they
    /// return.
    template <class CellOrders>
    static std::size_t steps_to_queue(CellOrders const&, std::size_t)
    {
        return 1;
    }

    int thread_count() const
    {
        validate(); // for callers without a solver, too
        return threads > 0 ? threads : std::min(omp_get_max_threads(), most_threads);
    }
    openmp::Threads all_threads() const { return {thread_count(), executor}; }
    /// The threads that work on so many items: no more than have enough to do.
    openmp::Threads threads_for(std::size_t items) const
    {
        int const all = thread_count();
        return {openmp::threads_for(items, all), executor};
    }

    /// Calls `body(i)` once for every i in [0, count), in any order and concurrently.
    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        openmp::for_each(all_threads(), count, body);
    }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item.
    template <class Order, class Visit>
    void for_each_place(Order const& cells, Visit const& visit) const
    {
        cells.for_each(visit);
    }

    /// All items scatter to the grid, by `phase.prepare`, `scatter` and `add` (see Scatter): afresh, or onto
    /// the sums that are there.
    template <class Order, class GridType, class Phase>
    void scatter(Order& cells, GridType& grid, Phase const& phase, bool afresh) const
    {
        cells.complete();
        openmp::scatter<Lane<typename Phase::Number>>(threads_for(cells.size()), cells, grid, phase, afresh);
    }

    /// Items that changed cells when they moved scatter to the grid, to which all others already have.
    template <class Phase, class Order, class GridType>
    void scatter_leavers(Order& cells, GridType& grid) const
    {
        openmp::scatter_leavers<Lane<typename Phase::Number>, Phase>(cells, grid);
    }

    /// Calls `phase(node, result)` for every pack of nodes that any layer added to; returns the merged
    /// results.
    template <class CellOrders, class GridType, class Phase>
    auto for_each_node(CellOrders const& orders, GridType& grid, Phase const& phase) const
    {
        return openmp::for_each_node<Lane<typename Phase::Number>>(all_threads(), *orders[0], grid, phase);
    }

    /// All items gather from the grid and scatter in place to the sums that swap() makes current.
    template <class Order, class GridType, class Phase>
    void scatter_back(Order const& cells, GridType& grid, Phase const& phase) const
    {
        openmp::scatter_back<Lane<typename Phase::Number>>(threads_for(cells.size()), cells, grid, phase);
    }

    /// All items gather from the grid as in their last move; the phase stores what it needs of that.
    template <class Order, class GridType, class Phase>
    void gather(Order const& cells, GridType const& grid, Phase const& phase) const
    {
        openmp::gather<Lane<typename Phase::Number>>(threads_for(cells.size()), cells, grid, phase);
    }

    /// The items of all orders of cells, each with its layer and its phase, gather from the grid, move, and
    /// scatter to the grid of the next step (see G2p2g). Then calls `finish(results of the nodes, merged
    /// results of each order)`.
    template <std::size_t orders, class Order, class LayerType, class... Phase, class OfNodes, class Finish>
    void move(std::array<Order*, orders> const& cells, std::array<LayerType, orders> const& layers,
              std::tuple<Phase...> const& phases, OfNodes const& of_nodes, Finish const& finish) const
    {
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            (cells[k]->complete(), ...); // usually they are
            std::tuple const found{openmp::move<Lane<typename Phase::Number>>(
                threads_for(cells[k]->size()), *cells[k], layers[k],
                std::get<k>(phases))...}; // one after the other
            finish(of_nodes, std::get<k>(found)...);
        }
        (std::make_index_sequence<orders>{});
    }
};

/// The OpenMP backend with lanes as wide as the processor compiled for.
using OpenMP = BasicOpenMP<>;

/// What the backend works with here, in one sentence: "OpenMP, 2 threads, 16 float or 8 double lanes".
inline std::string openmp_info()
{
    std::string const lanes = std::to_string(lane_width<openmp::NativeLane<float>>) + " float or " +
                              std::to_string(lane_width<openmp::NativeLane<double>>) + " double lanes";
    return "OpenMP, " + std::to_string(OpenMP{}.thread_count()) + " threads, " + lanes +
           (lane_width<openmp::NativeLane<float>> == 1
                ? " (install xsimd and compile for your processor for more)"
                : "");
}

} // namespace firn
