// SPDX-License-Identifier: MIT
#pragma once

// LICENCE: including this file makes your binary GPL-3, unless you hold a commercial CGAL licence. This text
// itself is under the licence named above. It takes 20 s to compile: include it from one translation unit.

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/serial.hpp>
#include <firn/effects/shapes/deforming_grid.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/sampling/distance_from_mesh.hpp>
#include <firn/sampling/mesh_interior.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{

/// The shares of a triangle's corners in a point of its plane: they add up to 1.
inline Eigen::Vector3d shares_of_corners(Eigen::Vector3d const& x, Eigen::Vector3d const& a,
                                         Eigen::Vector3d const& b, Eigen::Vector3d const& c)
{
    Eigen::Vector3d const normal = (b - a).cross(c - a);
    double const size2 = normal.squaredNorm();
    if (!(size2 > 0)) return Eigen::Vector3d::Constant(1.0 / 3);
    double const of_b = normal.dot((x - a).cross(c - a)) / size2,
                 of_c = normal.dot((b - a).cross(x - a)) / size2;
    return {1 - of_b - of_c, of_b, of_c};
}

/// The way of the nearest point of a surface, which lies halfway while it goes; safe to call from several
/// threads.
class NearestWay
{
public:
    NearestWay(TriangleMesh const& before, TriangleMesh const& after) : mesh_(before), ways_(after.vertices)
    {
        for (std::size_t i = 0; i < ways_.size(); ++i) {
            ways_[i] -= before.vertices[i];
            mesh_.vertices[i] += ways_[i] / 2;
        }
        for (std::size_t i = 0; i < mesh_.triangles.size(); ++i) {
            auto const& t = mesh_.triangles[i];
            auto const &a = mesh_.vertices[t[0]], &b = mesh_.vertices[t[1]], &c = mesh_.vertices[t[2]];
            if (!((b - a).cross(c - a).squaredNorm() > 0)) continue; // it has no area halfway
            triangles_.emplace_back(corner(t, 0), corner(t, 1), corner(t, 2));
            which_.push_back(i);
        }
        require(!triangles_.empty(), "halfway between both meshes no triangle has an area", "deforming_mesh",
                "Pass poses that lie nearer to each other.");
        tree_.rebuild(triangles_.begin(), triangles_.end());
        tree_.accelerate_distance_queries();
        (*this)(Eigen::Vector3d::Zero()); // builds the tree
    }
    NearestWay(NearestWay const&) = delete;

    Eigen::Vector3d operator()(Eigen::Vector3d const& x) const
    {
        auto const [nearest, triangle] = tree_.closest_point_and_primitive(TriangleDistance::point(x));
        auto const& t = mesh_.triangles[which_[std::size_t(triangle - triangles_.begin())]];
        Eigen::Vector3d const at(CGAL::to_double(nearest.x()), CGAL::to_double(nearest.y()),
                                 CGAL::to_double(nearest.z()));
        Eigen::Vector3d const shares =
            shares_of_corners(at, mesh_.vertices[t[0]], mesh_.vertices[t[1]], mesh_.vertices[t[2]]);
        return shares[0] * ways_[t[0]] + shares[1] * ways_[t[1]] + shares[2] * ways_[t[2]];
    }

private:
    Kernel::Point_3 corner(std::array<std::uint32_t, 3> const& t, std::size_t i) const
    {
        return TriangleDistance::point(mesh_.vertices[t[i]]);
    }

    TriangleMesh mesh_; ///< halfway
    std::vector<Eigen::Vector3d> ways_;
    TriangleDistance::Triangles triangles_;
    std::vector<std::size_t> which_; ///< of the mesh they are
    TriangleDistance::Tree tree_;
};

} // namespace detail

/// An obstacle's shape of a mesh that changes its form from `begin` [s] on for `duration` [s]: a character, a
/// membrane, a glove. `before` and `after` have the same triangles; their vertices are at the two times. What
/// lies between goes on straight lines.
///
///     firn::Obstacle<firn::DeformingGrid<float, 3>> hand{
///         .shape = firn::deforming_mesh(pose[i], pose[i + 1], solver.time(), frame, 0.01, 0.06,
///         firn::OpenMP{})};
///     solver.advance(frame, firn::Gravity{}, hand);
///
/// Distances are computed afresh for both forms, on one grid that surrounds both by `margin` [m] with nodes
/// `cell_size` [m] apart: see distance_from_mesh for their accuracy and its errors. Throws firn::Error, too,
/// if the meshes have different triangles or numbers of vertices.
template <std::floating_point Real = float, class Loop = Serial>
DeformingGrid<Real, 3> deforming_mesh(TriangleMesh const& before, TriangleMesh const& after, double begin,
                                      double duration, double cell_size, double margin, Loop const& loop = {})
{
    char const* const where = "deforming_mesh";
    if (before.vertices.size() != after.vertices.size())
        throw Error{"the mesh before has " + std::to_string(before.vertices.size()) +
                        " vertices, and the one after " + std::to_string(after.vertices.size()),
                    where, "Pass one mesh with its vertices at two times."};
    require(before.triangles == after.triangles, "the meshes have different triangles", where,
            "Pass one mesh with its vertices at two times.");
    MeshInterior const first(before), last(after);
    Eigen::AlignedBox3d box = first.bounding_box();
    box.extend(last.bounding_box());
    auto const grid = detail::grid_around<Real>(box, cell_size, margin, where);
    detail::NearestWay const nearest(before, after);
    std::vector<Vector<Real, 3>> ways(grid.count());
    loop.for_each(grid.count(),
                  [&](std::size_t i) { ways[i] = nearest(grid.place(i)).template cast<Real>(); });
    return {detail::distance_on<Real>(grid, first, loop, where),
            detail::distance_on<Real>(grid, last, loop, where), ways, begin, duration};
}

} // namespace firn
