// SPDX-License-Identifier: MIT
#pragma once

// LICENCE: including this file makes your binary GPL-3, unless you hold a commercial CGAL licence. This text
// itself is under the licence named above. It takes 20 s to compile: include it from one translation unit.

#if (defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__)) && !defined(FIRN_ALLOW_FAST_MATH_IN_CGAL)
// clang-format off
#error "Firn: CGAL tells inside from outside by intervals whose ends are rounded exactly, which -ffast-math (or \
-fassociative-math) breaks. Compile the file that includes mesh_interior.hpp without it, or define \
FIRN_ALLOW_FAST_MATH_IN_CGAL."
// clang-format on
#endif

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/serial.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/sampling/filled_surface.hpp>
#include <firn/sampling/mesh_place.hpp>
#include <firn/sampling/mesh_topology.hpp>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/orient_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/polygon_soup_to_polygon_mesh.h>
#include <CGAL/Polygon_mesh_processing/repair_polygon_soup.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Polygon_mesh_processing/shape_predicates.h>
#include <CGAL/Side_of_triangle_mesh.h>
#include <CGAL/Surface_mesh.h>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <iterator>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// What to do with a surface that bounds no volume.
enum class Repair
{
    none, ///< refuse it
    fill  ///< use the points that it winds around by more than one half (`FilledSurface`)
};

namespace detail
{

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using SurfaceMesh = CGAL::Surface_mesh<Kernel::Point_3>;

/// A closed surface, oriented outwards, and the tree that finds on which side of it a point lies.
struct ClosedSurface
{
    SurfaceMesh mesh;
    CGAL::Side_of_triangle_mesh<SurfaceMesh, Kernel> side;

    explicit ClosedSurface(SurfaceMesh closed) : mesh(std::move(closed)), side(mesh) {}
};

inline std::string number_of(std::size_t count, std::string const& thing, char const* plural = "s")
{
    return std::to_string(count) + " " + thing + (count == 1 ? "" : plural);
}

inline Error mesh_error(std::string what, std::string const& where, std::string const& remedy)
{
    return Error{std::move(what), "MeshInterior, " + where,
                 remedy + " in the modelling program, or pass Repair::fill."};
}

inline void check_triangles(TriangleMesh const& mesh)
{
    require(!mesh.triangles.empty(), "the mesh has no triangles", "MeshInterior",
            "Pass a closed triangle surface.");
    for (std::size_t t = 0; t < mesh.triangles.size(); ++t)
        for (auto const corner : mesh.triangles[t])
            if (corner >= mesh.vertices.size() || !all_finite(mesh.vertices[corner]))
                throw Error{"triangle " + std::to_string(t) + " has a corner (vertex " +
                                std::to_string(corner) + ") that does not exist or is not finite",
                            "MeshInterior", "Correct the mesh's indices and coordinates."};
    double extent = 0; // of the vertices that are used
    Eigen::Vector3d const& first = mesh.vertices[mesh.triangles.front()[0]];
    for (auto const& triangle : mesh.triangles)
        for (auto const corner : triangle)
            extent = std::max(extent, (mesh.vertices[corner] - first).cwiseAbs().maxCoeff());
    // so that volumes, and squares of volumes, are finite and above 0
    require(exactly_equal(extent, 0) || (extent > 1e-30 && extent < 1e15),
            "the mesh is smaller than 1e-30 m or larger than 1e15 m", "MeshInterior", "Scale it to metres.");
}

/// Welds equal points, drops degenerate triangles, finds the defects of edges, then orients the triangles of
/// each component alike as far as possible.
struct Soup
{
    std::vector<Kernel::Point_3> points;
    std::vector<std::vector<std::size_t>> triangles;
    EdgeDefects edges;

    explicit Soup(TriangleMesh const& mesh)
    {
        namespace PMP = CGAL::Polygon_mesh_processing;
        for (auto const& x : mesh.vertices) points.emplace_back(x.x(), x.y(), x.z());
        for (auto const& t : mesh.triangles) triangles.push_back({t[0], t[1], t[2]});
        PMP::repair_polygon_soup(points, triangles);
        edges = edge_defects(triangle_mesh());
        PMP::orient_polygon_soup(points, triangles);
    }

    TriangleMesh triangle_mesh() const
    {
        TriangleMesh mesh;
        for (auto const& p : points) mesh.vertices.emplace_back(p.x(), p.y(), p.z());
        for (auto const& t : triangles)
            if (t.size() == 3)
                mesh.triangles.push_back({std::uint32_t(t[0]), std::uint32_t(t[1]), std::uint32_t(t[2])});
        return mesh;
    }

    SurfaceMesh surface_mesh() const
    {
        SurfaceMesh mesh;
        CGAL::Polygon_mesh_processing::polygon_soup_to_polygon_mesh(points, triangles, mesh);
        return mesh;
    }
};

/// "near …": the middle of a face.
inline std::string near(MeshPlace const& place, SurfaceMesh const& mesh, SurfaceMesh::Face_index face)
{
    std::vector<Eigen::Vector3d> corners;
    for (auto const v : mesh.vertices_around_face(mesh.halfedge(face)))
        corners.emplace_back(mesh.point(v).x(), mesh.point(v).y(), mesh.point(v).z());
    return place.near(corners, corners.size());
}

/// Tells by its edges alone why a surface bounds no volume.
inline std::optional<Error> edge_error(EdgeDefects const& edges, std::size_t components,
                                       MeshPlace const& place)
{
    if (edges.crowded_edges > 0)
        return mesh_error("the mesh is not a manifold: " + number_of(edges.crowded_edges, "edge") +
                              " with more than two triangles",
                          place.near(edges.crowded_edge, 2), "Separate the surfaces that share these edges");
    if (edges.boundary_edges > 0)
        return mesh_error(
            "the mesh is open: " + number_of(edges.boundary_edges, "boundary edge") + " around " +
                number_of(edges.holes, "hole") + "; it has " + number_of(components, "component"),
            place.near(edges.largest_hole, 2), "Close it, or weld vertices that nearly coincide,");
    return {};
}

/// Tells by its geometry why a surface with sound edges bounds no volume.
inline std::optional<Error> geometry_error(SurfaceMesh const& mesh, MeshPlace const& place)
{
    namespace PMP = CGAL::Polygon_mesh_processing;
    for (auto const edge : mesh.halfedges())
        if (mesh.is_border(edge))
            return mesh_error(
                "the mesh has no inside and outside: its triangles cannot be turned the same way round",
                near(place, mesh, mesh.face(mesh.opposite(edge))), "Cut and cap it");
    std::vector<SurfaceMesh::Face_index> flat;
    for (auto const face : mesh.faces())
        if (PMP::is_degenerate_triangle_face(face, mesh)) flat.push_back(face);
    if (!flat.empty())
        return mesh_error(number_of(flat.size(), "triangle") + " without area",
                          near(place, mesh, flat.front()), "Collapse them");
    std::vector<std::pair<SurfaceMesh::Face_index, SurfaceMesh::Face_index>> crossings;
    PMP::self_intersections(mesh, std::back_inserter(crossings));
    if (!crossings.empty())
        return mesh_error("the mesh crosses or touches itself: " + number_of(crossings.size(), "pair") +
                              " of triangles",
                          near(place, mesh, crossings.front().first) + " and " +
                              near(place, mesh, crossings.front().second),
                          "Unite the parts (boolean union)");
    return {};
}

} // namespace detail

/// The solid that a triangle surface bounds: tells which points lie inside.
///
/// The surface must be closed, a manifold and free of self-intersections. Solids beside one another add up;
/// of shells inside one another every second one bounds a hole (a ball in a hollow ball), however each of
/// them is oriented. Solids that overlap cross each other and are refused.
///
/// With `Repair::fill` a surface that would be refused stands for the points that it winds around by more
/// than one half (`FilledSurface`, generalised winding number); a sound one is not touched. `defect()` says
/// what was wrong.
///
/// Throws firn::Error: no triangles, a corner that does not exist or is not finite, an edge with one triangle
/// or more than two, triangles without area, not orientable, crossing itself, no volume. It names the place,
/// and for a mesh that was read from a file (`TriangleMesh::source`) also the place in the file's coordinates
/// and the file's face.
///
/// Cheap to copy; several threads may call it at the same time.
class MeshInterior
{
public:
    /// A backend is a loop: `MeshInterior(mesh, Repair::fill, OpenMP{})` fills with all threads, and finds
    /// the same solid with any number of them; a sound mesh needs none. `progress`, if any, is called now and
    /// then while a mesh is filled, by the thread that calls this, with the share that is done, from 0 to 1.
    /// An exception that it throws ends the work and is passed on.
    template <class Loop = Serial>
    explicit MeshInterior(TriangleMesh const& mesh, Repair repair = Repair::none, Loop const& loop = {},
                          std::function<void(double)> const& progress = {})
    {
        detail::check_triangles(mesh);
        detail::Soup const soup(mesh);
        auto surface = soup.triangle_mesh();
        if (surface.triangles.empty())
            throw detail::mesh_error("every triangle of the mesh is collapsed", "all of it",
                                     "Model a closed surface");
        components_ = detail::components(surface).count;
        detail::MeshPlace const place(mesh);
        auto defect = detail::edge_error(soup.edges, components_, place);
        if (!defect) defect = close(soup.surface_mesh(), place);
        if (!defect) return;
        if (repair == Repair::none) throw *defect;
        closed_.reset();
        defect_ = std::string{defect->what_is_wrong()} + " [" + defect->where() + "]";
        filled_ = std::make_shared<FilledSurface const>(std::move(surface), loop, progress);
        surface_ = std::shared_ptr<TriangleMesh const>(filled_, &filled_->surface());
        box_ = filled_->bounding_box();
        volume_ = filled_->volume();
    }

    /// Tells of each point [m] whether it lies inside (1) or not (0, on the surface too).
    template <class Loop = Serial>
    std::vector<char> contains(std::span<Eigen::Vector3d const> points, Loop const& loop = {}) const
    {
        std::vector<char> inside(points.size());
        loop.for_each(points.size(), [&](std::size_t i) { inside[i] = contains(points[i]); });
        return inside;
    }

    bool contains(Eigen::Vector3d const& x) const
    {
        if (!box_.contains(x)) return false; // NaN is not inside either
        if (filled_) return filled_->contains(x);
        return closed_->side({x.x(), x.y(), x.z()}) == CGAL::ON_BOUNDED_SIDE;
    }

    /// The volume [m³]: of a sound mesh exact to rounding, of a repaired one estimated.
    double volume() const { return volume_; }
    /// Standard error of `volume()` [m³]: 0 of a sound mesh, of a repaired one about 0.02 % of the volume.
    double volume_error() const { return filled_ ? filled_->volume_error() : 0; }

    Eigen::AlignedBox3d const& bounding_box() const { return box_; } ///< of the surface [m]
    std::size_t components() const { return components_; }           ///< connected pieces of the surface
    bool repaired() const { return filled_ != nullptr; }             ///< true if Repair::fill was needed
    std::string const& defect() const { return defect_; } ///< what was repaired, and where; or nothing

    /// The surface, welded and oriented outwards.
    TriangleMesh const& surface() const { return *surface_; }

private:
    /// Accepts the mesh as it is, or returns why it bounds no volume.
    std::optional<Error> close(detail::SurfaceMesh mesh, detail::MeshPlace const& place)
    {
        if (auto defect = detail::geometry_error(mesh, place)) return defect;
        CGAL::Polygon_mesh_processing::orient_to_bound_a_volume(mesh);
        auto surface = std::make_shared<TriangleMesh>();
        for (auto const v : mesh.vertices()) {
            auto const& p = mesh.point(v);
            surface->vertices.emplace_back(p.x(), p.y(), p.z());
        }
        for (auto const face : mesh.faces()) {
            auto corner = mesh.vertices_around_face(mesh.halfedge(face)).begin();
            auto& triangle = surface->triangles.emplace_back();
            for (auto& index : triangle) index = static_cast<std::uint32_t>(*corner++);
        }
        volume_ = detail::surface_sums(*surface).volume;
        box_ = detail::bounding_box(*surface);
        if (!(volume_ > 0))
            return detail::mesh_error("the mesh bounds no volume", place.near(surface->vertices, 0),
                                      "Give it a thickness");
        surface_ = std::move(surface);
        closed_ = std::make_shared<detail::ClosedSurface const>(std::move(mesh));
        // The tree is built by the first query, which several threads must not make at the same time.
        closed_->side({box_.center().x(), box_.center().y(), box_.center().z()});
        return {};
    }

    std::shared_ptr<detail::ClosedSurface const> closed_;
    std::shared_ptr<FilledSurface const> filled_;
    std::shared_ptr<TriangleMesh const> surface_;
    Eigen::AlignedBox3d box_;
    double volume_ = 0;
    std::size_t components_ = 0;
    std::string defect_;
};

} // namespace firn
