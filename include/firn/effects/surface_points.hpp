// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/four.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/contact.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>

#include <cstddef>
#include <cstdint>

// Contact at the surface of obstacles. Where a uniform pressure p meets a surface, node i receives the force
// -p w_i(x_s) n per area: the kernel's weight at the point x_s of the surface, on both sides of it (with
// the forces of Mls another weight, see SurfaceWeights). Nodes inside that lose their velocity take a part of
// this, and the rest drives currents. What balances it for any place of the surface are impulses at its
// points, spread by the same weights:
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
    std::uint32_t candidate; ///< by which it was found
    /// 0, or 1 + the obstacle into which the surface is continued: see FindSurfacePoints.
    std::uint32_t behind;
    /// Whether it is a node inside: one so deep that no point of the surface reaches it, which goes no
    /// deeper, or any node in what sticks.
    bool is_deep;
    bool separates, sticks; ///< of the obstacle's Contact
    bool is_two_sided;      ///< of a thin shell: it pushes either way, and never lets go
    bool is_plain;          ///< whether none of its nodes is light: it has all of its weight for them
    bool is_listed;         ///< whether their lists say so
    bool is_whole;          ///< whether the grid had all of them when they were found
    Number friction;

    /// The same to the mean place of the nodes that take the impulse [m].
    Vector<Number, d> arm_of_impulse;
    Number per_light;          ///< the inverse of the mass below which a node is light
    Number support;            ///< the sum of the weights of nodes with mass
    Vector<Number, d> impulse; ///< on the material [solver's unit of mass times m/s]

    /// Whether this is that point, in another step or another list.
    FIRN_HOST_DEVICE bool is(SurfacePoint const& other) const
    {
        bool same = obstacle == other.obstacle && behind == other.behind && is_deep == other.is_deep;
        for (int a = 0; a < d; ++a) same = same && node[a] == other.node[a];
        return same;
    }
    /// Whether this point comes first, in an order that depends on what tells points apart alone.
    FIRN_HOST_DEVICE bool comes_before(SurfacePoint const& other) const
    {
        for (int a = 0; a < d; ++a)
            if (node[a] != other.node[a]) return node[a] < other.node[a];
        if (obstacle != other.obstacle) return obstacle < other.obstacle;
        if (behind != other.behind) return behind < other.behind;
        return is_deep < other.is_deep;
    }

    /// The nearest impulse that the contact allows.
    FIRN_HOST_DEVICE Vector<Number, d> allowed(Vector<Number, d> const& wanted) const
    {
        if (sticks) return wanted;
        Number along = dot<Number, d>(wanted, normal);
        Vector<Number, d> const across = wanted - normal * along;
        if (separates) along = max(along, Number(0));
        Number const pressed = is_two_sided ? abs(along) : along,
                     limit = pressed > Number(0) ? friction * pressed : Number(0),
                     length = sqrt(dot<Number, d>(across, across));
        return normal * along + across * (length > limit ? limit / length : Number(1));
    }
};

/// A number in which all bits depend on all of these.
template <int d>
FIRN_HOST_DEVICE std::uint64_t mixed(std::uint64_t number, Coordinates<d> const& node)
{
    for (int a = 0; a < d; ++a) {
        number = (number ^ static_cast<std::uint32_t>(node[a])) * 0x9e3779b97f4a7c15u;
        number ^= number >> 29;
    }
    return number;
}

/// A node at which a point of an obstacle's surface may have been found, or that lies deep inside.
template <int d>
struct SurfaceCandidate
{
    Coordinates<d> node;
    std::uint32_t obstacle;
};

/// A vector and a number behind it.
template <class Number, int d>
struct VectorAndNumber
{
    Four<Number> all;

    FIRN_HOST_DEVICE void set(Vector<Number, d> const& vector)
    {
        for (int a = 0; a < d; ++a) all[a] = vector[a];
        if constexpr (d == 2) all[2] = Number(0);
    }
    FIRN_HOST_DEVICE void set_number(Number number) { all[3] = number; }
    FIRN_HOST_DEVICE Vector<Number, d> vector() const
    {
        return make_vector<Number, d>([&](int a) { return all[a]; });
    }
    FIRN_HOST_DEVICE Number number() const { return all[3]; }
};

/// A node of a point's stencil.
template <class Number>
struct NodeOfPoint
{
    static constexpr std::uint32_t none = 0; ///< the first of all nodes, on which there is nothing
    /// 1 + its number among those that points reach; or none; or until it has been numbered index_of(its
    /// index), see Grid::nodes_by_index().
    std::uint32_t node;
    Number weight; ///< negative while the grid has no such node

    FIRN_HOST_DEVICE static std::uint32_t index_of(std::uint32_t index) { return ~index; }
    FIRN_HOST_DEVICE bool has_index() const { return node >> 31 != 0; }
    FIRN_HOST_DEVICE std::uint32_t index() const { return ~node; }
};

/// A point that reaches a node.
template <class Number>
struct PointOfNode
{
    static constexpr int bits = 26; ///< of a point's number
    std::uint32_t place_and_point;  ///< the node's place in the point's stencil, and the point's number
    Number weight;

    FIRN_HOST_DEVICE static PointOfNode of(int place, std::size_t point, Number weight)
    {
        return {(static_cast<std::uint32_t>(place) << bits) | static_cast<std::uint32_t>(point), weight};
    }
    FIRN_HOST_DEVICE int place() const { return static_cast<int>(place_and_point >> bits); }
    FIRN_HOST_DEVICE std::uint32_t point() const
    {
        return place_and_point & ((std::uint32_t(1) << bits) - 1);
    }
};

/// Where the points of a node lie in the list of those of all nodes.
struct PointsOfNode
{
    std::uint32_t begin, count;
};

/// What an index of the grid has: the number of its node among those that points reach, and how many points
/// these are; 0 if none does.
struct ReachedIndex
{
    std::uint32_t number, count;
};

/// A node that points reach.
template <class Number, int d>
struct NodeAtSurface
{
    VectorAndNumber<Number, d> free; ///< its velocity without contact [m/s], and 0
    Coordinates<d> place;
    std::uint32_t node; ///< 1 + its index, or 0 if the grid does not have it any more
    PointsOfNode points;
    Number inverse_mass; ///< 0 if its mass is too small for a velocity
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
            if (point.is(now)) return &point;
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
        return static_cast<std::uint32_t>(
            mixed<d>((std::uint64_t(2 * point.behind + point.is_deep) << 32) + point.obstacle, point.node) >>
            16);
    }
};

/// The candidates of the steps before while obstacles are at rest, and a hash table by which they are found.
template <int d>
struct KnownCandidates
{
    SurfaceCandidate<d> const* candidates;
    std::uint32_t* table; ///< the numbers of candidates from 1 on; 0: nothing is there
    std::uint32_t mask;   ///< the table's size, a power of two, less one; 0: there is none
    std::uint32_t count;

    static constexpr std::uint32_t absent = ~std::uint32_t(0);

    /// The number of a candidate, or absent.
    FIRN_HOST_DEVICE std::uint32_t find(SurfaceCandidate<d> const& candidate) const
    {
        if (mask == 0) return absent;
        for (std::uint32_t at = hash(candidate) & mask; table[at] != 0; at = (at + 1) & mask) {
            SurfaceCandidate<d> const& known = candidates[table[at] - 1];
            bool same = known.obstacle == candidate.obstacle;
            for (int a = 0; a < d; ++a) same = same && known.node[a] == candidate.node[a];
            if (same) return table[at] - 1;
        }
        return absent;
    }
    /// Enters the candidate with this number beyond those that are known.
    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const number = count + static_cast<std::uint32_t>(i);
        std::uint32_t at = hash(candidates[number]) & mask;
        while (!claim(table[at], number + 1)) at = (at + 1) & mask;
    }

private:
    FIRN_HOST_DEVICE static std::uint32_t hash(SurfaceCandidate<d> const& candidate)
    {
        return static_cast<std::uint32_t>(mixed<d>(candidate.obstacle, candidate.node) >> 16);
    }
};

/// How many there are beyond those that are known, and those beyond the room included; and how many nodes
/// points reach.
struct SurfaceCounts
{
    std::uint32_t candidates, points, reached;
};

/// The points of a step and the nodes that they reach, as loops see them.
template <class Number, int d>
struct SurfacePoints
{
    /// Stencils lie in tiles of so many points: first the first node of each of these, then the second one.
    static constexpr std::size_t tile = 32;

    std::uint32_t *new_candidates, *new_points; ///< see SurfaceCounts
    std::uint32_t* reached_nodes;
    std::uint32_t* listed;  ///< how many pairs of a node and a point there are
    std::uint32_t* changes; ///< how often nodes got new points in this step
    KnownCandidates<d> known;
    SurfaceCandidate<d>* candidates;
    std::uint32_t* seen; ///< by candidate: the last step in which it was one
    std::uint32_t step;  ///< this one
    std::uint32_t known_points;
    SurfacePoint<Number, d>* points;
    std::uint32_t candidates_room, points_room;
    VectorAndNumber<Number, d>* tried;    ///< by point: the impulse from which the next sweep starts, and 1
    NodeOfPoint<Number>* stencils;        ///< with all nodes
    NodeOfPoint<Number>* acting;          ///< with those that have mass, and less weight if that is light
    std::uint32_t* ranks;                 ///< of each of these: the point's number among those of the node
    PointOfNode<Number>* points_of_nodes; ///< the points of each node, one behind the other
    NodeAtSurface<Number, d>* reached;    ///< the nodes that points reach
    ReachedIndex* indices;                ///< by index
    /// By 1 + number: velocities with the impulses of the last sweep [m/s]; and masses, 0 if they are too
    /// small for a velocity, or in sweeps the sum of the points' weights over them. All is 0 for the first.
    VectorAndNumber<Number, d>* velocities;
    PointsBefore<Number, d> before;
};

} // namespace firn
