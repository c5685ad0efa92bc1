// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/phases/find_surface_points.hpp>

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

    SurfacePoints<Number, d> of;

    FIRN_HOST_DEVICE NodeOfPoint<Number>* stencil(std::size_t p) const
    {
        return of.stencils + p * std::size_t(nodes_of_each);
    }
    /// Calls `use(place, node)` for the places of a linked stencil. Where there is no node it is the first of
    /// all, with a weight of 0: without a branch a device loads all of them at once.
    template <class Use>
    FIRN_HOST_DEVICE void for_each_node(std::size_t p, Use const& use) const
    {
        NodeOfPoint<Number> const* const places = stencil(p);
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < nodes_of_each; ++k) use(places[k], of.nodes[places[k].node]);
    }
};

inline constexpr double unit_of_weights = 0x1p-40;

/// Finds the nodes of a point's stencil by their indices. Of all places that have a node, one claims it.
template <class Kernel, class Number, int d, class Nodes>
struct ReadStencils : PointLoop<Kernel, Number, d>
{
    using typename PointLoop<Kernel, Number, d>::Cell;
    Nodes by_index; ///< see Grid::nodes_by_index()

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        SurfacePoint<Number, d> const& point = this->of.points[p];
        Coordinates<d> first;
        Vector<Number, d> offset;
        for (int a = 0; a < d; ++a) {
            Number const x = point.offset[a] + Number(cell_shift(Kernel::degree)), cell = floor(x);
            first[a] = point.node[a] + static_cast<int>(cell) - stencil_reach(Kernel::degree);
            offset[a] = x - cell - Number(0.5);
        }
        Cell const cell(offset);
        NodeOfPoint<Number>* place = this->stencil(p);
        for (int row = 0; row < Cell::rows; ++row)
            for (int k = 0; k < Cell::width; ++k, ++place) {
                int const at[3]{Cell::index(row, 0), d == 3 ? Cell::index(row, 1) : k, k};
                Coordinates<d> node = first;
                for (int a = 0; a < d; ++a) node[a] += at[a];
                place->weight = cell.row_weight(row) * cell.weight[std::size_t(d - 1)][std::size_t(k)];
                if (point.is_deep) {
                    place->weight = 1;
                    for (int a = 0; a < d; ++a)
                        if (node[a] != point.node[a]) place->weight = 0;
                }
                place->node = place->weight > 0 ? by_index.find(node) : NodeOfPoint<Number>::none;
                if (place->node != NodeOfPoint<Number>::none &&
                    read_shared(this->of.claims[place->node]) == 0)
                    claim(this->of.claims[place->node],
                          static_cast<std::uint32_t>(place - this->of.stencils) + 1);
            }
    }
    static_assert(Nodes::absent == NodeOfPoint<Number>::none);
};

/// Numbers the nodes that a point has claimed, if they have mass.
template <class Kernel, class Number, int d, class Nodes>
struct NumberNodes : PointLoop<Kernel, Number, d>
{
    Nodes by_index;
    Number smallest_mass; ///< see UpdateGrid
    int mass, velocity;   ///< the channels of the sums, and of the values

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& surface = this->of;
        NodeOfPoint<Number> const* const places = this->stencil(p);
        for (int k = 0; k < this->nodes_of_each; ++k) {
            std::uint32_t const index = places[k].node;
            if (index == Nodes::absent ||
                surface.claims[index] != static_cast<std::uint32_t>(places + k - surface.stencils) + 1)
                continue;
            Number const sum = by_index.sum(index, mass);
            surface.numbers[index] = NodeOfPoint<Number>::none;
            if (!(sum > smallest_mass)) continue;
            std::uint32_t const number = next_number(*surface.node_count);
            surface.numbers[index] = number;
            NodeAtSurface<Number, d>& node = surface.nodes[number];
            node.index = index;
            node.inverse_mass = 1 / sum;
            node.count = 0;
            for (int a = 0; a < d; ++a) node.free[a] = by_index.value(index, velocity + a);
        }
    }
};

/// Replaces the indices in a point's stencil by the numbers of its nodes, counts the points of
/// each node, and lets the point start from its impulse in the step before. No node is claimed any
/// more.
template <class Kernel, class Number, int d>
struct LinkStencils : PointLoop<Kernel, Number, d>
{
    using typename PointLoop<Kernel, Number, d>::Cell;
    Number cell_size; ///< [m]
    Number longer;    ///< the step over the one before

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& surface = this->of;
        SurfacePoint<Number, d>& point = surface.points[p];
        // the means of the places of its nodes: of those with mass, and of all [cells]
        Vector<Number, d> reached = zeros<Vector<Number, d>>(), all = reached;
        point.support = 0;
        NodeOfPoint<Number>* const places = this->stencil(p);
        for (int k = 0; k < this->nodes_of_each; ++k) {
            Vector<Number, d> at;
            for (int a = d - 1, rest = k; a >= 0; --a, rest /= Cell::width)
                at[a] = Number(rest % Cell::width);
            Number const weight = places[k].weight;
            all += at * weight;
            std::uint32_t node = places[k].node;
            if (node != NodeOfPoint<Number>::none) {
                write_shared(surface.claims[node], 0);
                node = surface.numbers[node];
            }
            places[k] = {0, 0, Number(0)};
            if (node == NodeOfPoint<Number>::none) continue;
            point.support += weight;
            reached += at * weight;
            places[k] = {node, next_number(surface.nodes[node].count), weight};
        }
        if (point.support > 0 && !point.is_deep)
            point.arm += (reached * (1 / point.support) - all) * cell_size;
        if (auto const* const before = surface.before.find(point))
            point.impulse = point.tried = point.allowed(Vector<Number, d>(before->impulse * longer));
    }
};

/// Nodes make room for the points that reach them in a list of all.
template <class Number, int d>
struct MakeRoomForPoints
{
    SurfacePoints<Number, d> of;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        of.nodes[i].begin = next_number(*of.listed, of.nodes[i].count);
    }
};

/// Points enter themselves there.
template <class Kernel, class Number, int d>
struct ListPoints : PointLoop<Kernel, Number, d>
{
    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        this->for_each_node(p, [&](NodeOfPoint<Number> const& place, NodeAtSurface<Number, d> const& node) {
            if (place.weight > 0)
                this->of.points_of_nodes[node.begin + place.rank] = {static_cast<std::uint32_t>(p),
                                                                     place.weight};
        });
    }
};

/// Nodes take the velocities that the impulses of the points around them give. A node asks its points, since
/// many of these would wait for one another if they added to it.
template <class Kernel, class Number, int d>
struct GatherImpulses : PointLoop<Kernel, Number, d>
{
    double unit; ///< of the velocities that nodes gain: 2^-46 cells a step [m/s]
    bool weighs; ///< the first time: the weights of points are summed, too

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const& surface = this->of;
        NodeAtSurface<Number, d>& node = surface.nodes[i];
        std::int64_t gained[std::size_t(d)]{}, weights = 0; // integers come to the same sum in any order
        for (std::uint32_t at = node.begin; at < node.begin + node.count; ++at) {
            PointOfNode<Number> const from = surface.points_of_nodes[at];
            auto const& impulse = surface.points[from.point].tried;
            double const gives = double(from.weight * node.inverse_mass) / unit;
            for (int a = 0; a < d; ++a) { // rounded, without a call to the C library
                double const gain = gives * double(impulse[a]);
                // a step that gave more than that, or NaN, fails: it moves particles by more than a cell
                if (std::abs(gain) < 0x1p57)
                    gained[a] += static_cast<std::int64_t>(gain + (gain < 0 ? -0.5 : 0.5));
            }
            weights += static_cast<std::int64_t>(double(from.weight) / unit_of_weights);
        }
        if (weighs) node.weights = static_cast<Number>(double(weights) * unit_of_weights);
        for (int a = 0; a < d; ++a)
            node.velocity[a] = node.free[a] + static_cast<Number>(double(gained[a]) * unit);
    }
};

/// Bounds how fast an impulse at a point makes it, when the points around it receive as much.
template <class Kernel, class Number, int d>
struct BoundMobility : PointLoop<Kernel, Number, d>
{
    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        Number mobility = 0;
        this->for_each_node(p, [&](NodeOfPoint<Number> const& place, NodeAtSurface<Number, d> const& node) {
            mobility += place.weight * node.inverse_mass * node.weights;
        });
        this->of.points[p].mobility = mobility;
    }
};

/// A sweep: the impulse of each point, by the velocities of its nodes.
template <class Kernel, class Number, int d>
struct SweepPoints : PointLoop<Kernel, Number, d>
{
    Number ahead; ///< by which share of its change the next sweep starts ahead

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        SurfacePoint<Number, d>& point = this->of.points[p];
        if (!(point.mobility > 0)) return; // it reaches nothing
        Vector<Number, d> relative = point.velocity * -point.support;
        this->for_each_node(p, [&](NodeOfPoint<Number> const& place, NodeAtSurface<Number, d> const& node) {
            for (int a = 0; a < d; ++a) relative[a] += place.weight * node.velocity[a];
        });
        Vector<Number, d> const improved =
            point.allowed(Vector<Number, d>(point.tried - relative * (1 / point.mobility)));
        point.tried = improved + (improved - point.impulse) * ahead;
        point.impulse = improved;
    }
};

/// Gives the grid the velocities of nodes.
template <class Number, int d, class Nodes>
struct ReturnVelocitiesToGrid
{
    NodeAtSurface<Number, d> const* nodes;
    Nodes by_index;
    int velocity; ///< the first channel of the values

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        for (int a = 0; a < d; ++a) by_index.value(nodes[i].index, velocity + a) = nodes[i].velocity[a];
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
    memory.make_room_for_nodes(grid.node_count(), std::size_t(points) * std::size_t(Loop::nodes_of_each));
    Loop const loop{memory.view()};
    auto const by_index = grid.nodes_by_index();
    using Nodes = std::remove_const_t<decltype(by_index)>;
    backend.for_each(points, ReadStencils<Kernel, Number, d, Nodes>{loop, by_index});
    backend.for_each(points, NumberNodes<Kernel, Number, d, Nodes>{loop, by_index, smallest_mass, Sums::mass,
                                                                   Values::velocity});
    backend.for_each(points, LinkStencils<Kernel, Number, d>{loop, cell_size, longer});
    std::size_t const nodes = memory.node_count();
    backend.for_each(nodes, MakeRoomForPoints<Number, d>{loop.of});
    backend.for_each(points, ListPoints<Kernel, Number, d>{loop});
    GatherImpulses<Kernel, Number, d> gather{loop, 0x1p-46 * lattice.cell_size / dt, true};
    backend.for_each(nodes, gather);
    gather.weighs = false;
    backend.for_each(points, BoundMobility<Kernel, Number, d>{loop});
    double weight = 1;
    for (int sweep = 1; sweep <= sweeps; ++sweep) {
        double const next = (1 + std::sqrt(1 + 4 * weight * weight)) / 2;
        auto const ahead = sweep == sweeps ? Number(0) : static_cast<Number>((weight - 1) / next);
        backend.for_each(points, SweepPoints<Kernel, Number, d>{loop, ahead});
        backend.for_each(nodes, gather);
        weight = next;
    }
    backend.for_each(nodes,
                     ReturnVelocitiesToGrid<Number, d, Nodes>{loop.of.nodes, by_index, Values::velocity});
    backend.for_each(points, BookImpulses<Number, d, Context>{loop.of.points, now});
}

} // namespace firn
