// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/core/error.hpp>
#include <firn/core/queue_outcome.hpp>
#include <firn/cuda/array.hpp>
#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/for_each.hpp>
#include <firn/cuda/gather.hpp>
#include <firn/cuda/grid.hpp>
#include <firn/cuda/run_steps.hpp>
#include <firn/cuda/scatter.hpp>
#include <firn/cuda/update_nodes.hpp>
#include <firn/cuda/watched_number.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <string>
#include <tuple>
#include <type_traits>

namespace firn
{

/// Runs a solver on a device: a group of threads works on a block of cells, each on some of its particles,
/// and then on one of its cells.
///
/// Work is queued in the caller's stream, or in the default one. Results do not depend on how the device
/// schedules its work: every run gives the same bits.
struct Cuda
{
    int device = 0;                ///< as cudaGetDeviceProperties counts them
    cudaStream_t stream = nullptr; ///< of that device; it must live as long as the solver
    std::size_t batch = 64;        ///< steps queued at most before the host waits: 1 to most_batch
    static constexpr std::size_t most_batch = 65536;
    static constexpr bool reaches_host_memory = false;
    static constexpr bool queues = true; ///< loops may still be at work when a call returns

    template <class Number>
    using Lane = Number;
    template <class T>
    using Array = cuda::Array<T>;
    using SharedCount = std::atomic<int>; ///< several host threads may change it concurrently
    template <class T>
    using ReadbackBuffer = cuda::ReadbackBuffer<T>;
    template <class Body>
    using LoopInTurn = cuda::detail::LoopInTurn<Body>;
    using WatchedNumber = cuda::WatchedNumber;
    template <class Number, int d>
    using CellOrder = cuda::CellOrder<Number, d>;
    static constexpr int largest_degree = 3; ///< of a stencil, which spans one node more per axis
    template <class Number, int d, int degree, int sums, int values, int layers, bool own_values = false,
              int ungathered = 0>
    using Grid = cuda::Grid<Number, d, degree, sums, values, layers, own_values, ungathered>;

    cuda::Queue queue() const { return {device, stream}; }

    /// How many steps are worth queueing. If the order of cells does not rebin early, the host learns only at
    /// the end of a batch that steps have stopped. With many blocks, loops queued in vain then cost more and
    /// waiting for the host costs less; half of `blindly` has gone well before. With early rebinning
    /// the host finds out in time.
    template <class Order, std::size_t orders>
    std::size_t steps_to_queue(std::array<Order*, orders> const& cells, std::size_t blindly) const
    {
        if (orders == 1 && cells[0]->rebins_early()) return batch;
        std::size_t blocks = 0;
        for (Order const* const order : cells) blocks += order->blocks();
        return std::min({batch, blindly, 2 + 40000 / (4000 + blocks)});
    }

    /// Whether loops can access this address: memory of a device, host memory that is mapped for devices, or
    /// any memory where the system lets devices access the host's.
    bool reaches(void const* there) const
    {
        cuda::OnDevice const here(device);
        cudaPointerAttributes about{};
        cuda::check(cudaPointerGetAttributes(&about, there), "cudaPointerGetAttributes");
        if (about.type != cudaMemoryTypeUnregistered) return about.devicePointer != nullptr;
        int all = 0;
        cuda::check(cudaDeviceGetAttribute(&all, cudaDevAttrPageableMemoryAccess, device),
                    "cudaDeviceGetAttribute");
        return all != 0;
    }

    /// Throws an Error unless there is such a device and a driver for it.
    void validate() const
    {
        require(batch > 0, "no step would be queued", "Cuda", "Pass a batch of 1 or more.");
        require(batch <= most_batch, "there is no room to tell of so many steps", "Cuda",
                "Pass a batch of 65 536 or less: tens are as fast.");
        int devices = 0;
        cudaError_t const status = cudaGetDeviceCount(&devices);
        if (status != cudaSuccess) static_cast<void>(cudaGetLastError());
        if (status == cudaErrorInsufficientDriver)
            throw Error{"there is no driver for CUDA devices, or it is too old for this program", "Cuda",
                        "Install a driver for CUDA " + std::to_string(CUDART_VERSION / 1000) +
                            " or newer, or use another backend."};
        if (status == cudaErrorNoDevice || (status == cudaSuccess && devices == 0))
            throw Error{"there is no CUDA device", "Cuda", "Use another backend."};
        cuda::check(status, "cudaGetDeviceCount");
        if (device < 0 || device >= devices)
            throw Error{"there is no CUDA device " + std::to_string(device), "Cuda",
                        "Pass the number of a device: there are " + std::to_string(devices) + ", from 0 on."};
    }

    /// Calls `body(i)` once for every i in [0, count), in any order and concurrently; `body` is a function
    /// object that a device can call.
    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        if (count == 0) return;
        cuda::OnDevice const here(device);
        unsigned const threads = count < 65536 ? 64 : 256; // few of them spread over all multiprocessors
        cuda::launch_after("for_each", queue(), cuda::detail::for_each<Body>, cuda::groups_of(count, threads),
                           threads, body, count);
    }

    /// The same for a loop that a queued step has beside those over nodes and cells: it does nothing if steps
    /// have stopped.
    template <class Order, std::size_t orders, class Body>
    void for_each_in_step(std::array<Order*, orders> const& cells, std::size_t count, Body const& body) const
    {
        if (count == 0) return;
        cuda::OnDevice const here(device);
        // in small groups, so that a loop of some 100 000 parts has room on a large device at once
        unsigned const threads = count < (1u << 18) ? 64 : 256;
        cuda::detail::launch("for_each_in_step", queue(), cuda::detail::for_each_in_step<Body>,
                             cuda::groups_of(count, threads), threads, 0, cells[0]->signal(), body, count);
    }

    /// Queues that steps stop if any of these numbers is not 0: loops behind do nothing until the host has
    /// polled. Then `stopped` becomes 1.
    template <class Order, std::size_t orders>
    void stop_steps_if(std::array<Order*, orders> const& cells, std::uint32_t const* numbers, int count,
                       std::uint32_t* stopped) const
    {
        cuda::OnDevice const here(device);
        std::array<cuda::detail::Signal, orders> signals;
        for (std::size_t k = 0; k < orders; ++k) signals[k] = cells[k]->signal();
        cuda::detail::launch("stop_steps_if", queue(), cuda::detail::stop_steps_if<orders>, 1u, 1u, 0,
                             signals, numbers, count, stopped);
    }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item, on the device.
    template <class Order, class Visit>
    void for_each_place(Order const& cells, Visit const& visit) const
    {
        if (cells.size() == 0) return;
        cuda::OnDevice const here(device);
        cuda::detail::launch("for_each_place", queue(), cuda::detail::for_each_place<Order, Visit>,
                             cells.blocks(), cuda::detail::block_threads, 0, cells.signal(), visit,
                             cells.view(), cells.committed());
    }

    /// The items of all cells gather from the nodes, are updated and scatter; the phase says which of
    /// these (see CellWork). Items move in run_steps() alone.
    template <class Order, class AnyLayer, class Phase>
    void for_each_cell(Order const& cells, AnyLayer& layer, Phase const& phase) const
    {
        using LayerType = std::remove_const_t<AnyLayer>;
        constexpr CellWork work = Phase::work;
        static_assert(
            work.gathers == (work.scatters_to != ScatterTarget::sums),
            "a phase that gathers scatters to the next sums or to none, another one to the current sums");
        static_assert(!work.moves, "items move in run_steps() alone");
        std::uint32_t const groups = cells.groups(layer.blocks());
        if (groups == 0) return;
        cuda::OnDevice const here(device);
        using Items = cuda::detail::ShapeOfItems<LayerType, Phase>;
        constexpr bool scatters = work.scatters_to != ScatterTarget::nothing;
        auto const launch = [&](char const* name, auto* loop, auto const&... more) {
            cuda::detail::launch(name, queue(), loop, groups, Items::team_threads, Items::bytes(),
                                 cells.signal(), phase, cells.view(), layer.view(), more...);
        };
        if constexpr (!work.gathers)
            launch("scatter", cuda::detail::scatter<Order, LayerType, Phase>, !phase.adds_to_sums());
        else if constexpr (scatters)
            launch("scatter_back", cuda::detail::scatter_back<Order, LayerType, Phase>);
        else
            launch("gather", cuda::detail::gather<Order, LayerType, Phase>);
    }

    /// Items that changed cells when they moved scatter to the grid, to which all others already have.
    template <class Phase, class Order, class LayerType>
    void scatter_leavers(Order const& cells, LayerType& layer) const
    {
        cuda::OnDevice const here(device);
        cuda::detail::start_scattering_leavers<Phase>(cells, layer);
    }

    /// Calls `phase(node, result)` for every node that any layer added to; the merged result becomes known
    /// once the items have moved. If `behind` is passed, the same loop calls it once with the merged result,
    /// as call_with() would.
    template <class Order, std::size_t orders, class GridType, class Phase,
              class Behind = cuda::detail::NothingBehind>
    cuda::Partial<typename Phase::Result> for_each_node(std::array<Order*, orders> const& cells,
                                                        GridType& grid, Phase const& phase,
                                                        Behind const& behind = {}) const
    {
        using Result = typename Phase::Result;
        if (grid.node_blocks() == 0) return {};
        cuda::OnDevice const here(device);
        auto const results = grid.node_results().template expect<Result>(grid.node_blocks());
        if (grid.groups() == 0) return grid.node_results().template partial<Result>();
        std::array<cuda::detail::ArrivalsToForget, orders> to_forget;
        for (std::size_t k = 0; k < orders; ++k)
            to_forget[k] = cells[k]->forget_incoming_on_the_way(grid.groups());
        auto const loop = [&](auto const& blocks) {
            using Blocks = std::remove_cvref_t<decltype(blocks)>;
            cuda::detail::launch("for_each_node", queue(),
                                 cuda::detail::for_each_node<GridType, Phase, Blocks, Behind>, grid.groups(),
                                 cuda::detail::block_threads, 0, cells[0]->signal(), phase, grid.view(),
                                 blocks, results, to_forget, behind);
        };
        if constexpr (Phase::looks_around || TellsLayersApart<Phase>)
            loop(grid.blocks_of_nodes());
        else
            loop(cuda::detail::NoBlocks{});
        return grid.node_results().template partial<Result>();
    }

    /// Calls `body(result)` once, on the device, with the merged results of a loop over nodes. No other such
    /// loop of that grid may be queued in between.
    template <class Result, class Body>
    void call_with(cuda::Partial<Result> const& found, Body const& body) const
    {
        cuda::OnDevice const here(device);
        cuda::launch_behind("merge_and_call", queue(), cuda::detail::merge_and_call<Result, Body>, 1,
                            cuda::detail::merging_warps * 32, 0, found, body);
    }

    /// Loops without nodes one after the other, `loops` being their counts and bodies as LoopInTurn; then as
    /// call_with(). One loop does all that, if they are short.
    template <class Result, class Body, class... Bodies>
    void for_each_in_turn(cuda::Partial<Result> const& found, Body const& body,
                          cuda::detail::LoopInTurn<Bodies> const&... loops) const
    {
        if (queue_in_turn(found, body, loops...)) return;
        (for_each(loops.count, loops.body), ...);
        call_with(found, body);
    }
    /// The same without a call.
    template <class... Bodies>
    void for_each_in_turn(cuda::detail::LoopInTurn<Bodies> const&... loops) const
    {
        if (queue_in_turn(cuda::Partial<NothingFound>{}, cuda::detail::NothingBehind{}, loops...)) return;
        (for_each(loops.count, loops.body), ...);
    }

    /// Queues the loop that moves the items of an order of cells, for what takes steps one by one.
    template <class Order, class LayerType, class Phase>
    void move_items(Order& cells, LayerType& layer, Phase const& phase) const
    {
        cuda::OnDevice const here(device);
        cuda::detail::start_moving(cells, layer, phase);
    }
    /// Finishes a step of which all loops have run: calls `finish` on the device with their merged results.
    template <class Finish, class OfNodes, class OfItems, class... Others>
    void finish_step(Finish const& finish, cuda::Partial<OfNodes> const& of_nodes,
                     std::tuple<cuda::Partial<OfItems>, Others...> const& of_items) const
    {
        cuda::OnDevice const here(device);
        constexpr int orders = 1 + int(sizeof...(Others));
        auto const all = std::apply([](auto const&... of) { return std::array{of...}; }, of_items);
        using All = cuda::detail::MergeAndFinish<OfNodes, OfItems, orders, Finish>;
        cuda::launch_behind("finish_step", queue(), cuda::detail::finish_alone<All>, cuda::Groups{1, false},
                            cuda::detail::scanning_threads, All::bytes, All{of_nodes, all, finish});
    }

    /// Queues at most `expected` steps of a program, and waits for them; see QueuedSteps for its members. A
    /// step is `update_grid`, its `g2p2g_phases`, and its `finish_phase`, which is called on the device with
    /// the merged results of the nodes and of the items of each order of cells. If that returns false, or if
    /// there was no room for all leavers, later loops do nothing until the host has polled.
    template <class Program>
    QueueOutcome run_steps(Program& steps, int expected) const
    {
        cuda::OnDevice const here(device);
        auto const orders = steps.orders();
        auto const layers = steps.layers();
        return cuda::StepRunner(queue(), orders, layers).run(steps, expected);
    }

private:
    /// Queues loops as one, if they are so short that one group of threads does not take long.
    template <class Result, class Body, class... Bodies>
    bool queue_in_turn(cuda::Partial<Result> const& found, Body const& body,
                       cuda::detail::LoopInTurn<Bodies> const&... loops) const
    {
        constexpr std::size_t longest = 8 * cuda::detail::threads_in_turn;
        if (std::max({loops.count...}) > longest) return false;
        cuda::OnDevice const here(device);
        cuda::launch_behind("for_each_in_turn", queue(),
                            cuda::detail::for_each_in_turn<Result, Body, Bodies...>, 1,
                            cuda::detail::threads_in_turn, 0, found, body, loops...);
        return true;
    }
};

/// The devices of this machine in one sentence: "CUDA 13.0, device 0: NVIDIA H200 (139 GiB)".
inline std::string cuda_info()
{
    int devices = 0;
    if (cudaGetDeviceCount(&devices) != cudaSuccess) {
        devices = 0;
        static_cast<void>(cudaGetLastError());
    }
    std::string text =
        "CUDA " + std::to_string(CUDART_VERSION / 1000) + "." + std::to_string(CUDART_VERSION / 10 % 100);
    for (int i = 0; i < devices; ++i) {
        cudaDeviceProp properties;
        cuda::check(cudaGetDeviceProperties(&properties, i), "cudaGetDeviceProperties");
        text += ", device " + std::to_string(i) + ": " + properties.name + " (" +
                std::to_string(properties.totalGlobalMem >> 30) + " GiB)";
    }
    return devices > 0 ? text : text + ", no device";
}

} // namespace firn
