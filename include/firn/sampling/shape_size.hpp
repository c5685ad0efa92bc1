// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/effects/shapes/cylinder.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/effects/shapes/solids.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numbers>

// How large a shape is: what samplers ask for beside its surface.
namespace firn::detail
{

/// The box around a shape in its frame [m], and its volume [m^3], in the plane its area [m^2].
struct ShapeSize
{
    Eigen::AlignedBox3d box;
    double volume;
};

inline Eigen::AlignedBox3d centred_box(Eigen::Vector3d const& half) { return {-half, half}; }

inline ShapeSize size_of_shape(Box const& box, int d)
{
    Eigen::Vector3d const& half = box.half_extents;
    return {centred_box(half), 4 * half.x() * half.y() * (d == 3 ? 2 * half.z() : 1)};
}
inline ShapeSize size_of_shape(Sphere const& ball, int d)
{
    double const r = ball.radius;
    return {centred_box({r, r, r}), std::numbers::pi * r * r * (d == 3 ? 4.0 / 3 * r : 1)};
}
inline ShapeSize size_of_shape(Cylinder const& cylinder, int d)
{
    double const r = cylinder.radius, half = cylinder.half_length;
    return {centred_box({r, half, r}), 2 * half * (d == 3 ? std::numbers::pi * r * r : 2 * r)};
}
inline ShapeSize size_of_shape(Capsule const& capsule, int d)
{
    double const r = capsule.radius, half = capsule.half_length;
    ShapeSize size = size_of_shape(Sphere{r}, d);
    size.volume += 2 * half * (d == 3 ? std::numbers::pi * r * r : 2 * r);
    size.box = centred_box({r, half + r, r});
    return size;
}

/// Calls `use(centre)` for each of so many cells per axis in a box.
template <int d, class Use>
void for_each_middle(Eigen::AlignedBox3d const& box, int cells, Use const& use)
{
    Vector<double, d> const low = box.min().template head<d>(),
                            size = box.sizes().template head<d>() / double(cells);
    for (int k = 0; k < (d == 3 ? cells : 1); ++k)
        for (int j = 0; j < cells; ++j)
            for (int i = 0; i < cells; ++i) {
                int const index[]{i, j, k};
                Vector<double, d> x;
                for (int a = 0; a < d; ++a) x[a] = low[a] + (index[a] + 0.5) * size[a];
                use(x);
            }
}

/// Of any other shape both are measured by its signed distance: the box is up to a 32nd of the reach too
/// wide, and the volume is that of cells of which the surface cuts a part off.
template <int d, class ShapeType>
ShapeSize measured_size(ShapeType const& shape)
{
    double const reach = reach_of(shape, d);
    auto const plain = detail::plain(shape);
    require(reach > 0 && reach <= largest_length, "the shape to be filled has no end, or is out of range",
            "fill", "Fill a shape with a reach() in metres; a layer of ground is a Box.");
    Eigen::AlignedBox3d const everywhere = centred_box(Eigen::Vector3d::Constant(reach));
    constexpr int coarse = 64, fine = d == 3 ? 128 : 1024;
    double const half_cell = reach / coarse;
    Eigen::AlignedBox3d box;
    for_each_middle<d>(everywhere, coarse, [&](Vector<double, d> const& x) {
        if (distance_from<d>(plain, x) > std::sqrt(double(d)) * half_cell) return;
        Eigen::Vector3d centre = Eigen::Vector3d::Zero();
        centre.template head<d>() = x;
        Eigen::Vector3d const half = Eigen::Vector3d::Constant(half_cell);
        box.extend(centre - half);
        box.extend(centre + half);
    });
    require(!box.isEmpty(), "there is nothing inside the shape to be filled", "fill",
            "Pass a shape whose signed distance is negative inside.");
    Vector<double, d> const cell = box.sizes().template head<d>() / double(fine);
    double cells = 0;
    for_each_middle<d>(box, fine, [&](Vector<double, d> const& x) {
        cells += std::clamp(0.5 - distance_from<d>(plain, x) / cell.mean(), 0.0, 1.0);
    });
    return {box, cells * cell.prod()};
}

template <int d, class ShapeType>
ShapeSize size_of(ShapeType const& shape)
{
    if constexpr (requires { size_of_shape(shape, d); })
        return size_of_shape(shape, d);
    else
        return measured_size<d>(shape);
}

} // namespace firn::detail
