// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/core/error.hpp>
#include <firn/distributed/alone.hpp>
#include <firn/distributed/cell_order.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/grid.hpp>
#include <firn/distributed/merge.hpp>
#include <firn/distributed/node_halo.hpp>
#include <firn/distributed/partition.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// Runs one solver on several ranks, each with a backend of its own: `Solver<Distributed<OpenMP, C>, …>`. All
/// ranks run the same program and make the same calls, with the same arguments; each has the particles in its
/// part of space. What a call returns is about all of them, and the same on every rank. Results are those of
/// `Local` on one rank, bit by bit, for any number of ranks.
template <class Local, Communicator C>
struct Distributed
{
    Local local{};
    C communicator{};
    /// Which rank has what. Each solver has its own, since its items alone move when it changes.
    std::shared_ptr<distributed::Partition> partition = std::make_shared<distributed::Partition>();

    static constexpr bool spans_ranks = true;
    static constexpr bool reaches_host_memory = Local::reaches_host_memory;
    static constexpr bool queues = false;                 ///< each step waits for other ranks
    static constexpr bool shares_results = Local::queues; ///< loops leave them on devices
    static constexpr int largest_degree = Local::largest_degree;

    template <class Number>
    using Lane = typename Local::template Lane<Number>;
    template <class T>
    using Array = typename Local::template Array<T>;
    using SharedCount = typename Local::SharedCount;
    template <class T>
    using ReadbackBuffer = typename Local::template ReadbackBuffer<T>;
    template <class Number, int d>
    using CellOrder = distributed::CellOrder<typename Local::template CellOrder<Number, d>, C, Number, d>;
    template <class Number, int d, int degree, int sums, int values, int layers, bool own_values = false,
              int ungathered = 0>
    using Grid = distributed::Grid<
        typename Local::template Grid<Number, d, degree, sums, values, layers, own_values, ungathered>,
        CellOrder<Number, d>, d, sums>;

    /// Nodes of other ranks around those of this one, see firn::NodeHalo.
    template <class Number, int d>
    using Halo = distributed::NodeHalo<Local, Number, d>;

    void validate() const
    {
        local.validate();
        if constexpr (requires { communicator.device() == local.device; })
            require(communicator.device() == local.device,
                    "the communicator sends from another device than the solver's", "Distributed",
                    "Pass the same device to both.");
    }
    bool reaches(void const* there) const requires(!Local::reaches_host_memory)
    {
        return local.reaches(there);
    }
    auto queue() const requires(Local::queues) { return local.queue(); }
    /// Whether an error is this rank's alone, since its device has failed or has no room, or does not reach
    /// the others: these must not wait for it.
    bool is_own(Error const& error) const
    {
        return Local::queues &&
               (error.where() == "CUDA" || error.where() == "NCCL" || error.where() == "Peers");
    }
    /// Each scene divides space by itself: that of a lattice along so many axes.
    void begin_scene(Lattice const& lattice, int axes)
    {
        partition = std::make_shared<distributed::Partition>(lattice, axes);
    }
    /// The lattice has so many worlds: each rank gets a part of them.
    void share_worlds(std::uint32_t count) const { partition->share_worlds(count, communicator.size()); }
    operator Local const&() const { return local; } ///< its arrays are the local ones

    /// See Communicator.
    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const { return communicator.exchange(to); }
    std::vector<Parcel> all_gather(Parcel const& own) const { return communicator.all_gather(own); }
    void abort(char const* why) const { communicator.abort(why); }
    int rank() const { return communicator.rank(); }
    int ranks() const { return communicator.size(); }

    /// Whether ranks have come to have very different shares of the items of some orders. Space is divided
    /// anew then, and what lies elsewhere by that must be handed over. To be asked once a step.
    template <class Orders>
    bool divides_anew(Orders const& orders) const
    {
        if (communicator.size() == 1 || !partition->is_due()) return false;
        std::vector<distributed::Partition::Weight> weights;
        double own = 0;
        bool is_known = false;
        if constexpr (requires { orders[0]->weight_here(); }) {
            is_known = std::ranges::all_of(orders, [](auto* order) { return order->weight_here() >= 0; });
            for (auto* const order : orders) own += order->weight_here();
        }
        if (!is_known) {
            for (auto* const order : orders) order->weigh(weights);
            own = 0;
            for (auto const& block : weights) own += double(block.weight);
        }
        double all = 0, most = 0;
        for (double const weight : distributed::of_all_ranks(communicator, std::vector<double>{own})) {
            all += weight;
            most = std::max(most, weight);
        }
        if (most <= (1 + distributed::Partition::most_imbalance) * all / communicator.size()) return false;
        if (is_known)
            for (auto* const order : orders) order->weigh(weights);
        Parcel parcel;
        distributed::put(parcel, weights.data(), weights.size());
        weights.clear();
        for (Parcel const& of_rank : communicator.all_gather(parcel))
            for (distributed::Reader from(of_rank); !from.at_end();)
                weights.push_back(from.template get<distributed::Partition::Weight>());
        return partition->divide_anew(std::move(weights), communicator.size());
    }

    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        local.for_each(count, body);
    }
    template <class Order, class Visit>
    void for_each_place(Order const& cells, Visit const& visit) const
    {
        local.for_each_place(cells, visit);
    }

    template <class Order, class Layer, class Phase>
    auto for_each_cell(Order& cells, Layer& layer, Phase const& phase) const
    {
        if constexpr (Phase::work.scatters_to == ScatterTarget::sums) layer.change_sums();
        if constexpr (Phase::work.scatters_to == ScatterTarget::next_sums &&
                      requires { layer.change_next_sums(); })
            layer.change_next_sums();
        if constexpr (Local::queues && Phase::work.moves) {
            local.move_items(cells, layer, phase);
            return layer.template found<typename Phase::Result>(cells);
        }
        else if constexpr (requires { cells.merge_whole(typename Phase::Result{}); })
            return cells.merge_whole(local.for_each_cell(cells, layer, phase));
        else
            return local.for_each_cell(cells, layer, phase);
    }
    template <class Phase, class Order, class Layer>
    void scatter_leavers(Order& cells, Layer& layer) const
    {
        layer.change_sums();
        local.template scatter_leavers<Phase>(cells, layer);
    }
    /// Updates the nodes of which this rank has the results, after the tiles of other ranks have come. The
    /// other nodes under its cells follow by for_each_other_node(); a phase without a result updates all. On
    /// devices a phase that asks for no sums does not wait for tiles.
    template <class CellOrders, class GridType, class Phase>
    auto for_each_node(CellOrders const& orders, GridType& grid, Phase const& phase) const
    {
        constexpr bool looks_further = Phase::looks_around || TellsLayersApart<Phase>;
        constexpr bool exchanges = !Local::queues || !AsksNoSums<Phase>; // else no tiles are asked for
        constexpr bool finds_nothing = std::is_same_v<typename Phase::Result, NothingFound>;
        if constexpr (Local::queues && !finds_nothing) {
            if constexpr (exchanges && !looks_further && GridType::exchanges_beside)
                update_beside_exchange(orders, grid, phase);
            else {
                if constexpr (exchanges) grid.exchange(orders, looks_further ? 2 : 1);
                grid.show(distributed::Nodes::own);
                local.for_each_node(orders, grid, phase);
            }
            return grid.template found<typename Phase::Result>();
        }
        else {
            if constexpr (exchanges) grid.exchange(orders, looks_further ? 2 : 1);
            grid.show(finds_nothing ? distributed::Nodes::all : distributed::Nodes::own);
            auto const found = local.for_each_node(orders, grid, phase);
            if constexpr (requires { orders[0]->merge_whole(found); })
                return orders[0]->merge_whole(found);
            else
                return found;
        }
    }
    template <class CellOrders, class GridType, class Phase>
    void for_each_other_node(CellOrders const& orders, GridType& grid, Phase const& phase) const
    {
        if (communicator.size() == 1) return; // there are none
        grid.show(distributed::Nodes::others);
        local.for_each_node(orders, grid, phase);
    }

    /// Calls `body(merged results)` on the device, with what a loop over nodes has found on all ranks. Waits
    /// for the loop.
    template <class Found, class Body>
    void call_with(Found found, Body const& body) const requires(Local::queues)
    {
        found.share(communicator);
        local.call_with(found.merged, body);
    }

    /// Where loops leave their results on a device: queues their sharing, see distributed::SharedResults.
    template <class Orders, class OfNodes, class OfItems>
    void share_results(Orders const& orders, OfNodes& of_nodes, OfItems& of_items) const
        requires(Local::queues)
    {
        orders[0]->share_results(orders, of_nodes, of_items, false);
    }
    /// Called when the step is queued as a whole: what has come from other ranks may be taken in before the
    /// host knows how the step has ended.
    template <class Orders>
    void go_on_early(Orders const& orders) const requires(Local::queues)
    {
        orders[0]->go_on_early(orders);
    }
    /// Called when the host has waited for that. If there was no room on a rank, calls `move_again()` where
    /// items must move once more, shares anew, and returns false: the step is to be finished anew.
    template <class Orders, class OfNodes, class OfItems, class MoveAgain>
    bool had_room(Orders const& orders, OfNodes& of_nodes, OfItems& of_items,
                  MoveAgain const& move_again) const requires(Local::queues)
    {
        if constexpr (requires { communicator.require_all(); }) communicator.require_all();
        bool moved = true;
        for (std::size_t k = 0; k < orders.size(); ++k) moved = orders[k]->hear(*orders[0], k) && moved;
        if (moved && orders[0]->had_room_for_results(of_nodes, of_items)) {
            for (auto* const order : orders) order->create_missing();
            return true;
        }
        if (!moved) move_again();
        orders[0]->share_results(orders, of_nodes, of_items, moved);
        return false;
    }
    /// Finishes a step on the device, when results are shared.
    template <class Finish, class OfNodes, class OfItems>
    void finish_step(Finish const& finish, OfNodes const& of_nodes, OfItems const& of_items) const
        requires(Local::queues)
    {
        std::apply(
            [&](auto const&... of) { local.finish_step(finish, of_nodes.merged, std::tuple{of.merged...}); },
            of_items);
    }

private:
    /// Updates the nodes of which this rank has the results, those at borders when the tiles of other ranks
    /// have come.
    template <class CellOrders, class GridType, class Phase>
    void update_beside_exchange(CellOrders const& orders, GridType& grid, Phase const& phase) const
    {
        using Where = typename GridType::Where;
        bool const exchanges = grid.begin_exchange(orders, 1);
        grid.show(distributed::Nodes::own, exchanges ? Where::inside : Where::anywhere);
        local.for_each_node(orders, grid, phase);
        if (!exchanges) return;
        grid.go_on_with_exchange();
        grid.end_exchange();
        grid.show(distributed::Nodes::own, Where::at_borders);
        local.for_each_node(orders, grid, phase);
    }
};

} // namespace firn
