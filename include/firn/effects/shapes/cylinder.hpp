// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/shapes/solids.hpp>

#include <algorithm>
#include <cmath>

namespace firn
{

/// A cylinder with flat ends around the body's y axis, centred on the reference point: a core of rock, a
/// pile, a column. In two dimensions it is a rectangle.
struct Cylinder
{
    double radius;      ///< [m]
    double half_length; ///< [m]

    void validate() const
    {
        detail::require_length(radius, "Cylinder");
        detail::require_length(half_length, "Cylinder");
    }
    /// Distance of its farthest point from the reference point [m].
    double reach() const { return std::sqrt(radius * radius + half_length * half_length); }
    /// Along a unit vector in the body's frame: see AlongAxis.
    AlongAxis along(Eigen::Vector3d const& axis) const
    {
        double const a = std::abs(axis.y());
        return {half_length * a + radius * std::sqrt(std::max(1 - a * a, 0.0)),
                detail::is_along_or_across(a)};
    }

    /// Outside, the distance to the closest point; inside, the negative distance to the closest of mantle and
    /// ends.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        using Number = ScalarOf<Real>;
        Real const zero(Number(0)), one(Number(1));
        Vector<Real, d> across = x;
        across[1] = zero;
        Real const r2 = across.dot(across);
        Mask<Real> const off_axis = r2 > zero;
        Real const r = sqrt(r2), inverse = one / select(off_axis, r, one);
        Real const side = select(x[1] < zero, -one, one);
        Real const beyond_mantle = r - Real(static_cast<Number>(radius)),
                   beyond_end = abs(x[1]) - Real(static_cast<Number>(half_length));
        Real const out = max(beyond_mantle, zero), up = max(beyond_end, zero);
        Real const outside = sqrt(out * out + up * up);
        Mask<Real> const is_outside = outside > zero, is_mantle = beyond_mantle > beyond_end;
        Real const to_unit = one / select(is_outside, outside, one);
        Real const radial = select(is_outside, out * to_unit, select(is_mantle, one, zero)),
                   axial = select(is_outside, up * to_unit, select(is_mantle, zero, one));
        SurfaceSample<Real, d> sample;
        sample.distance = select(is_outside, outside, max(beyond_mantle, beyond_end));
        for (int a = 0; a < d; ++a) {
            Real const on_axis = a == 0 ? one : zero; // any direction will do
            sample.normal[a] =
                a == 1 ? axial * side : radial * select(off_axis, across[a] * inverse, on_axis);
        }
        return sample;
    }
};

} // namespace firn
