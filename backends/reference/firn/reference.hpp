// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/reference/array.hpp>
#include <firn/reference/cell_order.hpp>
#include <firn/reference/grid.hpp>

#include <atomic>
#include <cstddef>

namespace firn
{

/// Runs a solver by plain loops, one item and one node after the other: what every backend does, written to
/// be read. It is slow: use it beside a debugger, and to begin a new backend with.
struct Reference
{
    static constexpr bool reaches_host_memory = true;
    static constexpr bool queues = false;    ///< loops have finished when they return
    static constexpr int largest_degree = 3; ///< as in the other backends

    template <class Number>
    using Lane = Number;
    using SharedCount = std::atomic<int>; ///< several host threads may change it concurrently
    template <class T>
    using Array = reference::Array<T>;
    template <class T>
    using ReadbackBuffer = reference::ReadbackBuffer<T>;
    template <class Number, int d>
    using CellOrder = reference::CellOrder<Number, d>;
    template <class Number, int d, int degree, int sums, int values, int layers, bool own_values = false>
    using Grid = reference::Grid<Number, d, degree, sums, values, layers, own_values>;

    /// Works on every machine.
    void validate() const {}

    /// Calls `body(i)` once for every i in [0, count).
    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        for (std::size_t i = 0; i < count; ++i) body(i);
    }

    /// Calls `visit(where it lies, coordinates of its cell)` for every item.
    template <class Order, class Visit>
    void for_each_place(Order const& cells, Visit const& visit) const
    {
        cells.for_each(visit);
    }

    /// The items of all cells gather from the nodes, are updated, move and scatter; the phase says which
    /// of these (see CellWork). Returns the result of the updates, if there are any.
    template <class Order, class Layer, class Phase>
    auto for_each_cell(Order& cells, Layer& layer, Phase const& phase) const
    {
        constexpr CellWork work = Phase::work;
        constexpr bool scatters = work.scatters_to != ScatterTarget::nothing;
        auto& target = work.scatters_to == ScatterTarget::next_sums ? layer.next_sums : layer.sums_now;
        auto result = first_result<Phase>();
        if constexpr (work.moves) cells.leavers.clear();
        if constexpr (scatters)
            if (!adds_to_sums(phase)) target.clear();

        for (std::size_t slot = 0; slot < cells.size();) {
            auto const cell = cells[slot].cell; // all of its items have the same stencil
            decltype(layer.values_around(cell)) values;
            decltype(layer.sums_around(cell, target)) sums;
            if constexpr (work.gathers) values = layer.values_around(cell);
            if constexpr (scatters) sums = layer.sums_around(cell, target);

            for (; slot < cells.size() && cells[slot].cell == cell; ++slot) {
                reference::Item<typename Order::Number, Phase::d, Phase::scratch_channels, decltype(values)>
                    item(cells, slot, values);
                if constexpr (work.gathers) {
                    phase.begin(item);
                    phase.gather(item);
                    phase.update(item, result);
                }
                else
                    phase.prepare(item);
                if (item.has_left()) {
                    if constexpr (work.moves) cells.leavers.push_back(item.leaver());
                }
                else if constexpr (scatters)
                    phase.scatter(item, sums);
            }
        }
        return result;
    }

    /// Items that changed cells when they moved scatter to the grid, to which all others already have.
    template <class Phase, class Order, class Layer>
    void scatter_leavers(Order& cells, Layer& layer) const
    {
        for (auto const& leaver : cells.leavers) {
            auto const sums = layer.sums_around(leaver.cell, layer.sums_now);
            Phase::scatter(leaver, sums);
        }
    }

    /// Calls `phase(node, result)` for every node that any layer added to; returns the result.
    template <class Orders, class GridType, class Phase>
    auto for_each_node(Orders const&, GridType& grid, Phase const& phase) const
    {
        auto result = first_result<Phase>();
        auto const sums = grid.all_sums();
        for (auto at = sums.begin(); at != sums.end(); ++at) update_node(grid, sums, at, phase, result);
        return result;
    }

private:
    template <class GridType, class AllSums, class Phase, class Result>
    static void update_node(GridType& grid, AllSums const& sums, typename AllSums::const_iterator at,
                            Phase const& phase, Result& result)
    {
        if constexpr (TellsLayersApart<Phase>) {
            reference::NodeOfLayers<GridType, Phase::d> node(grid, at->first);
            phase(node, result);
        }
        else {
            reference::Node<typename Phase::Number, Phase::d, typename GridType::Sums,
                            typename GridType::Values>
                node(sums, at, grid.values_at(at->first));
            if constexpr (Phase::looks_around) {
                auto const walls = phase.walls();
                if (phase.looks_around_at(walls, node.first(), 1)) {
                    phase.look_around(walls, node, result);
                    return;
                }
            }
            phase(node, result);
        }
    }

    /// What the results of items are merged into.
    template <class Phase>
    static auto first_result()
    {
        if constexpr (requires { typename Phase::Result; })
            return typename Phase::Result{};
        else
            return 0; // there are none
    }

    template <class Phase>
    static bool adds_to_sums(Phase const& phase)
    {
        if constexpr (Phase::work.scatters_to == ScatterTarget::sums)
            return phase.adds_to_sums();
        else
            return false;
    }
};

} // namespace firn
