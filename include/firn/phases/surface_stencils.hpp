// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/phases/surface_weights.hpp>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

// Which nodes the points of surfaces reach, and which points reach a node: found before the sweeps of
// surface_contact.hpp, in each step anew unless obstacles are at rest. The points of a node are listed, since
// many would wait for one another if they added to it, and in an order of their own, so that sums have the
// same bits however loops ran. Nodes that points reach are numbered through, so that sweeps find all of them
// close together, and keep their numbers where the grid gives them other indices. Loops are short, with one
// thing to find each, so that a device waits for the memory of many at once.
namespace firn
{

/// What the loops over points know.
template <class Kernel, class Number, int d>
struct PointLoop
{
    using Cell = Stencil<Kernel, Number, d>;
    static constexpr int nodes_of_each = Cell::rows * Cell::width;
#if defined(FIRN_FOR_DEVICE)
    static constexpr int at_once = Cell::width * Cell::width;
#else
    static constexpr int at_once = Cell::width;
#endif
    static constexpr std::size_t tile = SurfacePoints<Number, d>::tile;

    SurfacePoints<Number, d> of;

    /// Where node k of a point's stencil lies.
    FIRN_HOST_DEVICE static std::size_t place(std::size_t p, int k)
    {
        return (p / tile * std::size_t(nodes_of_each) + std::size_t(k)) * tile + p % tile;
    }
    /// Calls `use(k, weight, load(node))` for the places of a stencil, by `surface.stencils` or
    /// `surface.acting`. Where there is no node it is the first of all. A device waits for the memory of
    /// several nodes at once.
    template <class Load, class Use>
    FIRN_HOST_DEVICE static void for_each_node(NodeOfPoint<Number> const* of_all, std::size_t p,
                                               Load const& load, Use const& use)
    {
        NodeOfPoint<Number> const* const places = of_all + place(p, 0);
        FIRN_ROLLED_ON_DEVICE
        for (int first = 0; first < nodes_of_each; first += at_once) {
            NodeOfPoint<Number> there[std::size_t(at_once)];
            decltype(load(there[0].node)) value[std::size_t(at_once)];
            FIRN_UNROLL
            for (int k = 0; k < at_once; ++k) there[k] = places[std::size_t(first + k) * tile];
            FIRN_UNROLL
            for (int k = 0; k < at_once; ++k) value[k] = load(there[k].node);
            FIRN_UNROLL
            for (int k = 0; k < at_once; ++k) use(first + k, there[k].weight, value[k]);
        }
    }
    /// The cell in which a point lies, from the node in whose cube it was found, and its offset from there.
    FIRN_HOST_DEVICE static Coordinates<d> cell_of(SurfacePoint<Number, d> const& point,
                                                   Vector<Number, d>& offset)
    {
        Coordinates<d> of;
        for (int a = 0; a < d; ++a) {
            Number const x = point.offset[a] + Number(cell_shift(Kernel::degree)), cell = floor(x);
            of[a] = static_cast<int>(cell);
            offset[a] = x - cell - Number(0.5);
        }
        return of;
    }
};

/// A loop over the rows of the points' stencils, of which a part of it has so many.
template <class Kernel, class Number, int d, int rows_of_part>
struct RowLoop : PointLoop<Kernel, Number, d>
{
    using Loop = PointLoop<Kernel, Number, d>;
    using typename Loop::Cell;
    static constexpr std::size_t parts = std::size_t(Cell::rows / rows_of_part); ///< of each point
    std::size_t points;

    /// How many parts there are, those of points that would fill the last tile included.
    static std::size_t count(std::size_t points)
    {
        return (points + Loop::tile - 1) / Loop::tile * Loop::tile * parts;
    }
    FIRN_HOST_DEVICE static int first_row(std::size_t i)
    {
        return static_cast<int>(i / Loop::tile % parts) * rows_of_part;
    }
    FIRN_HOST_DEVICE static std::size_t point(std::size_t i)
    {
        return i / (Loop::tile * parts) * Loop::tile + i % Loop::tile;
    }
};

/// Finds the nodes of a new point's stencil, which count their points; and where the grid has others than
/// before, those that a point had not found. Points that may have moved get other weights.
template <class Kernel, class Transfer, class Number, int d, int rows_of_part, class Nodes>
struct FindNodesOfPoints : RowLoop<Kernel, Number, d, rows_of_part>
{
    using Rows = RowLoop<Kernel, Number, d, rows_of_part>;
    using typename Rows::Cell;
    Nodes by_index;          ///< see Grid::nodes_by_index()
    std::size_t first_point; ///< from which on they are found
    std::size_t first_new;   ///< of the points that have none yet
    bool may_move;           ///< those that have some may have moved
    bool has_others;         ///< the grid has other nodes than before

    /// How many parts there are from the tile of the first one on.
    static std::size_t count(std::size_t points, std::size_t first)
    {
        return Rows::count(points - first_of_tile(first));
    }
    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        std::size_t const p = Rows::point(i) + first_of_tile(first_point);
        if (p < first_point || p >= this->points) return;
        SurfacePoint<Number, d>& point = this->of.points[p];
        if (p < first_new && !(may_move && point.found == this->of.step) && !(has_others && !point.is_whole))
            return;
        Vector<Number, d> offset;
        Coordinates<d> const center = Rows::cell_of(point, offset);
        Cell const cell(offset);
        SurfaceWeights<Kernel, Transfer, Number, d> const weights(cell, offset, point.normal);
        int const first = Rows::first_row(i);
        for (int row = first; row < first + rows_of_part; ++row)
            find(p, point, center, row, weights.of_row(row));
    }

private:
    FIRN_HOST_DEVICE static std::size_t first_of_tile(std::size_t p) { return p / Rows::tile * Rows::tile; }

    FIRN_HOST_DEVICE void find(std::size_t p, SurfacePoint<Number, d>& point, Coordinates<d> const& center,
                               int row, std::array<Number, std::size_t(Cell::width)> const& of_row) const
    {
        auto const& surface = this->of;
        std::size_t const place = Rows::place(p, row * Cell::width);
        Coordinates<d> node;
        bool is_deeper = point.is_deep; // a node deep inside reaches itself alone
        for (int a = 0; a < d; ++a) {
            node[a] = center[a] + point.node[a] - stencil_reach(Kernel::degree);
            if (a == d - 1) continue;
            node[a] += Cell::index(row, a);
            is_deeper = is_deeper && node[a] == point.node[a];
        }
        NodeOfPoint<Number> there[std::size_t(Cell::width)];
        bool misses[std::size_t(Cell::width)], misses_any = false;
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            there[k].node = p < first_new ? surface.stencils[place + std::size_t(k) * Rows::tile].node
                                          : NodeOfPoint<Number>::none;
            bool const reaches = !point.is_deep || (is_deeper && node[d - 1] + k == point.node[d - 1]);
            misses[k] = reaches && there[k].node == NodeOfPoint<Number>::none;
            misses_any = misses_any || misses[k];
            there[k].weight = !reaches        ? Number(0)
                              : point.is_deep ? Number(1)
                                              : max(of_row[std::size_t(k)], Number(0));
        }
        if (misses_any && (p >= first_new || has_others)) look_up(point, place, node, misses, there);
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            if (there[k].node == NodeOfPoint<Number>::none) there[k].weight = 0;
            surface.stencils[place + std::size_t(k) * Rows::tile] = there[k];
        }
    }

    /// Looks for these nodes of a row, which begins with this one.
    FIRN_HOST_DEVICE void look_up(SurfacePoint<Number, d>& point, std::size_t place, Coordinates<d> node,
                                  bool const (&which)[std::size_t(Cell::width)],
                                  NodeOfPoint<Number> (&there)[std::size_t(Cell::width)]) const
    {
        auto const& surface = this->of;
        std::uint32_t index[std::size_t(Cell::width)], rank[std::size_t(Cell::width)]{};
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            index[k] = k == 0 ? by_index.find(node) : by_index.find_next(node, index[k - 1]);
            ++node[d - 1];
        }
        // a loop of its own: these wait for one another's memory together
        std::uint32_t found = 0, absent = 0;
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            absent += which[k] && index[k] == Nodes::absent;
            if (!which[k] || index[k] == Nodes::absent) continue;
            ++found;
            rank[k] = next_number(surface.indices[index[k]].count);
            if (rank[k] != 0) continue;
            std::uint32_t const number = next_number_of_all(*surface.reached_nodes);
            surface.indices[index[k]].number = number;
            NodeAtSurface<Number, d>& reached = surface.reached[number];
            reached.node = index[k] + 1;
            reached.points.count = 0;
            reached.place = node;
            reached.place[d - 1] += k - Cell::width;
        }
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            if (!which[k] || index[k] == Nodes::absent) continue;
            there[k].node = NodeOfPoint<Number>::index_of(index[k]);
            surface.ranks[place + std::size_t(k) * Rows::tile] = rank[k];
        }
        if (found > 0) next_number_of_all(*surface.changes);
        if (absent > 0) point.is_whole = false;
    }
};

/// Below this share of the mean mass of a point's nodes a node gets less of the impulse: an impulse by the
/// kernel's weights would throw what little lies on it away.
inline constexpr double light_node = 0.0001;

/// The lengths of this step and of the one before, where loops know them; else their ratio.
template <class Number>
struct Lengths
{
    Number const *now, *before; ///< [s], or null
    Number if_unknown;

    FIRN_HOST_DEVICE Number ratio() const { return now == nullptr ? if_unknown : *now / *before; }
};

/// Points start from their impulses in the step before, which have been found or are their own. Those that
/// are none in this step have neither impulse nor weight.
template <class Kernel, class Number, int d>
struct BeginPoints : PointLoop<Kernel, Number, d>
{
    Lengths<Number> lengths;
    std::size_t first;         ///< of the points that are new
    std::size_t first_without; ///< of those that had no nodes
    bool may_move;             ///< those that are not new
    bool may_change;           ///< the lists of nodes may

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& surface = this->of;
        bool const have_changed = may_change && *surface.changes > 0;
        if (have_changed && (p >= first_without || !surface.points[p].is_whole)) number(p);
        Number mean = 0, least = std::numeric_limits<Number>::max();
        auto const mass_of = [&](std::uint32_t node) { return surface.velocities[node].number(); };
        this->for_each_node(surface.stencils, p, mass_of, [&](int, Number weight, Number mass) {
            mean += weight * mass;
            least = min(least, weight > 0 ? mass : least);
        });
        SurfacePoint<Number, d>& point = surface.points[p];
        bool const is_one =
            (surface.are_at_rest ? surface.seen[point.candidate] : point.found) == surface.step;
        auto const* const before = p < first || first > 0 ? &point : surface.before.find(point);
        point.impulse = before != nullptr && is_one
                            ? point.allowed(Vector<Number, d>(before->impulse * lengths.ratio()))
                            : zeros<Vector<Number, d>>();
        surface.tried[p].set(point.impulse);
        surface.tried[p].set_number(Number(1));
        bool const was_plain = point.is_plain, acted = point.per_light > 0;
        point.per_light = is_one && mean > 0 ? 1 / (mean * Number(light_node)) : Number(0);
        point.is_plain = least * point.per_light >= 1;
        bool const is_as_before = point.per_light > 0 ? was_plain && point.is_plain : !acted,
                   is_listed = !have_changed && !may_move && is_as_before;
        surface.to_list[p] = is_listed ? 0 : 1;
    }

private:
    /// Nodes have numbers, which a stencil has in place of their indices.
    FIRN_HOST_DEVICE void number(std::size_t p) const
    {
        NodeOfPoint<Number>* const stencil = this->of.stencils + this->place(p, 0);
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < this->nodes_of_each; ++k) {
            NodeOfPoint<Number>& there = stencil[std::size_t(k) * this->tile];
            if (there.has_index()) there.node = this->of.indices[there.index()].number + 1;
        }
    }
};

} // namespace firn
