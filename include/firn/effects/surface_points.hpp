// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/contact.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

// Contact at the surface of obstacles. Where a uniform pressure p meets a surface, node i receives the force
// -p w_i(x_s) n per area: the kernel's weight at the point x_s of the surface, on both sides of it. Nodes
// inside that lose their velocity take a part of this, and the rest drives currents. What balances it for any
// place of the surface are impulses at its points, spread by the same weights:
//
//   m_i v_i += w_i(x_s) lambda_s,    sum_i w_i(x_s) (v_i - u_s) . n >= 0  and  lambda_s . n >= 0
//
// where one of the two is 0, with Coulomb's law for the rest of lambda_s. About one point lies in each cell
// that the surface crosses.
namespace firn
{

/// A point where an obstacle's surface acts on the grid.
template <class Number, int d>
struct SurfacePoint
{
    Coordinates<d> node;        ///< in whose cube of a cell it was found
    Vector<Number, d> offset;   ///< from the node [cells]
    Vector<Number, d> normal;   ///< outward
    Vector<Number, d> velocity; ///< of the surface [m/s]
    Vector<Number, d> arm;      ///< from the obstacle's reference point [m]
    std::uint32_t obstacle;
    /// 0, or 1 + the obstacle into which the surface is continued: see FindSurfacePoints.
    std::uint32_t behind;
    /// Whether it is a node inside: one so deep that no point of the surface reaches it, which goes no
    /// deeper, or any node in what sticks.
    bool is_deep;
    bool separates, sticks; ///< of the obstacle's Contact
    Number friction;

    Number support; ///< the sum of the weights of nodes with mass
    /// A bound on the speed [m/s] that an impulse of 1 gives it, when the points beside it receive as much.
    Number mobility;
    Vector<Number, d> impulse; ///< on the material [solver's unit of mass times m/s]
    Vector<Number, d> tried;   ///< what the next sweep starts from

    /// The nearest impulse that the contact allows.
    FIRN_HOST_DEVICE Vector<Number, d> allowed(Vector<Number, d> const& wanted) const
    {
        if (sticks) return wanted;
        Number along = dot<Number, d>(wanted, normal);
        Vector<Number, d> const across = wanted - normal * along;
        if (separates) along = max(along, Number(0));
        Number const limit = along > Number(0) ? friction * along : Number(0),
                     length = sqrt(dot<Number, d>(across, across));
        return normal * along + across * (length > limit ? limit / length : Number(1));
    }
};

/// A node of a point's stencil.
template <class Number>
struct NodeOfPoint
{
    static constexpr std::uint32_t none = ~std::uint32_t(0);
    std::uint32_t node; ///< its number among the nodes that points reach, or none: there is nothing on it
    std::uint32_t rank; ///< among the places with this node
    Number weight;
};

/// A point that reaches a node.
template <class Number>
struct PointOfNode
{
    std::uint32_t point;
    Number weight;
};

/// A node that points reach. What they give it is summed as integers, so it does not depend on their order.
template <class Number, int d>
struct NodeAtSurface
{
    std::uint32_t index; ///< see Grid::nodes_by_index()
    Number inverse_mass;
    Vector<Number, d> free;     ///< its velocity without contact [m/s]
    Vector<Number, d> velocity; ///< and with the impulses of the last sweep
    std::uint32_t begin, count; ///< of its points in the list of those of all nodes
    Number weights;             ///< the sum of the weights of points
};

/// What lanes of places are to an obstacle.
template <class Real, int d>
struct SurfaceAt
{
    Vector<Real, d> arm;    ///< from its reference point [m]
    Real distance;          ///< from its surface [m], negative inside
    Vector<Real, d> normal; ///< outward, in world axes
};

/// The points of the step before, and a hash table by which they are found. Sweeps start from their impulses.
template <class Number, int d>
struct PointsBefore
{
    SurfacePoint<Number, d> const* points;
    std::uint32_t* table; ///< the numbers of points from 1 on; 0: nothing is there
    std::uint32_t mask;   ///< the table's size, a power of two, less one

    /// The same point then; null if there was none.
    FIRN_HOST_DEVICE SurfacePoint<Number, d> const* find(SurfacePoint<Number, d> const& now) const
    {
        for (std::uint32_t at = hash(now) & mask; table[at] != 0; at = (at + 1) & mask) {
            SurfacePoint<Number, d> const& point = points[table[at] - 1];
            bool same = point.obstacle == now.obstacle && point.behind == now.behind;
            for (int a = 0; a < d; ++a) same = same && point.node[a] == now.node[a];
            if (same) return &point;
        }
        return nullptr;
    }
    /// Enters a point.
    FIRN_HOST_DEVICE void operator()(std::size_t p) const
    {
        std::uint32_t at = hash(points[p]) & mask;
        while (!claim(table[at], static_cast<std::uint32_t>(p) + 1)) at = (at + 1) & mask;
    }

private:
    FIRN_HOST_DEVICE static std::uint32_t hash(SurfacePoint<Number, d> const& point)
    {
        std::uint64_t mixed = (std::uint64_t(point.behind) << 32) + point.obstacle;
        for (int a = 0; a < d; ++a) {
            mixed = (mixed ^ static_cast<std::uint32_t>(point.node[a])) * 0x9e3779b97f4a7c15u;
            mixed ^= mixed >> 29;
        }
        return static_cast<std::uint32_t>(mixed >> 16);
    }
};

/// The points of a step and the nodes that they reach, as loops see them.
template <class Number, int d>
struct SurfacePoints
{
    SurfacePoint<Number, d>* points;
    std::uint32_t* count; ///< of the points that were found; those beyond `room` are not there
    std::uint32_t room;
    NodeOfPoint<Number>* stencils;        ///< of each point
    PointOfNode<Number>* points_of_nodes; ///< the points of each node, one behind the other
    std::uint32_t* listed;                ///< how many of these there are
    NodeAtSurface<Number, d>* nodes;
    std::uint32_t* node_count;
    std::uint32_t* claims;  ///< by index of a node: the place of a stencil that numbers it, from 1 on; else 0
    std::uint32_t* numbers; ///< by index of a node: its number
    PointsBefore<Number, d> before;
};

/// The memory for that, kept for later steps. Between steps no node is claimed.
template <class Backend, class Number, int d>
class SurfaceMemory
{
    template <class T>
    using Array = typename Backend::template Array<T>;

public:
    explicit SurfaceMemory(Backend const& backend)
        : backend_(backend), points_(backend), before_(backend), table_(backend), stencils_(backend),
          points_of_nodes_(backend), counts_(backend), nodes_(backend), claims_(backend), numbers_(backend)
    {
        counts_.resize(3);
        make_room(256, 1);
    }

    /// Makes room for so many points with so many nodes each, and keeps points that fit.
    void make_room(std::size_t points, std::size_t nodes_of_each)
    {
        if (points > points_.size()) points_.resize(points);
        stencils_.resize(std::max(stencils_.size(), points_.size() * nodes_of_each), 0);
        points_of_nodes_.resize(stencils_.size(), 0);
    }
    /// Makes room for nodes with so many indices, of which points reach at most so many.
    void make_room_for_nodes(std::size_t indices, std::size_t reached)
    {
        if (indices > numbers_.size()) numbers_.resize(indices, 0);
        if (std::size_t const before = claims_.size(); indices > before) {
            claims_.resize(indices);
            claims_.fill(before, indices - before, 0);
        }
        nodes_.resize(std::max(nodes_.size(), std::min(indices, reached)), 0);
    }
    /// Forgets the impulses of the step before: it was not taken, or a call begins. What a call does then
    /// depends on the state before it alone.
    void forget() { known_ = 0; }
    /// Whether sweeps start from the impulses of the step before.
    bool goes_on() const { return known_ > 0; }
    /// Before a step: the points of the last one become those before it.
    void begin_step()
    {
        points_.swap(before_);
        if (points_.size() < before_.size()) points_.resize(before_.size(), 0);
        std::size_t const size = std::bit_ceil(2 * std::size_t(known_) + 1);
        if (table_.size() < size) table_.resize(size, 0);
        table_.fill(0, size, 0);
        before_view_ = {before_.data(), table_.data(), static_cast<std::uint32_t>(size - 1)};
        backend_.for_each(known_, before_view_);
    }
    /// After a step with so many points, of this length [s].
    void end_step(std::uint32_t points, double dt)
    {
        known_ = points;
        dt_ = dt;
    }
    double dt_before() const { return dt_; } ///< [s]
    /// The points of the last step, on the host.
    std::vector<SurfacePoint<Number, d>> last() const
    {
        std::vector<SurfacePoint<Number, d>> points(known_);
        if (known_ > 0) points_.download(0, points);
        return points;
    }
    /// Before points are looked for.
    void begin() { counts_.fill(0, 3, 0); }
    /// How many points have been found, and how many nodes they reach; both wait for the loops that count.
    std::uint32_t count() const { return read(0); }
    std::uint32_t node_count() const { return read(1); }
    std::size_t room() const { return points_.size(); }

    SurfacePoints<Number, d> view()
    {
        return {points_.data(),
                counts_.data(),
                static_cast<std::uint32_t>(points_.size()),
                stencils_.data(),
                points_of_nodes_.data(),
                counts_.data() + 2,
                nodes_.data(),
                counts_.data() + 1,
                claims_.data(),
                numbers_.data(),
                before_view_};
    }

private:
    std::uint32_t read(std::size_t which) const
    {
        std::uint32_t count = 0;
        counts_.download(which, {&count, 1});
        return count;
    }

    Backend backend_;
    Array<SurfacePoint<Number, d>> points_, before_;
    Array<std::uint32_t> table_;
    PointsBefore<Number, d> before_view_{};
    std::uint32_t known_ = 0; ///< the points of the step before
    double dt_ = 1;           ///< its length [s]
    Array<NodeOfPoint<Number>> stencils_;
    Array<PointOfNode<Number>> points_of_nodes_;
    Array<std::uint32_t> counts_; ///< of points, of nodes, and of points of nodes
    Array<NodeAtSurface<Number, d>> nodes_;
    Array<std::uint32_t> claims_, numbers_;
};

} // namespace firn
