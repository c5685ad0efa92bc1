// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/effects/surface_memory.hpp>
#include <firn/phases/find_surface_points.hpp>
#include <firn/phases/surface_stencils.hpp>

#include <cstddef>
#include <cstdint>

// The impulses at points of surfaces, after nodes have been updated and before particles gather from them.
// All points are improved at once, sweep by sweep, by their own part of the equations, where the response of
// a point to its impulse is replaced by that to the impulses of all points around it: a bound, by which
// sweeps do not overshoot and pressure, which is smooth, is found at once. Each sweep starts ahead of the
// last one (Nesterov 1983; for contact Mazhar et al. 2015). Within a call a step starts from the impulses of
// the step before.
namespace firn
{

/// Of how many points a node reads the impulses at once, so that a device waits for them together: where the
/// surface is plane, of all.
#if defined(FIRN_FOR_DEVICE)
inline constexpr std::uint32_t points_at_once = 9;
#else
inline constexpr std::uint32_t points_at_once = 1;
#endif

/// Nodes take the velocities that the impulses of the points around them give.
template <class Kernel, class Number, int d, class Nodes>
struct GatherImpulses : PointLoop<Kernel, Number, d>
{
    Nodes by_index;
    int velocity;         ///< the first channel of the grid's values
    bool is_last = false; ///< the grid takes the velocities

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const& surface = this->of;
        if (i >= *surface.reached_nodes) return;
        NodeAtSurface<Number, d> const node = surface.reached[i];
        VectorAndNumber<Number, d> gained{}; // and the sum of weights
        std::uint32_t const end = node.points.begin + (node.inverse_mass > 0 ? node.points.count : 0);
        FIRN_ROLLED_ON_DEVICE
        for (std::uint32_t first = node.points.begin; first < end; first += points_at_once) {
            PointOfNode<Number> from[points_at_once];
            VectorAndNumber<Number, d> tried[points_at_once];
            FIRN_UNROLL_ON_DEVICE
            for (std::uint32_t k = 0; k < points_at_once; ++k) {
                from[k] = surface.points_of_nodes[first + k < end ? first + k : end - 1];
                if (first + k >= end) from[k].weight = 0;
            }
            FIRN_UNROLL_ON_DEVICE
            for (std::uint32_t k = 0; k < points_at_once; ++k) tried[k] = surface.tried[from[k].point()];
            FIRN_UNROLL_ON_DEVICE
            for (std::uint32_t k = 0; k < points_at_once; ++k) gained.all += tried[k].all * from[k].weight;
        }
        VectorAndNumber<Number, d>& v = surface.velocities[i + 1];
        v.all = node.free.all + gained.all * node.inverse_mass;
        if (is_last && node.inverse_mass > 0)
            for (int a = 0; a < d; ++a) by_index.value(node.node - 1, velocity + a) = v.all[a];
    }
};

/// A sweep: the impulse of each point, by the velocities of its nodes.
template <class Kernel, class Number, int d>
struct SweepPoints : PointLoop<Kernel, Number, d>
{
    using Loop = PointLoop<Kernel, Number, d>;
    using typename Loop::Cell;
    Number cell_size;      ///< [m]
    Number ahead = 0;      ///< by which share of its change the next sweep starts ahead
    bool is_first = false; ///< it finds what the point reaches, if that may have changed

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        auto const& surface = this->of;
        SurfacePoint<Number, d>& point = surface.points[p];
        if (is_first && surface.to_list[p] != 0) begin(p, point);
        // the velocity, and a bound on the speed [m/s] that an impulse of 1 gives if the points around get
        // one, too
        VectorAndNumber<Number, d> of_column[std::size_t(Cell::width)]{}; // which do not wait for one another
        auto const all_of = [&](std::uint32_t node) { return surface.velocities[node]; };
        this->for_each_node(surface.acting, p, all_of, [&](int k, Number weight, auto const& there) {
            of_column[k % Cell::width].all += there.all * weight;
        });
        VectorAndNumber<Number, d> sum = of_column[0];
        for (int k = 1; k < Cell::width; ++k) sum.all += of_column[k].all;
        if (!(sum.number() > 0)) return; // it reaches nothing
        Vector<Number, d> const relative = sum.vector() - point.velocity * point.support;
        VectorAndNumber<Number, d>& tried = surface.tried[p];
        Vector<Number, d> const improved =
            point.allowed(Vector<Number, d>(tried.vector() - relative * (1 / sum.number())));
        tried.set(Vector<Number, d>(improved + (improved - point.impulse) * ahead));
        point.impulse = improved;
    }

private:
    FIRN_HOST_DEVICE void begin(std::size_t p, SurfacePoint<Number, d>& point) const
    {
        Vector<Number, d> reached = zeros<Vector<Number, d>>(), offset; // the mean place of its nodes
        Number support = 0;
        auto const nothing_of = [](std::uint32_t) { return 0; };
        this->for_each_node(this->of.acting, p, nothing_of, [&](int k, Number weight, int) {
            support += weight;
            for (int a = d - 1, rest = k; a >= 0; --a, rest /= Cell::width)
                reached[a] += weight * Number(rest % Cell::width);
        });
        point.support = support;
        point.arm_of_impulse = point.arm;
        if (!(support > 0) || point.is_deep) return;
        Loop::cell_of(point, offset); // the mean of all nodes is the point, but some may have no mass
        for (int a = 0; a < d; ++a)
            point.arm_of_impulse[a] +=
                (reached[a] / support - Number(0.5) * Kernel::degree - offset[a]) * cell_size;
    }
};

/// Books what obstacles receive at a point.
template <class Number, int d, class Context>
struct BookImpulse
{
    Context const* now;

    /// `slot`: see ReactionSums.
    FIRN_HOST_DEVICE void operator()(SurfacePoint<Number, d> const& point, std::uint32_t slot) const
    {
        Vector<Number, d> const taken = point.impulse * -point.support;
        bool is_any = false;
        for (int a = 0; a < d; ++a) is_any = is_any || !(abs(taken[a]) <= Number(0)); // NaN is
        if (!is_any) return;
        with_surface_action(now->actions, point.obstacle, [&](auto const& action, std::uint32_t i) {
            Reaction received;
            double arm[3]{0, 0, 0};
            for (int a = 0; a < d; ++a) received.impulse[a] = taken[a], arm[a] = point.arm_of_impulse[a];
            for (int a = 0; a < 3; ++a) {
                int const b = (a + 1) % 3, c = (a + 2) % 3;
                received.angular_impulse[a] = arm[b] * received.impulse[c] - arm[c] * received.impulse[b];
            }
            action.sums.template add<true>(i, slot, received);
        });
    }
};

/// The last sweep, whose impulses count.
template <class Kernel, class Number, int d, class Context>
struct SweepAndBook : SweepPoints<Kernel, Number, d>
{
    BookImpulse<Number, d, Context> book;

    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        SweepPoints<Kernel, Number, d>::operator()(p);
        constexpr std::size_t run_together = 32;
        book(this->of.points[p], static_cast<std::uint32_t>(p / run_together));
    }
};

} // namespace firn
