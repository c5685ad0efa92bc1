// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/phases/surface_stencils.hpp>

#include <cstddef>
#include <cstdint>

// Which points of surfaces reach a node, after points have found their nodes: see surface_stencils.hpp.
namespace firn
{

/// Points enter themselves in the lists of their nodes, with the weights that they have for these.
template <class Kernel, class Number, int d, int rows_of_part>
struct ListPoints : RowLoop<Kernel, Number, d, rows_of_part>
{
    using Rows = RowLoop<Kernel, Number, d, rows_of_part>;
    using typename Rows::Cell;

    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        std::size_t const p = Rows::point(i);
        if (p >= this->points || this->of.to_list[p] == 0) return;
        Number const per_light = this->of.points[p].per_light;
        int const first = Rows::first_row(i);
        for (int row = first; row < first + rows_of_part; ++row) list(p, row * Cell::width, per_light);
    }

private:
    FIRN_HOST_DEVICE void list(std::size_t p, int first, Number per_light) const
    {
        auto const& surface = this->of;
        std::size_t const place = Rows::place(p, first);
        NodeOfPoint<Number> there[std::size_t(Cell::width)];
        std::uint32_t at[std::size_t(Cell::width)];
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            there[k] = surface.stencils[place + std::size_t(k) * Rows::tile];
            std::uint32_t const number = there[k].node - (there[k].node != NodeOfPoint<Number>::none);
            at[k] = surface.reached[number].points.begin + surface.ranks[place + std::size_t(k) * Rows::tile];
            Number const mass = surface.velocities[there[k].node].number();
            there[k].weight *= min(mass * per_light, Number(1));
        }
        FIRN_UNROLL_ON_DEVICE
        for (int k = 0; k < Cell::width; ++k) {
            surface.acting[place + std::size_t(k) * Rows::tile] = {
                there[k].weight > 0 ? there[k].node : NodeOfPoint<Number>::none, there[k].weight};
            if (there[k].node != NodeOfPoint<Number>::none)
                surface.points_of_nodes[at[k]] = PointOfNode<Number>::of(first + k, p, there[k].weight);
        }
    }
};

/// The points of a node take the order in which it adds up what they give.
template <class Kernel, class Number, int d>
struct SortPoints : PointLoop<Kernel, Number, d>
{
    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const& surface = this->of;
        if (i >= *surface.reached_nodes || *surface.changes == 0 || !surface.reached[i].has_new_points)
            return;
        PointsOfNode const points = surface.reached[i].points;
        PointOfNode<Number>* const list = surface.points_of_nodes + points.begin;
        for (std::uint32_t n = 1; n < points.count; ++n) {
            PointOfNode<Number> const one = list[n];
            std::uint32_t to = n;
            for (; to > 0 && comes_before(one, list[to - 1]); --to) {
                list[to] = list[to - 1];
                rank(list[to]) = to;
            }
            if (to == n) continue;
            list[to] = one;
            rank(one) = to;
        }
    }

private:
    FIRN_HOST_DEVICE std::uint32_t& rank(PointOfNode<Number> const& of_node) const
    {
        return this->of.ranks[this->place(of_node.point(), of_node.place())];
    }
    /// By the node's place in their stencils, from the last one on, as a processor finds them.
    FIRN_HOST_DEVICE bool comes_before(PointOfNode<Number> const& one, PointOfNode<Number> const& other) const
    {
        if (one.place() != other.place()) return one.place() > other.place();
        return this->of.points[one.point()].comes_before(this->of.points[other.point()]);
    }
};

} // namespace firn
