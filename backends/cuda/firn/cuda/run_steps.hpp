// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/queue_outcome.hpp>
#include <firn/cuda/cell_order.hpp>
#include <firn/cuda/finish_step.hpp>
#include <firn/cuda/gather.hpp>
#include <firn/cuda/grid.hpp>
#include <firn/cuda/scatter.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <tuple>
#include <type_traits>
#include <utility>

namespace firn::cuda
{

namespace detail
{
/// Queues the loop that moves the items of an order of cells. Returns where their results will be.
template <class Order, class LayerType, class Phase>
Partial<typename Phase::Result> start_moving(Order& cells, LayerType const& layer, Phase const& phase)
{
    using Result = typename Phase::Result;
    if (layer.blocks() == 0) return {};
    using Items = ShapeOfItems<LayerType, Phase>;
    auto const signal = cells.signal();
    auto const leavers = cells.expect_outgoing(Items::stored_channels);
    unsigned const teams = Items::teams(layer.blocks());
    auto const results = layer.item_results().template expect<Result>(layer.blocks());
    auto* const loop = [&] {
        if constexpr (!compiled_soon)
            if (teams == 1) return move<1, Order, LayerType, Phase>;
        return move<Items::most_teams, Order, LayerType, Phase>;
    }();
    constexpr std::size_t declared = declared_by_move<LayerType, Phase>; // grows with the obstacles
    static_assert(declared <= given_shared,
                  "a call has more obstacles than a device's loops can tell of: pass fewer than 60, or say "
                  "several of them as one shape");
    if (Items::bytes(teams) + declared > given_shared) allow_shared(cells.queue(), loop, Items::bytes(teams));
    Moved<typename LayerType::Number, Phase::d, Result> const moved{leavers, cells.destinations(),
                                                                    cells.left(), results};
    if (std::uint32_t const groups = cells.groups(layer.blocks()); groups > 0)
        launch("move", cells.queue(), loop, groups, teams * Items::team_threads, Items::bytes(teams), signal,
               phase, cells.view(), layer.view(), moved);
    return layer.item_results().template partial<Result>();
}

/// Queues the loop that scatters the leavers of the last rebin to their new cells.
template <class Phase, class Order, class GridType>
void start_scattering_leavers(Order const& cells, GridType& grid)
{
    std::uint32_t const groups = cells.groups(grid.blocks());
    if (groups == 0) return;
    ScatterIncoming<Order, GridType, Phase> const scatter{cells.view(), cells.arrived(), cells.leavers(),
                                                          grid.view()};
    using Tiles = SharedTiles<GridType>;
    // as many as rebin() has where it scatters early, since sums are added up team by team
    unsigned const teams = Tiles::teams_that_rebin(cells.rebinned_blocks());
    auto* const loop = [&] {
        if constexpr (!compiled_soon)
            if (teams == 1) return scatter_leavers<1, Order, GridType, Phase>;
        return scatter_leavers<most_teams_that_rebin, Order, GridType, Phase>;
    }();
    launch("scatter_leavers", cells.queue(), loop, groups, teams * block_threads,
           Tiles::bytes(false, true, teams), cells.signal(), scatter);
}
} // namespace detail

/// Queues steps one behind another, while the device reports that they go on. A step that turns out not to be
/// taken lets all later loops do nothing, until the host has polled.
template <class Order, class LayerType, std::size_t orders>
class StepRunner
{
public:
    StepRunner(Queue const& queue, std::array<Order*, orders> const& cells,
               std::array<LayerType, orders> const& layers)
        : queue_(queue), cells_(cells), layers_(layers)
    {}

    /// Queues at most `expected` steps and waits for them; see Cuda::run_steps.
    template <class Program>
    QueueOutcome run(Program& steps, int expected) const
    {
        auto of_nodes = steps.update_grid(0);
        int queued = 1;
        for (; queued < expected && throttle(); of_nodes = steps.update_grid(queued++))
            move_on(steps, merge_and_finish(of_nodes, start(steps.g2p2g_phases(queued - 1)),
                                            steps.finish_phase(queued - 1)));
        auto of_items = start(steps.g2p2g_phases(queued - 1));
        end_step(merge_and_finish(of_nodes, of_items, steps.finish_phase(queued - 1)));
        steps.read_log(queued);
        if (!poll()) return {queued, false, rebins_early() && steps.taken() < queued};

        // a step ran out of room, and those behind it did nothing
        int const lacking = steps.taken() - (steps.has_failed() ? 0 : 1);
        steps.rollback(queued - 1 - lacking, queued - 1 - lacking);
        do {
            steps.adopt(lacking, lacking, true);
            auto const phases = steps.g2p2g_phases_again(lacking);
            for_each_order([&](auto k) {
                if (cells_[k]->make_room())
                    of_items[k] = detail::start_moving(*cells_[k], layers_[k], std::get<k>(phases));
            });
            end_step(merge_and_finish(of_nodes, of_items, steps.finish_phase(lacking)));
            steps.read_log(lacking + 1);
        } while (poll());
        return {lacking + 1, true, false};
    }

private:
    /// Calls `use(number)` for each order of cells.
    template <class Use>
    static void for_each_order(Use const& use)
    {
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            (use(std::integral_constant<std::size_t, k>{}), ...);
        }
        (std::make_index_sequence<orders>{});
    }

    /// Queues the loops that move the items of each order.
    template <class Phase, class... Others>
    auto start(std::tuple<Phase, Others...> const& phases) const
    {
        std::array<Partial<typename Phase::Result>, orders> found{};
        for_each_order(
            [&](auto k) { found[k] = detail::start_moving(*cells_[k], layers_[k], std::get<k>(phases)); });
        return found;
    }

    /// What finishes a step: merges what its loops found, and calls `finish` with that.
    template <class OfNodes, class OfItems, class Finish>
    static auto merge_and_finish(Partial<OfNodes> const& of_nodes,
                                 std::array<Partial<OfItems>, orders> const& of_items, Finish const& finish)
    {
        detail::MergeAndFinish<OfNodes, OfItems, static_cast<int>(orders), Finish> const all{
            of_nodes, of_items, finish};
        static_assert(decltype(all)::bytes <= detail::given_shared,
                      "a call has more obstacles than the end of a step can tell of: pass fewer");
        return all;
    }

    /// Queues the loop that ends a step when all items have moved.
    template <class Finish>
    void end_step(Finish const& finish) const
    {
        constexpr int count = static_cast<int>(orders);
        unsigned groups = 1; // for each order
        for (Order const* const order : cells_) groups = std::max(groups, order->groups_that_find());
        using Moved = decltype(cells_[0]->moved());
        std::array<Moved, orders> moved;
        for (std::size_t k = 0; k < orders; ++k) moved[k] = cells_[k]->moved();
        // Launched early however large the scene: its groups finish soon and do not block others for long.
        launch_behind("end_step", queue_, detail::end_step<Moved, count, Finish>,
                      Groups{1 + count * groups, true}, detail::scanning_threads, Finish::bytes,
                      cells_[0]->signal(), moved, finish);
    }

    /// Ends a step that is expected to be taken, commits it and rebins the items. With few blocks the step is
    /// finished while its items are rebinned.
    template <class Program, class Finish>
    void move_on(Program& steps, Finish const& finish) const
    {
        bool const early = rebins_early();
        if (!early) end_step(finish);
        steps.commit();
        steps.rebin_by([&]<class Phase>(Order& cells, auto& layer, auto const& offsets) {
            if (!early) {
                cells.rebin(offsets);
                detail::start_scattering_leavers<Phase>(cells, layer);
                return;
            }
            if constexpr (!compiled_soon) {
                using GridType = std::remove_reference_t<decltype(layer)>;
                using Tiles = detail::SharedTiles<GridType>;
                unsigned const teams = Tiles::teams_that_rebin(cells.blocks());
                cells.rebin_early(
                    offsets, finish,
                    [&](auto const& view, auto const& arrived) {
                        return detail::ScatterIncoming<Order, GridType, Phase>{view, arrived, cells.leavers(),
                                                                               layer.view()};
                    },
                    teams, Tiles::bytes(false, true, teams));
            }
        });
    }

    /// Whether items are rebinned before the step's outcome is known, and the order before that is kept for a
    /// rollback.
    bool rebins_early() const { return orders == 1 && cells_[0]->blocks() > 0 && cells_[0]->rebins_early(); }

    /// Waits until the device is about to need another step, if the device reports how far it is; false if
    /// queued steps have stopped.
    bool throttle() const { return !rebins_early() || cells_[0]->throttle(); }

    /// Called when the host has waited: lets loops work again if they have stopped; true if they stopped
    /// because there was no room for all leavers.
    bool poll() const
    {
        bool lacks_room = false;
        for (Order* const order : cells_) lacks_room = order->poll() || lacks_room;
        return lacks_room;
    }

    Queue queue_;
    std::array<Order*, orders> const& cells_;
    std::array<LayerType, orders> const& layers_;
};

} // namespace firn::cuda
