// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/effects/surface_memory.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/phases/find_surface_points.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <type_traits>

// The impulses at points of surfaces, after nodes have been updated and before particles gather from them.
// All points are improved at once, sweep by sweep, by their own part of the equations, where the response of
// a point to its impulse is replaced by that to the impulses of all points around it: a bound, by which
// sweeps do not overshoot and pressure, which is smooth, is found at once. Each sweep starts ahead of the
// last one (Nesterov 1983; for contact Mazhar et al. 2015). Within a call a step starts from the impulses of
// the step before.
namespace firn
{

/// What the loops over points know.
template <class Kernel, class Number, int d>
struct PointLoop
{
    using Cell = Stencil<Kernel, Number, d>;
    static constexpr int nodes_of_each = Cell::rows * Cell::width;
    static constexpr std::size_t tile = SurfacePoints<Number, d>::tile;

    SurfacePoints<Number, d> of;

    /// Where node k of a point's stencil lies.
    FIRN_HOST_DEVICE static std::size_t place(std::size_t p, int k)
    {
        return (p / tile * std::size_t(nodes_of_each) + std::size_t(k)) * tile + p % tile;
    }
    /// Calls `use(weight, node)` for the places of a stencil. Where there is no node it is the first of all,
    /// with a weight of 0: without a branch a device loads all of them at once.
    template <class Use>
    FIRN_HOST_DEVICE void for_each_node(std::size_t p, Use const& use) const
    {
        NodeOfPoint<Number> const* const places = of.stencils + place(p, 0);
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < nodes_of_each; ++k) {
            NodeOfPoint<Number> const there = places[std::size_t(k) * tile];
            use(there.weight, there.node);
        }
    }
};

/// Finds the nodes in a row of a point's stencil. Each counts its points, and the first of these finds its
/// mass and its velocity.
template <class Kernel, class Number, int d, class Nodes>
struct FindNodesOfPoints : PointLoop<Kernel, Number, d>
{
    using Loop = PointLoop<Kernel, Number, d>;
    using typename Loop::Cell;
    std::size_t points;
    Nodes by_index;       ///< see Grid::nodes_by_index()
    Number smallest_mass; ///< see UpdateGrid
    int mass, velocity;   ///< the channels of the sums, and of the values

    /// How many rows there are, those of points that fill the last tile included.
    static std::size_t count(std::size_t points)
    {
        return (points + Loop::tile - 1) / Loop::tile * Loop::tile * std::size_t(Cell::rows);
    }

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        int const row = static_cast<int>(i / Loop::tile % std::size_t(Cell::rows));
        std::size_t const p = i / (Loop::tile * std::size_t(Cell::rows)) * Loop::tile + i % Loop::tile;
        if (p >= points) return;
        SurfacePoint<Number, d> const& point = this->of.points[p];
        Coordinates<d> node;
        Vector<Number, d> offset;
        for (int a = 0; a < d; ++a) {
            Number const x = point.offset[a] + Number(cell_shift(Kernel::degree)), cell = floor(x);
            node[a] = point.node[a] + static_cast<int>(cell) - stencil_reach(Kernel::degree);
            if (a < d - 1) node[a] += Cell::index(row, a);
            offset[a] = x - cell - Number(0.5);
        }
        Cell const cell(offset);
        Number const of_row = cell.row_weight(row);
        for (int k = 0; k < Cell::width; ++k, ++node[d - 1]) {
            Number weight = of_row * cell.weight[std::size_t(d - 1)][std::size_t(k)];
            if (point.is_deep) {
                weight = 1;
                for (int a = 0; a < d; ++a)
                    if (node[a] != point.node[a]) weight = 0;
            }
            std::size_t const place = Loop::place(p, row * Cell::width + k);
            std::uint32_t const index = weight > 0 ? by_index.find(node) : Nodes::absent;
            this->of.stencils[place] = {NodeOfPoint<Number>::none, weight};
            if (index == Nodes::absent) continue;
            this->of.stencils[place].node = index + 1;
            if ((this->of.ranks[place] = next_number(this->of.nodes[index + 1].count)) == 0) reach(index);
        }
    }

private:
    FIRN_HOST_DEVICE void reach(std::uint32_t index) const
    {
        auto const& surface = this->of;
        surface.reached[next_number(surface.counts->nodes)] = index + 1;
        NodeAtSurface<Number, d>& node = surface.nodes[index + 1];
        Number const sum = by_index.sum(index, mass);
        node.mass = sum > smallest_mass ? sum : Number(0);
        surface.velocities[index + 1].number = sum > smallest_mass ? 1 / sum : Number(0);
        for (int a = 0; a < d; ++a) node.free[a] = by_index.value(index, velocity + a);
    }
};

/// Nodes that have mass make room for their points in the list of those of all nodes.
template <class Number, int d>
struct MakeRoomForPoints
{
    SurfacePoints<Number, d> of;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        if (i >= of.counts->nodes) return;
        NodeAtSurface<Number, d>& node = of.nodes[of.reached[i]];
        if (node.mass > 0) node.begin = next_number(of.counts->listed, node.count);
    }
};

/// Below this share of the mean mass of a point's nodes a node gets less of the impulse: an impulse by the
/// kernel's weights would throw what little lies on it away.
inline constexpr double light_node = 0.01;

/// Points enter themselves there, with the weights that they have then, and start from their impulses in the
/// step before.
template <class Kernel, class Number, int d>
struct ListPoints : PointLoop<Kernel, Number, d>
{
    using Loop = PointLoop<Kernel, Number, d>;
    using typename Loop::Cell;
    Number cell_size; ///< [m]
    Number longer;    ///< the step over the one before

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& surface = this->of;
        SurfacePoint<Number, d>& point = surface.points[p];
        Number mean = 0;
        this->for_each_node(
            p, [&](Number weight, std::uint32_t node) { mean += weight * surface.nodes[node].mass; });
        Number const per_light = mean > 0 ? 1 / (mean * Number(light_node)) : Number(0);
        // the means of the places of its nodes: of those with mass, and of all [cells]
        Vector<Number, d> reached = zeros<Vector<Number, d>>(), all = reached;
        Number support = 0;
        for (int k = 0; k < Loop::nodes_of_each; ++k) {
            Vector<Number, d> at;
            for (int a = d - 1, rest = k; a >= 0; --a, rest /= Cell::width)
                at[a] = Number(rest % Cell::width);
            std::size_t const place = Loop::place(p, k);
            NodeOfPoint<Number>& there = surface.stencils[place];
            NodeAtSurface<Number, d> const& node = surface.nodes[there.node];
            all += at * there.weight;
            there.weight *= min(node.mass * per_light, Number(1));
            support += there.weight;
            reached += at * there.weight;
            if (node.mass > 0)
                surface.points_of_nodes[node.begin + surface.ranks[place]] = {static_cast<std::uint32_t>(p),
                                                                              there.weight};
            else
                there.node = NodeOfPoint<Number>::none;
        }
        point.support = support;
        if (support > 0 && !point.is_deep) point.arm += (reached * (1 / support) - all) * cell_size;
        if (auto const* const before = surface.before.find(point))
            point.impulse = point.allowed(Vector<Number, d>(before->impulse * longer));
        surface.tried[p].vector = point.impulse;
    }
};

/// Rounds to a multiple of a number, so that sums of these come out the same in any order.
struct RoundToMultiples
{
    double large; ///< the spacing of numbers as large as this is that of the multiples

    /// The multiples are those of the power of two at or below `unit`, for numbers up to 2^50 of these.
    static RoundToMultiples of(double unit) { return {std::ldexp(1.5, 52 + std::ilogb(unit))}; }
    FIRN_HOST_DEVICE double operator()(double x) const { return difference(x + large); }

private:
    FIRN_HOST_DEVICE double difference(double sum) const
    {
#if defined(__FAST_MATH__) && !defined(__CUDA_ARCH__)
        asm("" : "+x"(sum)); // or the sum would cancel
#endif
        return sum - large;
    }
};

/// Nodes take the velocities that the impulses of the points around them give. A node asks its points, since
/// many of these would wait for one another if they added to it.
template <class Kernel, class Number, int d, class Nodes>
struct GatherImpulses : PointLoop<Kernel, Number, d>
{
    RoundToMultiples round, round_weight;
    Nodes by_index;
    int velocity;          ///< the first channel of the grid's values
    bool is_first = false; ///< the weights of points are summed, too
    bool is_last = false;  ///< the grid takes the velocities, and no point reaches a node any more

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const& surface = this->of;
        if (i >= surface.counts->nodes) return;
        std::uint32_t const n = surface.reached[i];
        NodeAtSurface<Number, d>& node = surface.nodes[n];
        Number const inverse_mass = surface.velocities[n].number;
        if (inverse_mass > 0) {
            double gained[std::size_t(d)]{}, weights = 0;
            std::uint32_t const end = node.begin + node.count;
            for (std::uint32_t at = node.begin; at < end; ++at) {
                PointOfNode<Number> const from = surface.points_of_nodes[at];
                auto const impulse = surface.tried[from.point].vector;
                double const gives = double(from.weight * inverse_mass);
                for (int a = 0; a < d; ++a) gained[a] += round(gives * double(impulse[a]));
                if (is_first) weights += round_weight(double(from.weight));
            }
            if (is_first) node.weights = static_cast<Number>(weights);
            Vector<Number, d> v;
            for (int a = 0; a < d; ++a) v[a] = node.free[a] + static_cast<Number>(gained[a]);
            surface.velocities[n].vector = v;
            for (int a = 0; a < d; ++a)
                if (is_last) by_index.value(n - 1, velocity + a) = v[a];
        }
        if (is_last) node.count = 0;
    }
};

/// A sweep: the impulse of each point, by the velocities of its nodes.
template <class Kernel, class Number, int d>
struct SweepPoints : PointLoop<Kernel, Number, d>
{
    Number ahead = 0;      ///< by which share of its change the next sweep starts ahead
    bool is_first = false; ///< it finds mobilities

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& surface = this->of;
        SurfacePoint<Number, d>& point = surface.points[p];
        if (is_first) {
            Number mobility = 0;
            this->for_each_node(p, [&](Number weight, std::uint32_t node) {
                mobility += weight * surface.velocities[node].number * surface.nodes[node].weights;
            });
            point.mobility = mobility;
        }
        if (!(point.mobility > 0)) return; // it reaches nothing
        Vector<Number, d> relative = point.velocity * -point.support;
        this->for_each_node(p, [&](Number weight, std::uint32_t node) {
            relative += surface.velocities[node].vector * weight;
        });
        Vector<Number, d> const tried = surface.tried[p].vector;
        Vector<Number, d> const improved =
            point.allowed(Vector<Number, d>(tried - relative * (1 / point.mobility)));
        surface.tried[p].vector = improved + (improved - point.impulse) * ahead;
        point.impulse = improved;
    }
};

/// Books what obstacles receive at a point.
template <class Number, int d, class Context>
struct BookImpulses
{
    SurfacePoint<Number, d> const* points;
    Context const* now;

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        SurfacePoint<Number, d> const& point = points[p];
        with_surface_action(now->actions, [&](auto const& action) {
            Reaction received;
            Vector<Number, d> const taken = point.impulse * -point.support;
            double arm[3]{0, 0, 0};
            for (int a = 0; a < d; ++a) received.impulse[a] = taken[a], arm[a] = point.arm[a];
            for (int a = 0; a < 3; ++a) {
                int const b = (a + 1) % 3, c = (a + 2) % 3;
                received.angular_impulse[a] = arm[b] * received.impulse[c] - arm[c] * received.impulse[b];
            }
            action.receive(point.obstacle, point.node, received);
        });
    }
};

/// How many sweeps a step has that starts from the impulses of the step before, and one that does not.
inline constexpr int sweeps_that_go_on = 3, sweeps_from_nothing = 40;

/// Lets the obstacles of a call that act at their surface act on nodes that have been updated. `points` are
/// those that were found before.
template <class Kernel, class Transfer, class Backend, class Number, int d, class Grid, class Context>
void act_at_surfaces(Backend const& backend, SurfaceMemory<Backend, Number, d>& memory, std::uint32_t points,
                     Grid& grid, Context const* now, Lattice const& lattice, double dt, Number smallest_mass)
{
    using Values = NodeValues<d, ValuesOf<Transfer>>;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    using Loop = PointLoop<Kernel, Number, d>;
    int const sweeps = memory.goes_on() ? sweeps_that_go_on : sweeps_from_nothing;
    auto const longer = static_cast<Number>(dt / memory.dt_before()),
               cell_size = static_cast<Number>(lattice.cell_size);
    memory.end_step(points, dt);
    if (points == 0) return;
    memory.make_room(points, std::size_t(Loop::nodes_of_each), grid.node_count());
    Loop const loop{memory.view()};
    auto const by_index = grid.nodes_by_index();
    using Nodes = std::remove_const_t<decltype(by_index)>;
    using FindNodes = FindNodesOfPoints<Kernel, Number, d, Nodes>;
    backend.for_each(FindNodes::count(points),
                     FindNodes{loop, points, by_index, smallest_mass, Sums::mass, Values::velocity});
    std::size_t const nodes = memory.most_reached(
        std::min(grid.node_count(), std::size_t(points) * std::size_t(Loop::nodes_of_each)));
    backend.for_each(nodes, MakeRoomForPoints<Number, d>{loop.of});
    backend.for_each(points, ListPoints<Kernel, Number, d>{loop, cell_size, longer});
    // velocities to 2^-46 cells a step: one that gained more than 16 cells would fail
    GatherImpulses<Kernel, Number, d, Nodes> gather{
        loop, RoundToMultiples::of(0x1p-46 * lattice.cell_size / dt), RoundToMultiples::of(0x1p-40), by_index,
        Values::velocity};
    gather.is_first = true;
    backend.for_each(nodes, gather);
    gather.is_first = false;
    SweepPoints<Kernel, Number, d> sweep{loop};
    double weight = 1;
    for (int i = 1; i <= sweeps; ++i) {
        double const next = (1 + std::sqrt(1 + 4 * weight * weight)) / 2;
        sweep.is_first = i == 1;
        gather.is_last = i == sweeps;
        sweep.ahead = gather.is_last ? Number(0) : static_cast<Number>((weight - 1) / next);
        backend.for_each(points, sweep);
        backend.for_each(nodes, gather);
        weight = next;
    }
    backend.for_each(points, BookImpulses<Number, d, Context>{loop.of.points, now});
}

} // namespace firn
