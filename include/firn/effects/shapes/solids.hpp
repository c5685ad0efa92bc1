// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/shapes/shape.hpp>

namespace firn
{

namespace detail
{
/// The ball of `radius` around a centre, at `away` = x - centre; the normal at the centre itself is the last
/// axis.
template <Lane Real, int d>
FIRN_HOST_DEVICE SurfaceSample<Real, d> around_point(Vector<Real, d> const& away, ScalarOf<Real> radius)
{
    Real const length2 = away.dot(away);
    Mask<Real> const off_centre = length2 > Real(0);
    Real const length = sqrt(length2), inverse = Real(1) / select(off_centre, length, Real(1));
    SurfaceSample<Real, d> sample{length - Real(radius), away * inverse};
    sample.normal[d - 1] = select(off_centre, sample.normal[d - 1], Real(1));
    return sample;
}

/// Whether a component of a unit vector says that it lies along that axis, or across it.
inline bool is_along(double component) { return std::abs(component) > 1 - 1e-12; }
inline bool is_along_or_across(double component) { return is_along(component) || std::abs(component) < 1e-6; }

inline void require_length(double length, char const* where)
{
    require(is_finite(length) && length > 0, "a radius or extent is not a finite number above 0", where,
            "Pass lengths in metres, above 0.");
    require(length <= largest_length, "a radius or extent is out of range", where,
            "Pass metres; a plane is a HalfSpace.");
}
} // namespace detail

/// A ball around the reference point (a disk in two dimensions).
struct Sphere
{
    double radius = 1; ///< [m]

    void validate() const { detail::require_length(radius, "Sphere"); }
    double reach() const { return radius; } ///< distance of its farthest point from the reference point [m]
    /// Along a unit vector: see AlongAxis.
    AlongAxis along(Eigen::Vector3d const&) const { return {radius, true}; }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        return detail::around_point<Real, d>(x, static_cast<ScalarOf<Real>>(radius));
    }
};

/// All points within `radius` of a segment of half length `half_length` along the body's y axis.
struct Capsule
{
    double radius;      ///< [m]
    double half_length; ///< [m]

    void validate() const
    {
        detail::require_length(radius, "Capsule");
        require(is_between(0, half_length, largest_length),
                "the half length of a capsule is below 0 or out of range", "Capsule",
                "Pass a length in metres.");
    }
    double reach() const
    {
        return radius + half_length;
    } ///< distance of its farthest point from the reference point [m]
    /// Along a unit vector in the body's frame: see AlongAxis.
    AlongAxis along(Eigen::Vector3d const& axis) const
    {
        return {radius + half_length * std::abs(axis.y()), detail::is_along_or_across(axis.y())};
    }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        Real const half(static_cast<ScalarOf<Real>>(half_length));
        Vector<Real, d> away = x;
        away[1] = away[1] - min(max(x[1], -half), half);
        return detail::around_point<Real, d>(away, static_cast<ScalarOf<Real>>(radius));
    }
};

/// A box centred on the reference point, aligned with the body's axes.
struct Box
{
    Eigen::Vector3d half_extents; ///< [m]

    void validate() const
    {
        for (int a = 0; a < 3; ++a) detail::require_length(half_extents[a], "Box");
    }
    /// Distance of its farthest point from the reference point [m]; in two dimensions z does not count.
    double reach(int dimension = 3) const
    {
        double square = 0;
        for (int a = 0; a < dimension; ++a) square += half_extents[a] * half_extents[a];
        return std::sqrt(square);
    }
    /// Along a unit vector in the body's frame: see AlongAxis.
    AlongAxis along(Eigen::Vector3d const& axis) const
    {
        double reach = 0;
        for (int a = 0; a < 3; ++a) reach += std::abs(axis[a]) * half_extents[a];
        return {reach,
                detail::is_along(axis.x()) || detail::is_along(axis.y()) || detail::is_along(axis.z())};
    }

    /// Outside, the distance to the closest point of the box; inside, the negative distance to the closest
    /// face.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        Real const zero(0), one(1);
        Vector<Real, d> side, beyond, out;
        Real inside(-std::numeric_limits<ScalarOf<Real>>::max());
        for (int a = 0; a < d; ++a) {
            side[a] = select(x[a] < zero, -one, one);
            beyond[a] = abs(x[a]) - Real(static_cast<ScalarOf<Real>>(half_extents[a]));
            out[a] = max(beyond[a], zero);
            inside = max(inside, beyond[a]);
        }
        Real const distance = sqrt(out.dot(out));
        Mask<Real> const is_outside = distance > zero;
        Real const inverse = one / select(is_outside, distance, one);
        SurfaceSample<Real, d> sample;
        sample.distance = select(is_outside, distance, inside);
        Mask<Real> found = is_outside;
        for (int a = 0; a < d; ++a) {
            Mask<Real> const closest =
                (!found) & exactly_equal(beyond[a], inside); // the first of equally close faces
            sample.normal[a] = select(is_outside, out[a] * inverse, select(closest, one, zero)) * side[a];
            found = found | closest;
        }
        return sample;
    }
};

} // namespace firn
