// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/contact.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>

#include <cstddef>
#include <cstdint>

// Points of obstacles' surfaces, see surface_points.hpp, and how those of the steps before are found.
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
    std::uint32_t found;     ///< the last step in which it was
    std::uint32_t gone;      ///< the step in which it came into another cell, as another point; or 0
    /// 0, or three times the obstacle into which the surface is continued plus how many steps, 1 to 3, it
    /// lies behind the point that is continued: see FindSurfacePoints.
    std::uint32_t behind;
    /// Whether it is a node inside: one so deep that no point of the surface reaches it, which goes no
    /// deeper, or any node in what sticks.
    bool is_deep;
    bool separates, sticks; ///< of the obstacle's Contact
    bool is_two_sided;      ///< of a thin shell: it pushes either way, and never lets go
    bool is_plain;          ///< whether none of its nodes is light: it has all of its weight for them
    bool is_whole;          ///< whether the grid had all of them when they were found
    Number friction;

    /// The same to the mean place of the nodes that take the impulse [m].
    Vector<Number, d> arm_of_impulse;
    Number per_light; ///< the inverse of the mass below which a node is light; 0 where it acts on none
    Number support;   ///< the sum of the weights of nodes with mass
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

/// A node at which a point of an obstacle's surface may have been found, or that lies deep inside.
template <int d>
struct SurfaceCandidate
{
    Coordinates<d> node;
    std::uint32_t obstacle;

    bool operator==(SurfaceCandidate const& other) const
    {
        return node == other.node && obstacle == other.obstacle;
    }
    bool operator<(SurfaceCandidate const& other) const
    {
        for (int a = 0; a < d; ++a)
            if (node[a] != other.node[a]) return node[a] < other.node[a];
        return obstacle < other.obstacle;
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

/// Points, and a hash table by which they are found.
template <class Number, int d>
struct KnownPoints
{
    SurfacePoint<Number, d>* points;
    std::uint32_t* table; ///< the numbers of points from 1 on; 0: nothing is there
    std::uint32_t mask;   ///< the table's size, a power of two, less one; 0: there is none
    std::uint32_t count;  ///< of those that are in the table

    /// The same point as one of this step; null if there is none.
    FIRN_HOST_DEVICE SurfacePoint<Number, d>* find(SurfacePoint<Number, d> const& now) const
    {
        if (mask == 0) return nullptr;
        for (std::uint32_t at = hash(now) & mask; table[at] != 0; at = (at + 1) & mask) {
            SurfacePoint<Number, d>& point = points[table[at] - 1];
            if (point.is(now) && (point.gone == 0 || point.gone == now.found)) return &point;
        }
        return nullptr;
    }
    /// Enters the point with this number beyond those that are there.
    FIRN_HOST_DEVICE void operator()(std::size_t i) const
    {
        auto const number = count + static_cast<std::uint32_t>(i);
        std::uint32_t at = hash(points[number]) & mask;
        while (!claim(table[at], number + 1)) at = (at + 1) & mask;
    }

private:
    FIRN_HOST_DEVICE static std::uint32_t hash(SurfacePoint<Number, d> const& point)
    {
        return static_cast<std::uint32_t>(
            mixed<d>((std::uint64_t(2 * point.behind + point.is_deep) << 32) + point.obstacle, point.node) >>
            16);
    }
};

/// The candidates of the steps before, and a hash table by which they are found.
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

} // namespace firn
