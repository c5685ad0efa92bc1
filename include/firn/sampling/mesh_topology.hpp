// SPDX-License-Identifier: MIT
#pragma once

#include <firn/io/triangle_mesh.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

// Properties of a surface that follow from which triangles share which vertices.
namespace firn::detail
{

/// Disjoint sets of numbers that can be united.
class Groups
{
public:
    explicit Groups(std::size_t count) : parent_(count)
    {
        std::iota(parent_.begin(), parent_.end(), std::uint32_t(0));
    }

    std::uint32_t find(std::uint32_t i)
    {
        while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
        return i;
    }

    void unite(std::uint32_t i, std::uint32_t j) { parent_[find(i)] = find(j); }

private:
    std::vector<std::uint32_t> parent_;
};

/// Which connected component each triangle belongs to (components are connected through vertices).
struct Components
{
    std::vector<std::uint32_t> of_triangle;
    std::uint32_t count = 0;
};

inline Components components(TriangleMesh const& mesh)
{
    Groups groups(mesh.vertices.size());
    for (auto const& [a, b, c] : mesh.triangles) {
        groups.unite(a, b);
        groups.unite(a, c);
    }
    constexpr auto unseen = ~std::uint32_t(0);
    std::vector<std::uint32_t> number(mesh.vertices.size(), unseen);
    Components result;
    for (auto const& triangle : mesh.triangles) {
        auto& n = number[groups.find(triangle[0])];
        if (n == unseen) n = result.count++;
        result.of_triangle.push_back(n);
    }
    return result;
}

/// The edges that a closed surface does not have: with one triangle, or with more than two.
struct EdgeDefects
{
    std::size_t boundary_edges = 0, holes = 0, crowded_edges = 0;
    std::vector<Eigen::Vector3d> largest_hole; ///< both ends of each of its edges, one edge after the other
    std::vector<Eigen::Vector3d> crowded_edge; ///< both ends of the first one
};

inline EdgeDefects edge_defects(TriangleMesh const& mesh)
{
    using Edge = std::pair<std::uint32_t, std::uint32_t>;
    std::vector<Edge> edges, boundary;
    for (auto const& t : mesh.triangles)
        for (std::size_t i = 0; i < 3; ++i) edges.push_back(std::minmax({t[i], t[(i + 1) % 3]}));
    std::ranges::sort(edges);

    EdgeDefects result;
    Groups groups(mesh.vertices.size());
    for (auto at = edges.begin(); at != edges.end();) {
        auto const next = std::find_if(at, edges.end(), [&](Edge const& e) { return e != *at; });
        if (next - at == 1) {
            boundary.push_back(*at);
            groups.unite(at->first, at->second);
        }
        else if (next - at > 2 && result.crowded_edges++ == 0)
            result.crowded_edge = {mesh.vertices[at->first], mesh.vertices[at->second]};
        at = next;
    }

    result.boundary_edges = boundary.size();
    std::ranges::sort(boundary, {}, [&](Edge const& e) { return groups.find(e.first); });
    std::ptrdiff_t most = 0;
    for (auto at = boundary.begin(); at != boundary.end();) {
        auto const hole = groups.find(at->first);
        auto const next =
            std::find_if(at, boundary.end(), [&](Edge const& e) { return groups.find(e.first) != hole; });
        ++result.holes;
        if (next - at > most) {
            most = next - at;
            result.largest_hole.clear();
            for (auto const& [a, b] : std::span{at, next})
                result.largest_hole.insert(result.largest_hole.end(), {mesh.vertices[a], mesh.vertices[b]});
        }
        at = next;
    }
    return result;
}

/// Sums over some triangles.
struct SurfaceSums
{
    double area = 0;                                       ///< [m²]
    Eigen::Vector3d area_vector = Eigen::Vector3d::Zero(); ///< 0 for a closed surface [m²]
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();      ///< area-weighted [m]
    double volume =
        0; ///< of the cones to the centre: the enclosed volume if closed and oriented outwards [m³]
};

inline SurfaceSums surface_sums(TriangleMesh const& mesh)
{
    SurfaceSums sums;
    // Sums about a point of the surface: nothing cancels however far the mesh is from the origin.
    Eigen::Vector3d const origin = mesh.vertices[mesh.triangles.front()[0]];
    Eigen::Vector3d first_moment = Eigen::Vector3d::Zero();
    for (auto const& t : mesh.triangles) {
        Eigen::Vector3d const a = mesh.vertices[t[0]] - origin, b = mesh.vertices[t[1]] - origin,
                              c = mesh.vertices[t[2]] - origin;
        Eigen::Vector3d const twice_area = (b - a).cross(c - a);
        sums.area += twice_area.norm() / 2;
        sums.area_vector += twice_area / 2;
        first_moment += twice_area.norm() / 6 * (a + b + c);
        sums.volume += a.dot(b.cross(c)) / 6;
    }
    if (sums.area > 0) {
        Eigen::Vector3d const shift = first_moment / sums.area;
        sums.centre = origin + shift;
        sums.volume -= shift.dot(sums.area_vector) / 3;
    }
    return sums;
}

inline Eigen::AlignedBox3d bounding_box(TriangleMesh const& mesh)
{
    Eigen::AlignedBox3d box;
    for (auto const& triangle : mesh.triangles)
        for (auto const corner : triangle) box.extend(mesh.vertices[corner]);
    return box;
}

} // namespace firn::detail
