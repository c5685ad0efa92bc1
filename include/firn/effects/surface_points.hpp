// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/four.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/known_surface_points.hpp>

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
struct alignas(2 * sizeof(Number)) NodeOfPoint
{
    static constexpr std::uint32_t none = 0; ///< the first of all nodes, on which there is nothing
    /// 1 + its number among those that points reach; or none; or until it has been numbered index_of(its
    /// index), see Grid::nodes_by_index().
    std::uint32_t node;
    Number weight;

    FIRN_HOST_DEVICE static std::uint32_t index_of(std::uint32_t index) { return ~index; }
    FIRN_HOST_DEVICE bool has_index() const { return node >> 31 != 0; }
    FIRN_HOST_DEVICE std::uint32_t index() const { return ~node; }
};

/// A point that reaches a node.
template <class Number>
struct alignas(2 * sizeof(Number)) PointOfNode
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
    bool has_new_points; ///< in this step, so that they are to be put in order
};

/// What lanes of places are to an obstacle.
template <class Real, int d>
struct SurfaceAt
{
    Vector<Real, d> arm;    ///< from its reference point [m]
    Real distance;          ///< from its surface [m], negative inside
    Vector<Real, d> normal; ///< outward, in world axes
};

/// How many there are beyond those that are known, and those beyond the room included; and how many nodes
/// points reach.
struct SurfaceCounts
{
    std::uint32_t candidates, points, reached;
};

/// What a node notes of the candidates that it is, for later steps: it is one for two obstacles at most.
struct CandidatesOfNode
{
    /// 0 if nothing is noted; else by obstacle 1 for none, or 2 + the number of the candidate.
    std::uint32_t noted[2];
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
    bool are_at_rest;    ///< obstacles: points are where they were while they have a candidate
    std::uint32_t known_points;
    SurfacePoint<Number, d>* points;
    std::uint32_t candidates_room, points_room;
    unsigned char* to_list;               ///< by point: whether it is to be listed, see ListPoints
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
    KnownPoints<Number, d> kept;   ///< those of the steps before that may have moved in their cells
    KnownPoints<Number, d> before; ///< those of the step before, if all have been found anew
    CandidatesOfNode* of_nodes;    ///< by a node's index, where obstacles are at rest, else null
};

} // namespace firn
