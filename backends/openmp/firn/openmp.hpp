// SPDX-License-Identifier: MIT
#pragma once

#if !defined(_OPENMP)
#error "firn/openmp.hpp needs OpenMP: link the target firn::openmp, or compile and link with -fopenmp."
#endif

#include <firn/core/cell_work.hpp>
#include <firn/core/error.hpp>
#include <firn/openmp/array.hpp>
#include <firn/openmp/cell_order.hpp>
#include <firn/openmp/gather.hpp>
#include <firn/openmp/grid.hpp>
#include <firn/openmp/migrate.hpp>
#include <firn/openmp/native_lane.hpp>
#include <firn/openmp/parallel_for.hpp>
#include <firn/openmp/scatter.hpp>
#include <firn/openmp/update_nodes.hpp>

#include <algorithm>
#include <atomic>
#include <omp.h>
#include <string>

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
    template <class Number, int d, int degree, int sums, int values, int layers, bool own_values = false,
              int ungathered = 0>
    using Grid = openmp::Grid<Number, d, degree, sums, values + ungathered, lane_width<Lane<Number>>, layers,
                              own_values>;

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

    /// The items of all cells gather from the nodes, are updated, move and scatter; the phase says which
    /// of these (see CellWork). Returns the merged results of the updates, if there are any.
    template <class Order, class LayerType, class Phase>
    auto for_each_cell(Order& cells, LayerType& layer, Phase const& phase) const
    {
        using Real = Lane<typename Phase::Number>;
        constexpr CellWork work = Phase::work;
        static_assert(
            work.gathers == (work.scatters_to != ScatterTarget::sums),
            "a phase that gathers scatters to the next sums or to none, another one to the current sums");
        static_assert(!work.moves || (work.gathers && work.scatters_to == ScatterTarget::next_sums),
                      "items that move gather before, and scatter to the next sums");
        openmp::Threads const team = threads_for(cells.size());
        if constexpr (!work.gathers || work.moves) cells.complete(); // usually it is
        if constexpr (!work.gathers)
            openmp::scatter<Real>(team, cells, layer, phase, !phase.adds_to_sums());
        else if constexpr (work.moves)
            return openmp::move<Real>(team, cells, layer, phase);
        else if constexpr (work.scatters_to == ScatterTarget::next_sums)
            openmp::scatter_back<Real>(team, cells, layer, phase);
        else
            openmp::gather<Real>(team, cells, layer, phase);
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
