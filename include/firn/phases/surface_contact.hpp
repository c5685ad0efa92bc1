// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/grid/stencil.hpp>
#include <firn/phases/find_surface_points.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

// The impulses at points of surfaces, after nodes have been updated and before particles gather from them.
// All points are improved at once, sweep by sweep, by their own part of the equations, where the response of
// a point to its impulse is replaced by that to the impulses of all points around it: a bound, by which
// sweeps do not overshoot and pressure, which is smooth, is found at once. Each sweep starts ahead of the
// last one (Nesterov 1983; for contact Mazhar et al. 2015). Nothing is kept from step to step.
namespace firn
{

/// What these loops know; `Nodes` gives access to the nodes of a backend, see Grid::nodes_by_index().
template <class Kernel, class Number, int d, class Nodes>
struct PointLoop
{
    using Cell = Stencil<Kernel, Number, d>;
    static constexpr int nodes_of_each = Cell::rows * Cell::width;

    SurfacePoints<Number, d> of;
    Nodes nodes;
    double unit; ///< of the sums of velocities [m/s]

    FIRN_HOST_DEVICE NodeOfPoint<Number>* stencil(std::size_t p) const
    {
        return of.stencils + p * std::size_t(nodes_of_each);
    }
    /// Calls `use(node)` for the nodes of a point that have mass.
    template <class Use>
    FIRN_HOST_DEVICE void for_each_node(std::size_t p, Use const& use) const
    {
        NodeOfPoint<Number> const* const nodes_of_point = stencil(p);
        for (int k = 0; k < nodes_of_each; ++k)
            if (nodes_of_point[k].inverse_mass > 0) use(nodes_of_point[k]);
    }
    /// Adds the velocities that an impulse at a point gives to its nodes.
    FIRN_HOST_DEVICE void spread(std::size_t p, Vector<Number, d> const& impulse, std::int64_t* to) const
    {
        for_each_node(p, [&](NodeOfPoint<Number> const& node) {
            Number const gives = node.weight * node.inverse_mass;
            for (int a = 0; a < d; ++a)
                add_in_any_order(to[axis(node, a)], static_cast<std::int64_t>(
                                                        std::floor(double(gives * impulse[a]) / unit + 0.5)));
        });
    }
    FIRN_HOST_DEVICE static std::size_t axis(NodeOfPoint<Number> const& node, int a)
    {
        return std::size_t(node.index) * std::size_t(d) + std::size_t(a);
    }
};

inline constexpr double unit_of_weights = 0x1p-40;

/// Finds the nodes of a point's stencil, and adds its weights to them.
template <class Kernel, class Number, int d, class Nodes>
struct ReadStencils : PointLoop<Kernel, Number, d, Nodes>
{
    using Loop = PointLoop<Kernel, Number, d, Nodes>;
    using typename Loop::Cell;
    Lattice lattice;
    Number smallest_mass;
    Number longer; ///< the step over the one before
    int mass;      ///< the channel of the sums

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        SurfacePoint<Number, d>& point = this->of.points[p];
        Coordinates<d> first;
        Vector<Number, d> offset;
        for (int a = 0; a < d; ++a) {
            Number const x = point.offset[a] + Number(cell_shift(Kernel::degree)), cell = floor(x);
            first[a] = point.node[a] + static_cast<int>(cell) - stencil_reach(Kernel::degree);
            offset[a] = x - cell - Number(0.5);
        }
        Cell const cell(offset);
        Vector<Number, d> reached =
            zeros<Vector<Number, d>>(); // from the point to where its nodes act [cells]
        point.support = 0;
        for (int row = 0; row < Cell::rows; ++row)
            for (int k = 0; k < Cell::width; ++k) {
                int const at[3]{Cell::index(row, 0), d == 3 ? Cell::index(row, 1) : k, k};
                Coordinates<d> node = first;
                Vector<Number, d> way;
                for (int a = 0; a < d; ++a) {
                    node[a] += at[a];
                    way[a] = cell.distance[std::size_t(a)][std::size_t(at[a])];
                }
                Number weight = cell.row_weight(row) * cell.weight[std::size_t(d - 1)][std::size_t(k)];
                if (point.is_deep) {
                    weight = 1;
                    for (int a = 0; a < d; ++a) weight = node[a] == point.node[a] ? weight : Number(0);
                }
                auto& of_point = this->stencil(p)[row * Cell::width + k];
                of_point = read(node, weight);
                if (!(of_point.inverse_mass > 0)) continue;
                point.support += weight;
                reached += way * weight;
                add_in_any_order(this->of.weights[of_point.index],
                                 static_cast<std::int64_t>(double(weight) / unit_of_weights));
            }
        if (auto const* const before = this->of.before.find(point))
            point.impulse = point.tried = point.allowed(Vector<Number, d>(before->impulse * longer));
        if (point.support > 0 && !point.is_deep)
            point.arm += reached * (Number(lattice.cell_size) / point.support);
    }

private:
    FIRN_HOST_DEVICE NodeOfPoint<Number> read(Coordinates<d> const& node, Number weight) const
    {
        NodeOfPoint<Number> read{0, weight, 0};
        if (!(weight > 0)) return read;
        std::uint32_t const index = this->nodes.find(node);
        if (index == Nodes::absent) return read;
        Number const sum = this->nodes.sum(node, index, mass);
        if (!(sum > smallest_mass)) return read;
        read.index = index;
        read.inverse_mass = 1 / sum;
        return read;
    }
};

/// Bounds how fast an impulse at a point makes it, when the points around it receive as much; and gives nodes
/// the impulses that the first sweep starts from.
template <class Kernel, class Number, int d, class Nodes>
struct BoundMobility : PointLoop<Kernel, Number, d, Nodes>
{
    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        Number sum = 0;
        this->for_each_node(p, [&](NodeOfPoint<Number> const& node) {
            auto const all = static_cast<Number>(double(this->of.weights[node.index]) * unit_of_weights);
            sum += node.weight * node.inverse_mass * all;
        });
        SurfacePoint<Number, d>& point = this->of.points[p];
        point.mobility = sum;
        if (sum > 0)
            this->spread(p, point.impulse, this->of.velocities[0]);
        else
            point.impulse = point.tried = zeros<Vector<Number, d>>();
    }
};

/// A sweep: the impulse of each point by the velocities that the impulses of the sweep before give to its
/// nodes. Sums of velocities lie in three arrays by turns: one is read, one is added to, and one is cleared.
template <class Kernel, class Number, int d, class Nodes>
struct SweepPoints : PointLoop<Kernel, Number, d, Nodes>
{
    int velocity; ///< the first channel of the values
    Number ahead; ///< by which share of its change the next sweep starts ahead
    int turn;

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& of = this->of;
        SurfacePoint<Number, d>& point = of.points[p];
        if (!(point.mobility > 0)) return;
        std::int64_t const* const before = of.velocities[turn % 3];
        std::int64_t *const after = of.velocities[(turn + 1) % 3], *const next =
                                                                       of.velocities[(turn + 2) % 3];
        Vector<Number, d> relative = point.velocity * -point.support;
        this->for_each_node(p, [&](NodeOfPoint<Number> const& node) {
            for (int a = 0; a < d; ++a) {
                std::size_t const i = this->axis(node, a);
                relative[a] += node.weight * (this->nodes.value(node.index, velocity + a) +
                                              static_cast<Number>(double(before[i]) * this->unit));
                next[i] = 0;
            }
        });
        Vector<Number, d> const improved =
            point.allowed(Vector<Number, d>(point.tried - relative * (1 / point.mobility)));
        point.tried = improved + (improved - point.impulse) * ahead;
        point.impulse = improved;
        this->spread(p, point.tried, after);
    }
};

/// Adds the sums to the velocities of nodes, clears all sums, and books what obstacles receive.
template <class Kernel, class Number, int d, class Nodes, class Context>
struct ApplyImpulses : PointLoop<Kernel, Number, d, Nodes>
{
    Context const* now;
    int velocity; ///< the first channel of the values
    int turn;

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& of = this->of;
        SurfacePoint<Number, d> const& point = of.points[p];
        this->for_each_node(p, [&](NodeOfPoint<Number> const& node) {
            of.weights[node.index] = 0;
            for (int a = 0; a < d; ++a) {
                std::size_t const i = this->axis(node, a);
                of.velocities[(turn + 1) % 3][i] = of.velocities[(turn + 2) % 3][i] = 0;
                // a node belongs to several points: the first takes all
                std::int64_t const sum = take(of.velocities[turn % 3][i]);
                if (sum != 0)
                    this->nodes.value(node.index, velocity + a) +=
                        static_cast<Number>(double(sum) * this->unit);
            }
        });
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
inline constexpr int sweeps_that_go_on = 4, sweeps_from_nothing = 40;

/// Lets the obstacles of a call that act at their surface act on nodes that have been updated. `points` are
/// those that were found before.
template <class Kernel, class Transfer, class Backend, class Number, int d, class Grid, class Context>
void act_at_surfaces(Backend const& backend, SurfaceMemory<Backend, Number, d>& memory, std::uint32_t points,
                     Grid& grid, Context const* now, Lattice const& lattice, double dt, Number smallest_mass)
{
    using Values = NodeValues<d, ValuesOf<Transfer>>;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    using Nodes = decltype(grid.nodes_by_index());
    using Loop = PointLoop<Kernel, Number, d, Nodes>;
    int const sweeps = memory.goes_on() ? sweeps_that_go_on : sweeps_from_nothing;
    auto const longer = static_cast<Number>(dt / memory.dt_before());
    memory.end_step(points, dt);
    if (points == 0) return;
    memory.make_room_for_nodes(grid.node_count());
    Loop const loop{memory.view(), grid.nodes_by_index(), 0x1p-46 * lattice.cell_size / dt};
    backend.for_each(
        points, ReadStencils<Kernel, Number, d, Nodes>{loop, lattice, smallest_mass, longer, Sums::mass});
    backend.for_each(points, BoundMobility<Kernel, Number, d, Nodes>{loop});
    double weight = 1;
    for (int turn = 0; turn < sweeps; ++turn) { // sums begin in the array that the first sweep reads
        double const next = (1 + std::sqrt(1 + 4 * weight * weight)) / 2;
        bool const is_last = turn + 1 == sweeps;
        backend.for_each(points, SweepPoints<Kernel, Number, d, Nodes>{
                                     loop, Values::velocity,
                                     is_last ? Number(0) : static_cast<Number>((weight - 1) / next), turn});
        weight = next;
    }
    backend.for_each(points,
                     ApplyImpulses<Kernel, Number, d, Nodes, Context>{loop, now, Values::velocity, sweeps});
}

} // namespace firn
