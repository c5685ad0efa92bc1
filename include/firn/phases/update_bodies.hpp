// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/bodies.hpp>
#include <firn/phases/update_grid.hpp>

#include <array>
#include <cstddef>
#include <limits>

namespace firn
{

/// Phase 2 in a scene of bodies with contact between them: each has sums and values of its own at a node.
/// Forces act on each as in UpdateGrid, then bodies act on each other, and then obstacles on each.
///
/// Where bodies a and b meet, an impulse P acts on a and -P on b:
///
///   P = m_a m_b / (m_a + m_b) (contact(u) - u),   u = v_a - v_b
///
/// where contact() is Contact::after with the normal of b's surface (Bardenhagen, Brackbill and Sulsky 2000,
/// *The material-point method for granular materials*; here pair by pair, so that the momentum of both
/// together changes by rounding alone). Where more than two meet, the pairs take turns.
///
/// The normal is that of the body whose surface is flatter around the node: of a surface that goes on, not of
/// the edge of what lies on it. Volumes and surfaces are found from the nodes' masses. Bodies touch where
/// they fill enough of the space around a node, see BodyContact::touching.
template <class Space, class Kernel, class Transfer, class Effects, std::size_t bodies>
struct UpdateBodies : UpdateGrid<Space, Kernel, Transfer, Effects>
{
    using Base = UpdateGrid<Space, Kernel, Transfer, Effects>;
    using Base::d;
    using typename Base::Number, typename Base::Result, typename Base::Sums;
    /// A node shows the sums of each layer, and has values for each.
    static constexpr bool tells_layers_apart = true;

    static_assert(Effects::walls == 0,
                  "Bodies know no ReflectingWall: choose Materials, or an Obstacle for a wall");
    static_assert(!ExtendsVelocities<Transfer>,
                  "Xpic knows no Bodies: choose another transfer, or Materials without contact");

    static_assert(Base::Carried::NodeFields::components(d) == 0,
                  "Bodies exchange momentum alone, and nothing else that is carried, such as heat: choose "
                  "Materials, which share all of it");

    BodyContact<bodies> contact;
    std::array<Number, bodies> volumes; ///< of a unit of each body's mass, over that of a cell
    bool acts = true;                   ///< whether there is contact

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& reactions) const
    {
        using Real = typename Node::Real;
        LanePosition<Real, d> const place{this->lattice, node.first(), node.offset(),
                                          kernel_reach(Kernel::degree)};
        Mask<Real> const everywhere = exactly_equal(Real(0), Real(0));
        std::array<typename Base::template Free<Real>, bodies> free;
        Real volume(0);
        Mask<Real> once = !everywhere, shared = once;
        for (std::size_t b = 0; b < bodies; ++b) {
            if (!node.has(b)) continue;
            free[b] = this->template free_node<Real>(
                place, [&](int c) { return node.sum(b, c); }, [](int) { return Real(0); },
                [&](int c, Real const& value) { node.set(b, c, value); }, everywhere);
            volume += free[b].nodes.mass * Real(volumes[b]);
            shared = shared | (once & free[b].nodes.filled);
            once = once | free[b].nodes.filled;
        }
        shared = shared & !(volume < Real(Number(contact.touching)));
        if (acts && any(shared)) touch(node, shared, free);
        for (std::size_t b = 0; b < bodies; ++b) {
            if (!node.has(b)) continue;
            this->template finish_node<Real>(
                place, free[b], free[b].velocity, [&](int c) { return node.sum(b, c); },
                [&](int c, Real const& value) { node.set(b, c, value); }, reactions);
        }
    }

private:
    /// A body's surface beside lanes of nodes.
    template <class Real>
    struct Surface
    {
        Vector<Real, d> inward; ///< its unit normal; 0 if there is none
        Real flatness;          ///< 1 for a plane, less at edges and for what is curved
    };

    /// Contact of all pairs of bodies at the nodes of `shared`.
    template <class Node, class Free, class Real = typename Node::Real>
    FIRN_HOST_DEVICE void touch(Node const& node, Mask<Real> const& shared,
                                std::array<Free, bodies>& free) const
    {
        constexpr int most_turns = 4; // a pair undoes some of what others did; what is left is small
        std::array<Surface<Real>, bodies> surfaces;
        int present = 0;
        for (std::size_t b = 0; b < bodies; ++b) {
            if (!node.has(b) || !any(shared & free[b].nodes.filled)) continue;
            surfaces[b] = surface(node, b, shared & free[b].nodes.filled);
            ++present;
        }
        for (int turn = 0; turn < (present == 2 ? 1 : most_turns); ++turn)
            for (std::size_t b = 1; b < bodies; ++b)
                for (std::size_t a = 0; node.has(b) && a < b; ++a) {
                    if (!node.has(a)) continue;
                    Mask<Real> const both = shared & free[a].nodes.filled & free[b].nodes.filled;
                    if (!any(both)) continue;
                    Vector<Real, d> const normal = normal_of(surfaces[b], surfaces[a]);
                    Mask<Real> const has_normal = both & (dot<Real, d>(normal, normal) > Real(0));
                    collide(contact.between(a, b), has_normal, normal, free[a], free[b]);
                }
    }

    /// The unit normal of b's surface where it touches a: that of the flatter surface, or between both if
    /// they are much the same, so that roundings do not decide. 0 if there is none.
    template <class Real>
    FIRN_HOST_DEVICE static Vector<Real, d> normal_of(Surface<Real> const& b, Surface<Real> const& a)
    {
        Real const ahead = (a.flatness - b.flatness) * Real(Number(1e4)) + Real(Number(0.5));
        Real const of_a = min(max(ahead, Real(0)), Real(1));
        Vector<Real, d> const normal = a.inward * of_a - b.inward * (Real(1) - of_a);
        Real const size2 = dot<Real, d>(normal, normal);
        Mask<Real> const has = size2 > Real(std::numeric_limits<Number>::min());
        return normal * select(has, inverse_sqrt(select(has, size2, Real(1))), Real(0));
    }

    /// Contact of two bodies where `which` holds, with b's unit normal.
    template <class Free, class Real>
    FIRN_HOST_DEVICE static void collide(Contact const& rule, Mask<Real> const& which,
                                         Vector<Real, d> const& normal, Free& a, Free& b)
    {
        Vector<Real, d> const u = a.velocity - b.velocity;
        Vector<Real, d> const change = rule.template after<Real, d>(u, normal) - u;
        Real const both = a.nodes.mass + b.nodes.mass, share = Real(1) / select(which, both, Real(1));
        Real const to_a = b.nodes.mass * share, to_b = a.nodes.mass * share;
        for (int i = 0; i < d; ++i) {
            a.velocity[i] += select(which, change[i] * to_a, Real(0));
            b.velocity[i] -= select(which, change[i] * to_b, Real(0));
        }
    }

    /// A body's surface, by the masses of the nodes around: the sum of their gradients in the cells that meet
    /// at a node, over the sum of the gradients' sizes.
    template <class Node, class Real = typename Node::Real>
    FIRN_HOST_DEVICE Surface<Real> surface(Node const& node, std::size_t body, Mask<Real> const& which) const
    {
        constexpr int nodes = d == 3 ? 27 : 9, cells = 1 << d;
        Real mass[std::size_t(nodes)];
        for (int n = 0; n < nodes; ++n) {
            Coordinates<d> step;
            for (int a = d - 1, rest = n; a >= 0; --a, rest /= 3) step[a] = rest % 3 - 1;
            mass[n] =
                n == nodes / 2 ? node.sum(body, Sums::mass) : node.sum_beside(body, Sums::mass, step, which);
        }
        Vector<Real, d> sum = zeros<Vector<Real, d>>();
        Real sizes(0);
        for (int cell = 0; cell < cells; ++cell) {
            Vector<Real, d> gradient = zeros<Vector<Real, d>>();
            for (int corner = 0; corner < cells; ++corner) {
                int n = 0;
                for (int a = 0; a < d; ++a) n = 3 * n + (cell >> a & 1) + (corner >> a & 1);
                for (int a = 0; a < d; ++a) gradient[a] += (corner >> a & 1) != 0 ? mass[n] : -mass[n];
            }
            sum += gradient;
            sizes += sqrt(dot<Real, d>(gradient, gradient));
        }
        Real const size = sqrt(dot<Real, d>(sum, sum));
        Mask<Real> const has = size > Real(std::numeric_limits<Number>::min());
        Real const share = select(has, Real(1) / select(has, size, Real(1)), Real(0));
        return {sum * share, select(has, size / select(has, sizes, Real(1)), Real(0))};
    }
};

} // namespace firn
