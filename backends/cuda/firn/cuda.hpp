// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/cuda/array.hpp>
#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/for_each.hpp>
#include <firn/cuda/gather.hpp>
#include <firn/cuda/grid.hpp>
#include <firn/cuda/scatter.hpp>
#include <firn/cuda/update_nodes.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <string>
#include <tuple>
#include <utility>

namespace firn
{

/// Runs a solver on a device: a warp works on 32 neighbouring cells, one lane per cell.
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
    template <class Number, int d>
    using CellOrder = cuda::CellOrder<Number, d>;
    static constexpr int largest_degree = 3; ///< of a stencil, which spans one node more per axis
    template <class Number, int d, int degree, int sums, int values, int layers>
    using Grid = cuda::Grid<Number, d, degree, sums, values, layers>;

    cuda::Queue queue() const { return {device, stream}; }

    /// How many steps are worth queueing. If the order of cells does not rebin early, the host learns only at
    /// the end of a batch that steps have stopped. With many blocks, loops queued in vain then cost more and
    /// waiting for the host costs less; half of `blindly` has gone well before. With early rebinning
    /// throttle() finds out in time.
    template <class Order, std::size_t orders>
    std::size_t steps_to_queue(std::array<Order*, orders> const& cells, std::size_t blindly) const
    {
        if (orders == 1 && cells[0]->rebins_early()) return batch;
        std::size_t blocks = 0;
        for (Order const* const order : cells) blocks += order->blocks();
        return std::min({batch, blindly, 2 + 10000 / (1000 + blocks)});
    }

    /// Waits until the device is about to need another step, if the device reports how far it is; false if
    /// queued steps have stopped.
    template <class Order, std::size_t orders>
    bool throttle(std::array<Order*, orders> const& cells) const
    {
        return !rebins_early(cells) || cells[0]->throttle();
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
        cuda::launch_after("for_each", queue(), cuda::detail::for_each<Body>, cuda::groups_of(count, 256),
                           256, body, count);
    }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item, on the device.
    template <class Order, class Visit>
    void for_each_place(Order const& cells, Visit const& visit) const
    {
        if (cells.size() == 0) return;
        cuda::OnDevice const here(device);
        cuda::detail::launch("for_each_place", queue(), cuda::detail::for_each_place<Order, Visit>,
                             cells.blocks(), 1, 0, cells.signal(), visit, cells.view(), cells.committed());
    }

    /// All items scatter to the grid by `phase.prepare` and `scatter` (see Scatter): afresh, or onto the sums
    /// that are there.
    template <class Order, class GridType, class Phase>
    void scatter(Order const& cells, GridType& grid, Phase const& phase, bool afresh) const
    {
        if (grid.blocks() == 0) return;
        cuda::OnDevice const here(device);
        cuda::detail::launch("scatter", queue(), cuda::detail::scatter<Order, GridType, Phase>, grid.blocks(),
                             1, cuda::detail::SharedTiles<GridType>::bytes(false, true), cells.signal(),
                             phase, cells.view(), grid.view(), afresh);
    }

    /// Items that changed cells when they moved scatter to the grid, to which all others already have.
    template <class Phase, class Order, class GridType>
    void scatter_leavers(Order const& cells, GridType& grid) const
    {
        if (grid.blocks() == 0) return;
        cuda::OnDevice const here(device);
        cuda::detail::ScatterIncoming<Order, GridType, Phase> const scatter{cells.view(), cells.arrived(),
                                                                            cells.leavers(), grid.view()};
        using Tiles = cuda::detail::SharedTiles<GridType>;
        // as many as rebin() has where it scatters early, since sums are added up team by team
        unsigned const teams = Tiles::teams_that_rebin(cells.rebinned_blocks());
        auto* const loop =
            teams == 1
                ? cuda::detail::scatter_leavers<1, Order, GridType, Phase>
                : cuda::detail::scatter_leavers<cuda::detail::most_teams_that_rebin, Order, GridType, Phase>;
        cuda::detail::launch("scatter_leavers", queue(), loop, std::min(grid.blocks(), 4096u), teams,
                             Tiles::bytes(false, true, teams), cells.signal(), grid.blocks(), scatter);
    }

    /// Calls `phase(node, result)` for every node that any layer added to; the merged result becomes known
    /// once the items have moved.
    template <class Order, std::size_t orders, class GridType, class Phase>
    cuda::Partial<typename Phase::Result> for_each_node(std::array<Order*, orders> const& cells,
                                                        GridType& grid, Phase const& phase) const
    {
        using Result = typename Phase::Result;
        if (grid.node_blocks() == 0) return {};
        cuda::OnDevice const here(device);
        auto const results = grid.node_results().template expect<Result>(grid.node_blocks());
        std::array<cuda::detail::ArrivalsToForget, orders> to_forget;
        for (std::size_t k = 0; k < orders; ++k)
            to_forget[k] = cells[k]->forget_incoming_on_the_way(grid.node_blocks());
        auto const loop = [&](auto const& blocks) {
            using Blocks = std::remove_cvref_t<decltype(blocks)>;
            cuda::detail::launch("for_each_node", queue(),
                                 cuda::detail::for_each_node<GridType, Phase, Blocks>, grid.node_blocks(), 1,
                                 0, cells[0]->signal(), phase, grid.view(), blocks, results, to_forget);
        };
        if constexpr (Phase::looks_around)
            loop(grid.blocks_of_nodes());
        else
            loop(cuda::detail::NoBlocks{});
        return grid.node_results().template partial<Result>();
    }

    /// All items gather from the grid and scatter in place to the sums that swap() makes current.
    template <class Order, class GridType, class Phase>
    void scatter_back(Order const& cells, GridType& grid, Phase const& phase) const
    {
        if (grid.blocks() == 0) return;
        cuda::OnDevice const here(device);
        cuda::detail::launch("scatter_back", queue(), cuda::detail::scatter_back<Order, GridType, Phase>,
                             grid.blocks(), 1, cuda::detail::SharedTiles<GridType>::bytes(true, true),
                             cells.signal(), phase, cells.view(), grid.view());
    }

    /// All items gather from the grid as in their last move; the phase stores what it needs of that.
    template <class Order, class GridType, class Phase>
    void gather(Order const& cells, GridType const& grid, Phase const& phase) const
    {
        if (grid.blocks() == 0) return;
        cuda::OnDevice const here(device);
        cuda::detail::launch("gather", queue(), cuda::detail::gather<Order, GridType, Phase>, grid.blocks(),
                             1, cuda::detail::SharedTiles<GridType>::bytes(true, false), cells.signal(),
                             phase, cells.view(), grid.view());
    }

    /// The items of all orders of cells, each with its layer and its phase, gather from the grid, move, and
    /// scatter to the grid of the next step (see G2p2g). Then `finish(merged results of the nodes, and of the
    /// items of each order)` is called on the device. If it returns false, or if there was no room for all
    /// leavers, later loops do nothing until the host has polled.
    template <class Order, class LayerType, std::size_t orders, class... Phase, class OfNodes, class Finish>
    void move(std::array<Order*, orders> const& cells, std::array<LayerType, orders> const& layers,
              std::tuple<Phase...> const& phases, cuda::Partial<OfNodes> const& of_nodes,
              Finish const& finish) const
    {
        cuda::OnDevice const here(device);
        for_each_order<orders>([&](auto k) { start_moving(*cells[k], layers[k], std::get<k>(phases)); });
        end_step(cells, merge_and_finish<Phase...>(layers, of_nodes, finish));
    }

    /// What remains of a step when its items are rebinned.
    template <class Finish>
    struct Rebinned
    {
        Finish finish;
        bool early; ///< `finish` is still to be called, concurrently with the rebinning
    };

    /// The same if the next step is queued at once: returns what rebin() needs before that. With few blocks
    /// the step is finished while its items are rebinned.
    template <class Order, class LayerType, std::size_t orders, class... Phase, class OfNodes, class Finish>
    auto move_on(std::array<Order*, orders> const& cells, std::array<LayerType, orders> const& layers,
                 std::tuple<Phase...> const& phases, cuda::Partial<OfNodes> const& of_nodes,
                 Finish const& finish) const
    {
        cuda::OnDevice const here(device);
        for_each_order<orders>([&](auto k) { start_moving(*cells[k], layers[k], std::get<k>(phases)); });
        auto const all = merge_and_finish<Phase...>(layers, of_nodes, finish);
        Rebinned<std::remove_cv_t<decltype(all)>> const rebinned{all, rebins_early(cells)};
        if (!rebinned.early) end_step(cells, all);
        return rebinned;
    }

    /// Whether rebin() runs before the step's outcome is known, and keeps the previous order for a rollback.
    template <class Order, std::size_t orders>
    bool rebins_early(std::array<Order*, orders> const& cells) const
    {
        return orders == 1 && cells[0]->blocks() > 0 && cells[0]->rebins_early();
    }

    /// Called when the host has waited: lets loops work again if they have stopped; true if they stopped
    /// because there was no room for all leavers.
    template <class Order, std::size_t orders>
    bool poll(std::array<Order*, orders> const& cells) const
    {
        bool lacks_room = false;
        for (Order* const order : cells) lacks_room = order->poll() || lacks_room;
        return lacks_room;
    }

    /// Makes room after that, and repeats what is needed of move().
    template <class Order, class LayerType, std::size_t orders, class... Phase, class OfNodes, class Finish>
    void complete(std::array<Order*, orders> const& cells, std::array<LayerType, orders> const& layers,
                  std::tuple<Phase...> const& phases, cuda::Partial<OfNodes> const& of_nodes,
                  Finish const& finish) const
    {
        cuda::OnDevice const here(device);
        for_each_order<orders>([&](auto k) {
            if (cells[k]->make_room()) start_moving(*cells[k], layers[k], std::get<k>(phases));
        });
        end_step(cells, merge_and_finish<Phase...>(layers, of_nodes, finish));
    }

    /// Rebins items that have moved, and scatters those that came into another cell.
    template <class Phase, class Order, class GridType, class Offsets, class Finish>
    void rebin(Order& cells, GridType& grid, Offsets const& offsets, Rebinned<Finish> const& rebinned) const
    {
        if (!rebinned.early) {
            cells.rebin(offsets);
            scatter_leavers<Phase>(cells, grid);
            return;
        }
        using Tiles = cuda::detail::SharedTiles<GridType>;
        unsigned const teams = Tiles::teams_that_rebin(cells.blocks());
        cells.rebin_early(
            offsets, rebinned.finish,
            [&](auto const& view, auto const& arrived) {
                return cuda::detail::ScatterIncoming<Order, GridType, Phase>{view, arrived, cells.leavers(),
                                                                             grid.view()};
            },
            teams, Tiles::bytes(false, true, teams));
    }

private:
    /// Calls `use(number)` for each order of cells.
    template <std::size_t orders, class Use>
    static void for_each_order(Use const& use)
    {
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            (use(std::integral_constant<std::size_t, k>{}), ...);
        }
        (std::make_index_sequence<orders>{});
    }

    /// What finishes a step of these phases.
    template <class Phase, class... Others, class LayerType, std::size_t orders, class OfNodes, class Finish>
    static auto merge_and_finish(std::array<LayerType, orders> const& layers,
                                 cuda::Partial<OfNodes> const& of_nodes, Finish const& finish)
    {
        using Result = typename Phase::Result;
        cuda::detail::MergeAndFinish<OfNodes, Result, static_cast<int>(orders), Finish> all{
            of_nodes, {}, finish};
        static_assert(decltype(all)::bytes <= cuda::detail::given_shared,
                      "a call has more obstacles than the end of a step can tell of: pass fewer");
        for (std::size_t k = 0; k < orders; ++k)
            if (layers[k].blocks() > 0) all.of_items[k] = layers[k].item_results().template partial<Result>();
        return all;
    }

    /// Queues the loop that ends a step when all items have moved.
    template <class Order, std::size_t orders, class Finish>
    void end_step(std::array<Order*, orders> const& cells, Finish const& finish) const
    {
        constexpr int count = static_cast<int>(orders);
        unsigned groups = 1; // for each order
        for (Order const* const order : cells) groups = std::max(groups, order->groups_that_find());
        using Moved = decltype(cells[0]->moved());
        std::array<Moved, orders> moved;
        for (std::size_t k = 0; k < orders; ++k) moved[k] = cells[k]->moved();
        // Launched early however large the scene: its groups finish soon and do not block others for long.
        cuda::launch_behind("end_step", queue(), cuda::detail::end_step<Moved, count, Finish>,
                            cuda::Groups{1 + count * groups, true}, cuda::detail::scanning_threads,
                            Finish::bytes, cells[0]->signal(), moved, finish);
    }

    /// Queues the loop that moves items.
    template <class Order, class LayerType, class Phase>
    void start_moving(Order& cells, LayerType const& layer, Phase const& phase) const
    {
        if (layer.blocks() == 0) return;
        using Result = typename Phase::Result;
        using Tiles = cuda::detail::SharedTiles<LayerType>;
        auto const signal = cells.signal();
        auto const leavers =
            cells.expect_outgoing(Phase::scratch_channels - Phase::d); // an offset is stored with its item
        constexpr unsigned most_teams = cuda::detail::most_teams_that_move<Phase>;
        unsigned const teams = Tiles::teams(layer.blocks(), most_teams);
        auto const results = layer.item_results().template expect<Result>(layer.blocks());
        auto* const loop = cuda::detail::move<Order, LayerType, Phase>;
        std::size_t const shared = Tiles::bytes(true, true, teams);
        constexpr std::size_t declared = cuda::detail::declared_by_move<Phase>; // grows with the obstacles
        static_assert(
            declared <= cuda::detail::given_shared,
            "a call has more obstacles than a device's loops can tell of: pass fewer than 60, or say "
            "several of them as one shape");
        // The most this loop ever needs: several host threads may set it concurrently, so all set the same.
        constexpr std::size_t most = Tiles::bytes(true, true, Tiles::teams(0, most_teams));
        if constexpr (most + declared > cuda::detail::given_shared) cuda::detail::allow_shared(loop, most);
        cuda::detail::Moved<typename LayerType::Number, Result> const moved{leavers, cells.destinations(),
                                                                            cells.left(), results};
        cuda::detail::launch("move", queue(), loop, layer.blocks(), teams, shared, signal, phase,
                             cells.view(), layer.view(), moved);
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
