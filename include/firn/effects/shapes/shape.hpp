// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <concepts>
#include <cstddef>
#include <utility>

namespace firn
{

/// The largest length of a shape [m]: its square is finite in single precision, too.
inline constexpr double largest_length = 1e15;

/// Where a point is relative to a surface.
template <class Real, int d>
struct SurfaceSample
{
    Real distance;          ///< signed distance [m], negative inside
    Vector<Real, d> normal; ///< outward unit normal of the closest surface
};

/// A solid in its own frame: answers the signed distance and outward normal at a point [m].
template <class T, class Real, int d>
concept Shape = requires(T const shape, Vector<Real, d> const x)
{
    {
        shape.surface(x)
        } -> std::same_as<SurfaceSample<Real, d>>;
};

/// A solid that loops may ask for its surface at lanes of points, in packs or one by one: see surface_of.
template <class T, class Real, int d>
concept HasSurface = Shape<T, Real, d> || Shape<T, ScalarOf<Real>, d>;

/// How a solid lies along an axis through its reference point.
struct AlongAxis
{
    double reach;     ///< of its farthest point along the axis [m]; infinite if it is unbounded there
    bool is_mirrored; ///< it is convex, and its own image in the plane across the axis
};

namespace detail
{
/// A shape as a plain value: its view, if it has one.
template <class ShapeType>
auto plain(ShapeType const& shape)
{
    if constexpr (requires { shape.view(); })
        return shape.view();
    else
        return shape;
}

template <class ShapeType>
using Plain = decltype(plain(std::declval<ShapeType const&>()));

/// Whether a shape is a plain value as it is.
template <class ShapeType>
inline constexpr bool is_plain = std::same_as<Plain<ShapeType>, ShapeType>;

/// How far [m] from the reference point a shape reaches in a scene of `dimension` dimensions; 0 if it is
/// unbounded.
template <class ShapeType>
double reach_of(ShapeType const& shape, int dimension)
{
    if constexpr (requires { shape.reach(dimension); })
        return shape.reach(dimension);
    else if constexpr (requires { shape.reach(); })
        return shape.reach();
    else
        return 0;
}

/// The outward normal, in the body's frame, of the plane through the reference point that all of an unbounded
/// shape lies below; zero if there is none.
template <class ShapeType>
Eigen::Vector3d upper_side_of(ShapeType const& shape)
{
    if constexpr (requires { shape.upper_side(); })
        return shape.upper_side();
    else
        return Eigen::Vector3d(0, 0, 0);
}
} // namespace detail

/// Whether a shape is a shell, which keeps particles on the side where they are.
template <class ShapeType>
inline constexpr bool is_two_sided = requires
{
    requires ShapeType::is_two_sided;
};

/// Whether a shape's values lie in memory of the host: see SignedDistanceGrid::on.
template <class ShapeType>
inline constexpr bool lies_on_host = requires
{
    requires ShapeType::in_host_memory;
};

/// Whether a shape says that it reads its surface from samples in memory, which costs a device many
/// registers.
template <class ShapeType>
inline constexpr bool is_sampled = requires
{
    requires ShapeType::is_sampled;
};

/// Whether a shape changes its form with time, and has a velocity of its own: see DeformingGrid.
template <class ShapeType>
inline constexpr bool is_deforming = requires
{
    requires ShapeType::is_deforming;
};

/// A plain shape as it is at the end of a step.
template <class ShapeType, class Step>
FIRN_HOST_DEVICE ShapeType shape_over(ShapeType const& shape, [[maybe_unused]] Step const& step)
{
    if constexpr (is_deforming<ShapeType>)
        return shape.over(step);
    else
        return shape;
}

/// The velocity that a shape's surface has of its own beside lanes of points, in the shape's frame [m/s].
template <Lane Real, int d, class ShapeType>
FIRN_HOST_DEVICE Vector<Real, d> velocity_of(ShapeType const& shape, Vector<Real, d> const& x)
{
    constexpr int width = lane_width<Real>;
    ScalarOf<Real> at[std::size_t(d)][std::size_t(width)], own[std::size_t(d)][std::size_t(width)];
    for (int a = 0; a < d; ++a) LaneTraits<Real>::store(x[a], at[a]);
    for (int lane = 0; lane < width; ++lane) {
        Vector<ScalarOf<Real>, d> point;
        for (int a = 0; a < d; ++a) point[a] = at[a][lane];
        auto const velocity = shape.velocity(point);
        for (int a = 0; a < d; ++a) own[a][lane] = velocity[a];
    }
    Vector<Real, d> velocity;
    for (int a = 0; a < d; ++a) velocity[a] = LaneTraits<Real>::load(own[a]);
    return velocity;
}

/// The surface of a shape at lanes of points; a shape that accepts numbers only is evaluated lane by lane.
template <Lane Real, int d, class ShapeType>
FIRN_HOST_DEVICE SurfaceSample<Real, d> surface_of(ShapeType const& shape, Vector<Real, d> const& x)
{
    if constexpr (Shape<ShapeType, Real, d>)
        return shape.surface(x);
    else {
        static_assert(HasSurface<ShapeType, Real, d>,
                      "a shape lacks 'template <firn::Lane Real, int d> firn::SurfaceSample<Real, d> "
                      "surface(firn::Vector<Real, d> const&) const'");
        constexpr int width = lane_width<Real>;
        ScalarOf<Real> at[std::size_t(d)][std::size_t(width)], distance[std::size_t(width)],
            normal[std::size_t(d)][std::size_t(width)];
        for (int a = 0; a < d; ++a) LaneTraits<Real>::store(x[a], at[a]);
        for (int lane = 0; lane < width; ++lane) {
            Vector<ScalarOf<Real>, d> point;
            for (int a = 0; a < d; ++a) point[a] = at[a][lane];
            auto const sample = shape.surface(point);
            distance[lane] = sample.distance;
            for (int a = 0; a < d; ++a) normal[a][lane] = sample.normal[a];
        }
        SurfaceSample<Real, d> sample;
        sample.distance = LaneTraits<Real>::load(distance);
        for (int a = 0; a < d; ++a) sample.normal[a] = LaneTraits<Real>::load(normal[a]);
        return sample;
    }
}

namespace detail
{
/// The signed distance of a point from the surface of a plain shape [m]. Samples in single precision are
/// asked in it.
template <int d, class ShapeType>
FIRN_HOST_DEVICE double distance_from(ShapeType const& shape, Vector<double, d> const& x)
{
    if constexpr (Shape<ShapeType, double, d>)
        return shape.surface(x).distance;
    else {
        static_assert(
            Shape<ShapeType, float, d>,
            "a region's shape lacks 'template <firn::Lane Real, int d> firn::SurfaceSample<Real, d> "
            "surface(firn::Vector<Real, d> const&) const' in the scene's dimensions");
        return double(shape.surface(Vector<float, d>(x.template cast<float>())).distance);
    }
}
} // namespace detail

} // namespace firn
