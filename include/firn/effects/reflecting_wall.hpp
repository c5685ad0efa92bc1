// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>

#include <array>
#include <cstddef>
#include <limits>
#include <type_traits>

namespace firn
{

/// A smooth wall on a plane of nodes that mirrors everything on its side, as if the body continued behind it
/// and moved the other way.
///
/// An Obstacle stops the nodes behind its surface, which leaves an error of the order of h; here the error is
/// of the order of h², like that of the kernels themselves. In return the wall lies on nodes, does not move,
/// has no friction, and never lets go. Its reaction is reported like an obstacle's, with the angular impulse
/// about the world's origin.
///
/// All particles must be on its side: a call with particles behind a wall is refused. Schemes that move
/// particles with the grid keep them there. If an obstacle or a shell acts on particles, so does the wall:
/// see ParticleContact. Otherwise particles of Asflip may swing beyond it by a small part of a cell.
struct ReflectingWall
{
    int axis = 1; ///< its normal is along this axis: 0, 1 or 2
    int node = 0; ///< it is at lattice.origin[axis] + node * cell_size
    int side = 1; ///< where the particles are: 1 towards larger coordinates, -1 towards smaller ones

    void validate() const
    {
        require(axis >= 0 && axis <= 2, "the axis of a wall is none of x, y and z", "ReflectingWall",
                "Pass 0, 1 or 2.");
        require(side == 1 || side == -1, "a wall has no such side", "ReflectingWall",
                "Pass 1 if the particles are where coordinates are larger, else -1.");
        constexpr int largest = 1 << 30; // beyond any cell
        require(node > -largest && node < largest, "a wall is out of the range of nodes", "ReflectingWall",
                "Pass (position - origin) / cell_size.");
    }

    void validate_in_plane() const
    {
        require(axis < 2, "a wall of a scene in two dimensions is across z", "ReflectingWall",
                "Pass 0 or 1.");
    }

    friend bool operator==(ReflectingWall const&, ReflectingWall const&) = default;

    /// A plain value, the same in every step: see UpdateGrid.
    struct Action
    {
        static constexpr bool mirrors = true;
        int axis, node, side;

        /// Contact of lanes of particles with velocity v, at a place to which an obstacle pushed them: those
        /// behind the wall come back before it.
        template <Lane Real, int d>
        FIRN_HOST_DEVICE ContactResult<Real, d> hold(LanePosition<Real, d> const& place,
                                                     Vector<Real, d> const&, Vector<Real, d> const& v,
                                                     Contact const& rule) const
        {
            ContactResult<Real, d> touched;
            touched.arm = place.relative_to(reference());
            touched.depth = max(overlap<Real, d>(place, v), Real(0));
            touched.inside = touched.depth > Real(0);
            touched.surface = zeros<Vector<Real, d>>();
            for (int a = 0; a < d; ++a) touched.normal[a] = Real(ScalarOf<Real>(a == axis ? side : 0));
            Vector<Real, d> const after = rule.after<Real, d>(v, touched.normal);
            for (int a = 0; a < d; ++a) touched.velocity[a] = select(touched.inside, after[a], v[a]);
            return touched;
        }

        /// How far [m] lanes of particles are behind the wall, plus a margin for the next rounding.
        template <Lane Real, int d>
        FIRN_HOST_DEVICE Real overlap(LanePosition<Real, d> const& place, Vector<Real, d> const&) const
        {
            using Number = ScalarOf<Real>;
            Real before(0); // [cells]
            for (int a = 0; a < d; ++a)
                if (a == axis)
                    before = (Real(Number(place.first[a] - node)) + place.offset[a]) * Real(Number(side));
            return Real(lost_beyond<Number>(place.lattice)) - before * Real(Number(place.lattice.cell_size));
        }

        template <class Number>
        FIRN_HOST_DEVICE Number lost_beyond(Lattice const& lattice) const
        {
            return Number(256 * std::numeric_limits<Number>::epsilon() * lattice.cell_size);
        }

        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> carried(LanePosition<Real, d> const&, Vector<Real, d> const&,
                                                 Real) const
        {
            return zeros<Vector<Real, d>>();
        }

        FIRN_HOST_DEVICE static Eigen::Vector3d reference() { return {0, 0, 0}; }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action over(Interval const&) const
    {
        return {axis, node, side};
    }
};

/// Whether a position [m] is behind a wall by more than `spared` cells.
struct BehindWall
{
    int axis, side;
    double farthest; ///< coordinate along the axis times the side [m]

    BehindWall(ReflectingWall const& wall, Lattice const& lattice, double spared)
        : axis(wall.axis), side(wall.side),
          farthest(wall.side * (lattice.origin[wall.axis] + wall.node * lattice.cell_size) -
                   spared * lattice.cell_size)
    {}

    template <int d>
    FIRN_HOST_DEVICE bool operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        return x[axis] * side < farthest;
    }
};

/// Whether a position [m] is behind at least one of several walls.
template <std::size_t walls>
struct BehindAnyWall
{
    std::array<BehindWall, walls> of;

    template <int d>
    FIRN_HOST_DEVICE bool operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        bool behind = false;
        for (BehindWall const& wall : of) behind = behind || wall(x);
        return behind;
    }
};

namespace detail
{
/// Whether no node is next to both walls, unless it lies between them.
inline bool apart(ReflectingWall const& a, ReflectingWall const& b)
{
    if (a.axis != b.axis) return true;
    ReflectingWall const &low = a.node < b.node ? a : b, &high = a.node < b.node ? b : a;
    return high.node - low.node >= (low.side == 1 && high.side == -1 ? 2 : 3);
}

template <class First, class Second>
void require_apart(First const& a, Second const& b)
{
    if constexpr (std::is_same_v<First, ReflectingWall> && std::is_same_v<Second, ReflectingWall>)
        require(apart(a, b), "two walls are too close to each other", "ReflectingWall",
                "Leave two cells between them, or three if nothing is between them.");
}
} // namespace detail

/// Throws an Error if two of the effects are walls that share nodes.
inline void require_walls_apart() {}

/// Throws an Error if two of the effects are walls that share nodes.
template <class First, class... Rest>
void require_walls_apart(First const& first, Rest const&... rest)
{
    (detail::require_apart(first, rest), ...);
    require_walls_apart(rest...);
}

} // namespace firn
