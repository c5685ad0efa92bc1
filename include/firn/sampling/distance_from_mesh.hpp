// SPDX-License-Identifier: MIT
#pragma once

// LICENCE: including this file makes your binary GPL-3, unless you hold a commercial CGAL licence. This text
// itself is under the licence named above. It takes 20 s to compile: include it from one translation unit.

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/serial.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>
#include <firn/sampling/interior.hpp>
#include <firn/sampling/mesh_interior.hpp>

#include <CGAL/AABB_tree.h>
#if __has_include(<CGAL/AABB_traits_3.h>) // since CGAL 6
#include <CGAL/AABB_traits_3.h>
#include <CGAL/AABB_triangle_primitive_3.h>
#else
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_triangle_primitive.h>
#endif

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{

/// The least distance to some triangles; safe to call from several threads.
class TriangleDistance
{
public:
    using Triangles = std::vector<Kernel::Triangle_3>;

    explicit TriangleDistance(Triangles triangles)
        : triangles_(std::move(triangles)), tree_(triangles_.begin(), triangles_.end())
    {
        tree_.accelerate_distance_queries();
        if (!triangles_.empty()) (*this)(Eigen::Vector3d::Zero()); // builds the tree
    }
    TriangleDistance(TriangleDistance const&) = delete;

    double operator()(Eigen::Vector3d const& x) const
    {
        if (triangles_.empty()) return std::numeric_limits<double>::max();
        return std::sqrt(CGAL::to_double(tree_.squared_distance(point(x))));
    }

    static Kernel::Point_3 point(Eigen::Vector3d const& x) { return {x.x(), x.y(), x.z()}; }

#if __has_include(<CGAL/AABB_traits_3.h>)
    using Traits =
        CGAL::AABB_traits_3<Kernel, CGAL::AABB_triangle_primitive_3<Kernel, Triangles::const_iterator>>;
#else
    using Traits =
        CGAL::AABB_traits<Kernel, CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>>;
#endif
    using Tree = CGAL::AABB_tree<Traits>;

private:
    Triangles triangles_;
    Tree tree_;
};

/// The triangles between inside and outside; a repaired mesh may have others, where its parts overlap.
inline TriangleDistance::Triangles bounding_triangles(MeshInterior const& interior)
{
    auto const& mesh = interior.surface();
    TriangleDistance::Triangles result;
    for (auto const& t : mesh.triangles) {
        auto const &a = mesh.vertices[t[0]], &b = mesh.vertices[t[1]], &c = mesh.vertices[t[2]];
        Eigen::Vector3d const centre = (a + b + c) / 3, area = (b - a).cross(c - a);
        Eigen::Vector3d const off = 1e-3 * area / std::sqrt(area.norm() + std::numeric_limits<double>::min());
        bool const buried =
            interior.repaired() && interior.contains(centre + off) && interior.contains(centre - off);
        using TD = TriangleDistance;
        if (!buried) result.emplace_back(TD::point(a), TD::point(b), TD::point(c));
    }
    return result;
}

/// Nodes of a grid, x fastest.
struct NodeGrid
{
    Eigen::Vector3d origin;
    double cell_size;
    Eigen::Array3i nodes;

    std::size_t count() const { return nodes.cast<std::size_t>().prod(); }
    std::size_t stride(int axis) const { return nodes.head(axis).cast<std::size_t>().prod(); }
    Eigen::Array3i at(std::size_t node) const
    {
        auto const nx = std::size_t(nodes[0]), ny = std::size_t(nodes[1]);
        return {int(node % nx), int(node / nx % ny), int(node / nx / ny)};
    }
    Eigen::Vector3d place(std::size_t node) const
    {
        return origin + cell_size * at(node).cast<double>().matrix();
    }
};

/// Closes the holes of a repaired mesh: where neighbouring nodes are on different sides and no triangle is
/// between them, it adds a square as large as a face of a cell at the place where the side changes.
inline TriangleDistance::Triangles hole_squares(MeshInterior const& interior, NodeGrid const& grid,
                                                std::vector<char> const& inside,
                                                std::vector<double> const& distance)
{
    TriangleDistance::Triangles result;
    double const h = grid.cell_size;
    for (std::size_t node = 0; node < grid.count(); ++node)
        for (int axis = 0; axis < 3; ++axis) {
            if (grid.at(node)[axis] + 1 >= grid.nodes[axis]) continue;
            auto const next = node + grid.stride(axis);
            if (inside[node] == inside[next] || distance[node] + distance[next] <= h) continue;
            Eigen::Vector3d from = grid.place(node), to = grid.place(next);
            for (int halving = 0; halving < 8; ++halving) {
                Eigen::Vector3d const middle = (from + to) / 2;
                (interior.contains(middle) == bool(inside[node]) ? from : to) = middle;
            }
            Eigen::Vector3d const u = h / 2 * Eigen::Vector3d::Unit((axis + 1) % 3);
            Eigen::Vector3d const v = h / 2 * Eigen::Vector3d::Unit((axis + 2) % 3);
            using TD = TriangleDistance;
            auto const a = TD::point(to - u - v), b = TD::point(to + u - v), c = TD::point(to + u + v),
                       d = TD::point(to - u + v);
            result.emplace_back(a, b, c);
            result.emplace_back(a, c, d);
        }
    return result;
}

/// The grid that surrounds a box by `margin` [m], its nodes `cell_size` [m] apart. Throws an Error for
/// `where`.
template <std::floating_point Real>
NodeGrid grid_around(Eigen::AlignedBox3d const& box, double cell_size, double margin, char const* where)
{
    require(is_finite(cell_size) && cell_size > 0, "the cell size is not a finite number above 0", where,
            "Pass a length [m].");
    require(is_finite(margin) && margin >= 0, "the margin is not a finite number, 0 or above", where,
            "Pass a length [m].");
    Eigen::Array3d const cells = ((box.sizes().array() + 2 * margin) / cell_size).ceil().max(1);
    if (!((cells + 1).prod() <= 5e8))
        throw Error{"the grid would have more than 5e8 nodes", where, "Use larger cells." + about_units(box)};
    Eigen::Vector3d const origin = box.center().array() - 0.5 * cell_size * cells;
    require(tells_cells_apart<Real, 3>(origin, static_cast<Real>(cell_size), cells.cast<int>() + 1),
            "the mesh lies so far from its origin that the grid's cells are lost to rounding", where,
            "Move the mesh to its origin, and place it by the obstacle's motion.");
    return {origin, cell_size, cells.cast<int>() + 1};
}

/// The signed distance of a solid at the nodes of a grid. Throws an Error for `where` if no node is inside.
template <std::floating_point Real, class Loop>
SignedDistanceGrid<Real, 3> distance_on(NodeGrid const& grid, MeshInterior const& interior, Loop const& loop,
                                        char const* where)
{
    std::vector<char> inside(grid.count());
    std::vector<double> distance(grid.count());
    TriangleDistance const to_mesh(bounding_triangles(interior));
    loop.for_each(grid.count(), [&](std::size_t i) {
        inside[i] = interior.contains(grid.place(i));
        distance[i] = to_mesh(grid.place(i));
    });
    require(std::ranges::any_of(inside, [](char in) { return in != 0; }),
            "no node of the grid falls inside the solid: the obstacle would not be there", where,
            "Use smaller cells, a few across the thinnest part.");
    if (interior.repaired()) {
        TriangleDistance const to_holes(hole_squares(interior, grid, inside, distance));
        loop.for_each(grid.count(),
                      [&](std::size_t i) { distance[i] = std::min(distance[i], to_holes(grid.place(i))); });
    }
    std::vector<Real> values(grid.count());
    for (std::size_t i = 0; i < values.size(); ++i)
        values[i] = static_cast<Real>(inside[i] ? -distance[i] : distance[i]);
    return {grid.origin.cast<Real>(), static_cast<Real>(grid.cell_size), grid.nodes, std::move(values)};
}

} // namespace detail

/// The signed distance of a solid on a grid that surrounds its box by `margin` [m], `cell_size` [m] apart:
/// an obstacle of any form.
///
/// At the nodes the distance is exact to rounding; in the holes of a repaired mesh it is exact to a cell.
/// Parts thinner than a cell may fall between the nodes. Throws firn::Error: cell size not above 0, margin
/// below 0, more than 5e8 nodes, none inside, a mesh so far from its origin that cells are lost to rounding.
template <std::floating_point Real = float, class Loop = Serial>
SignedDistanceGrid<Real, 3> distance_from_mesh(MeshInterior const& interior, double cell_size, double margin,
                                               Loop const& loop = {})
{
    char const* const where = "distance_from_mesh";
    auto const grid = detail::grid_around<Real>(interior.bounding_box(), cell_size, margin, where);
    return detail::distance_on<Real>(grid, interior, loop, where);
}

} // namespace firn
