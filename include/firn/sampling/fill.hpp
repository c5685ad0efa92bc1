// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/serial.hpp>
#include <firn/effects/motion.hpp>
#include <firn/sampling/points.hpp>
#include <firn/sampling/poisson_disk_points.hpp>
#include <firn/sampling/polygon.hpp>
#include <firn/sampling/shape_size.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cstdint>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// How points lie in what they fill.
enum class Pattern
{
    lattice,     ///< on a cubic lattice along the shape's own axes
    jittered,    ///< on such a lattice, each moved at random within a part of its cell: see Filling::jitter
    poisson_disk ///< at random, none closer to another than 0.84 spacings, in the plane 0.81
};

/// How a shape is filled with points, and where it is.
struct Filling
{
    /// Between neighbours [m]: a point stands for about spacing^3, in the plane spacing^2. Half a cell suits
    /// most scenes.
    double spacing = 0;
    Pattern pattern = Pattern::lattice;
    Motion pose{};          ///< position and orientation of the shape; nothing else of it counts
    double jitter = 0.5;    ///< of Pattern::jittered: the share of its cell in which a point may lie
    std::uint64_t seed = 0; ///< the same seed gives the same points everywhere
};

/// Points inside a shape in d dimensions, and the share of its volume that each stands for: go straight to
/// Solver::add.
template <int d>
struct Filled
{
    std::vector<Vector<double, d>> points; ///< [m]
    double volume_per_point = 0;           ///< [m^3], in the plane [m^2]
};

namespace detail
{

/// What samplers ask of a shape in d dimensions. In the plane it is a sheet that is too thin to matter.
template <int d, class Contains>
class FilledInterior
{
public:
    FilledInterior(Contains const& contains, ShapeSize const& size, double thickness)
        : contains_(contains), box_(size.box), volume_(size.volume)
    {
        if constexpr (d == 2) {
            volume_ *= thickness;
            box_.min().z() = -thickness / 2;
            box_.max().z() = thickness / 2;
        }
    }

    template <class Loop>
    std::vector<char> contains(std::span<Eigen::Vector3d const> points, Loop const& loop) const
    {
        std::vector<char> inside(points.size());
        loop.for_each(points.size(),
                      [&](std::size_t i) { inside[i] = contains_(vector_of<double, d>(points[i])) ? 1 : 0; });
        return inside;
    }
    double volume() const { return volume_; }
    Eigen::AlignedBox3d bounding_box() const { return box_; }

private:
    Contains const& contains_;
    Eigen::AlignedBox3d box_;
    double volume_;
};

/// In d dimensions.
template <int d, Interior Solid, class Loop>
PointSample sampled(Solid const& solid, Filling const& how, Loop const& loop)
{
    switch (how.pattern) {
    case Pattern::lattice:
        return lattice_points(solid, Spacing{how.spacing}, 0, how.seed, loop);
    case Pattern::jittered:
        return lattice_points(solid, Spacing{how.spacing}, how.jitter, how.seed, loop);
    case Pattern::poisson_disk:
        break;
    }
    constexpr double radius = d == 2 ? 0.81 : 0.84; // of so dense a sample, in spacings
    return poisson_disk_points(solid, Radius{radius * how.spacing}, how.seed, loop);
}

template <int d>
Filled<d> moved_to_pose(PointSample const& sample, double thickness, Motion const& pose)
{
    Filled<d> filled{{}, sample.volume_per_point / (d == 2 ? thickness : 1)};
    filled.points.reserve(sample.points.size());
    Matrix<double, d> const turn = matrix_of<double, d>(pose.rotation());
    Vector<double, d> const position = vector_of<double, d>(pose.position);
    for (Eigen::Vector3d const& x : sample.points)
        filled.points.push_back(position + turn * vector_of<double, d>(x));
    return filled;
}

template <int d>
void validate_filling(Filling const& how)
{
    static_assert(d == 2 || d == 3, "there are scenes in 2 and in 3 dimensions");
    require(is_between(1e-15, how.spacing, largest_length),
            "the spacing is not a number of metres above 1e-15", "fill", "Pass metres, e.g. half a cell.");
    check_jitter(how.jitter);
    how.pose.validate("fill");
    if constexpr (d == 2) how.pose.validate_in_plane("fill");
}

template <int d, class Contains, class Loop>
Filled<d> fill_region(Contains const& contains, ShapeSize const& size, Filling const& how, Loop const& loop)
{
    double const thickness = 1e-9 * how.spacing; // beside which a distance in the plane is not changed
    return moved_to_pose<d>(sampled<d>(FilledInterior<d, Contains>(contains, size, thickness), how, loop),
                            thickness, how.pose);
}

} // namespace detail

/// Fills a shape with points, in the plane (d = 2) or in space (d = 3): any shape of an Obstacle that has an
/// end, a Polygon in the plane, or an Interior such as MeshInterior in space.
///
///     auto const ball = firn::fill<3>(firn::Sphere{0.1}, {.spacing = 0.005});
///     solver.add(ball.points, ball.volume_per_point);
///
/// The volumes add up to that of the shape: of Box, Sphere, Capsule, Cylinder, Polygon and a mesh to
/// rounding, and of other shapes, whose volume is measured by their signed distance, to about a thousandth.
/// The last argument is a backend whose threads share the work; points do not depend on it. Throws an Error
/// if the spacing or the pose makes no sense, the shape is invalid or has no end, or no point is inside.
template <int d, class ShapeType, class Loop = Serial>
Filled<d> fill(ShapeType const& shape, Filling const& how, Loop const& loop = {})
{
    detail::validate_filling<d>(how);
    if constexpr (std::is_same_v<ShapeType, Polygon>) {
        static_assert(d == 2, "a polygon lies in the plane");
        detail::ShapeSize size{{}, shape.area()};
        for (auto const& corner : {shape.bounding_box().min(), shape.bounding_box().max()})
            size.box.extend(in_space<2>(corner));
        return detail::fill_region<d>([&](Vector<double, d> const& x) { return shape.contains(x); }, size,
                                      how, loop);
    }
    else if constexpr (Interior<ShapeType>) {
        static_assert(d == 3, "a mesh has its inside in space");
        return detail::moved_to_pose<d>(detail::sampled<d>(shape, how, loop), 1, how.pose);
    }
    else {
        static_assert(!is_two_sided<ShapeType>, "a shell has no inside");
        static_assert(!is_deforming<ShapeType>,
                      "a shape that changes its form is an obstacle, and makes no region");
        if constexpr (requires { shape.validate(); }) shape.validate();
        if constexpr (d == 2 && requires { shape.validate_in_plane(); }) shape.validate_in_plane();
        auto const plain = detail::plain(shape);
        return detail::fill_region<d>(
            [&](Vector<double, d> const& x) { return detail::distance_from<d>(plain, x) < 0; },
            detail::size_of<d>(shape), how, loop);
    }
}

} // namespace firn
