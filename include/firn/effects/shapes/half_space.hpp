// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/math/product.hpp>

#include <cmath>
#include <limits>

namespace firn
{

/// All points below the plane through the reference point: a floor, a wall or a slope.
struct HalfSpace
{
    Eigen::Vector3d normal{0, 1, 0}; ///< outward unit vector in the body's frame

    void validate() const
    {
        require(all_finite(normal) && std::abs(norm(normal) - 1) < 1e-6,
                "the normal of a half-space is not a unit vector", "HalfSpace",
                "Pass e.g. normal.normalized().");
    }

    void validate_in_plane() const
    {
        require(std::abs(normal.z()) < 1e-6,
                "the normal of a half-space leaves the plane of a scene in two dimensions", "HalfSpace",
                "Pass a normal with z = 0.");
    }

    /// The normal of a plane that it lies below: see detail::upper_side_of.
    Eigen::Vector3d upper_side() const { return normal; }

    /// Along a unit vector in the body's frame: see AlongAxis. Where it is the same everywhere along the axis
    /// it has no end that could reach too far.
    AlongAxis along(Eigen::Vector3d const& axis) const
    {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        bool const is_same = std::abs(normal.dot(axis)) < 1e-6;
        return {is_same ? -infinity : infinity, is_same};
    }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        SurfaceSample<Real, d> sample;
        for (int a = 0; a < d; ++a) sample.normal[a] = Real(static_cast<ScalarOf<Real>>(normal[a]));
        sample.distance = dot<Real, d>(x, sample.normal);
        return sample;
    }
};

} // namespace firn
