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
/// be read. It is slow: use it beside a debugger, and to begin a new backend with. What its members owe is in
/// firn/backend.hpp.
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
    template <class Number, int d, int degree, int sums, int values, int layers, bool own_values = false,
              int ungathered = 0>
    using Grid = reference::Grid<Number, d, degree, sums, values + ungathered, layers, own_values>;

    void validate() const {} // works on every machine

    void for_each(std::size_t count, auto const& body) const
    {
        for (std::size_t i = 0; i < count; ++i) body(i);
    }
    void for_each_place(auto const& cells, auto const& visit) const { cells.for_each(visit); }

    /// The items of all cells gather from the nodes, are updated, move and scatter; the phase says which
    /// of these (see CellWork). Returns the result of the updates, if there are any.
    template <class Order, class Layer, class Phase>
    auto for_each_cell(Order const& cells, Layer& layer, Phase const& phase) const
    {
        constexpr CellWork work = Phase::work;
        constexpr bool scatters = work.scatters_to != ScatterTarget::nothing;
        auto& target = work.scatters_to == ScatterTarget::next_sums ? layer.next_sums : layer.sums_now;
        typename Phase::Result result{};
        if constexpr (work.scatters_to == ScatterTarget::next_sums) target.clear();
        if constexpr (work.scatters_to == ScatterTarget::sums)
            if (!phase.adds_to_sums()) target.clear();

        for (std::size_t slot = 0; slot < cells.size();) {
            auto const cell = cells[slot].cell; // all of its items have the same stencil
            decltype(layer.values_around(cell)) values;
            decltype(layer.sums_around(cell, target)) sums;
            if constexpr (work.gathers) values = layer.values_around(cell);
            if constexpr (scatters) sums = layer.sums_around(cell, target);

            for (; slot < cells.size() && cells[slot].cell == cell; ++slot) {
                reference::Item<Phase, decltype(values)> item(cells, slot, values);
                if constexpr (work.gathers) {
                    phase.begin(item);
                    phase.gather(item);
                    phase.update(item, result);
                }
                else
                    phase.prepare(item);
                if constexpr (scatters) {
                    bool const stays = item.first() == cell;
                    auto around = stays ? sums : layer.sums_around(item.first(), target);
                    phase.scatter(item, around);
                }
            }
        }
        return result;
    }

    /// Nothing is left to do: an item that left its cell has scattered around the new one, since nodes appear
    /// when something is added to them. In another backend the nodes there may not exist before activate(),
    /// so the item keeps its contribution until then.
    template <class Phase>
    void scatter_leavers(auto const& /*cells*/, auto const& /*layer*/) const
    {}

    /// Calls `phase(node, result)` for every node that any layer added to; returns the result.
    template <class GridType, class Phase>
    auto for_each_node(auto const& /*orders*/, GridType& grid, Phase const& phase) const
    {
        typename Phase::Result result{};
        for (auto const& at : grid.nodes()) {
            reference::Node<GridType, Phase::d> node(grid, at);
            if constexpr (Phase::looks_around)
                if (auto const walls = phase.walls(); phase.looks_around_at(walls, at, 1)) {
                    phase.look_around(walls, node, result);
                    continue;
                }
            phase(node, result);
        }
        return result;
    }
};

} // namespace firn
