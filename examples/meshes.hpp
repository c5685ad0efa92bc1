// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/io/triangle_mesh.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

/// Meshes that the examples and tests make themselves: metres, y up, triangles counter-clockwise from
/// outside.
namespace firn::examples
{

using Point = Eigen::Vector3d;

namespace detail
{

/// A rotation that takes the y axis to this unit vector.
inline Eigen::Matrix3d turn_y_to(Point const& axis)
{
    Eigen::Matrix3d turn;
    Point const side = axis.unitOrthogonal();
    turn << side, axis, side.cross(axis);
    return turn;
}

} // namespace detail

/// A surface of quadrilaterals, counter-clockwise from outside.
struct QuadMesh
{
    std::vector<Point> vertices;
    std::vector<std::array<std::uint32_t, 4>> quads;
};

/// Halves every quadrilateral along its shorter diagonal; a corner that repeats gives one triangle.
inline TriangleMesh triangulated(QuadMesh const& mesh)
{
    TriangleMesh result{mesh.vertices, {}};
    auto const add = [&](std::uint32_t a, std::uint32_t b, std::uint32_t c) {
        if (a != b && b != c && c != a) result.triangles.push_back({a, b, c});
    };
    for (auto const& [a, b, c, d] : mesh.quads) {
        auto const& x = mesh.vertices;
        bool const along_ac = (x[a] - x[c]).squaredNorm() <= (x[b] - x[d]).squaredNorm();
        if (along_ac || a == b || b == c || c == d || d == a) {
            add(a, b, c);
            add(a, c, d);
        }
        else {
            add(b, c, d);
            add(b, d, a);
        }
    }
    return result;
}

/// The surface swept by a meridian (radius, height) about the y axis, from the lower to the upper pole, where
/// the radius is 0.
inline QuadMesh revolution(std::vector<Eigen::Vector2d> const& meridian, int segments)
{
    require(segments >= 3 && meridian.size() >= 3, "too few segments for a closed surface",
            "firn::examples::revolution", "Give 3 or more.");
    QuadMesh mesh;
    auto const rings = static_cast<std::uint32_t>(meridian.size());
    auto const around = static_cast<std::uint32_t>(segments);
    mesh.vertices.push_back({0, meridian.front().y(), 0});
    for (std::uint32_t ring = 1; ring + 1 < rings; ++ring)
        for (std::uint32_t i = 0; i < around; ++i) {
            double const angle = 2 * std::numbers::pi * i / around;
            mesh.vertices.push_back({meridian[ring].x() * std::sin(angle), meridian[ring].y(),
                                     meridian[ring].x() * std::cos(angle)});
        }
    mesh.vertices.push_back({0, meridian.back().y(), 0});
    auto const index = [&](std::uint32_t ring, std::uint32_t i) {
        if (ring == 0) return 0u;
        return ring + 1 == rings ? static_cast<std::uint32_t>(mesh.vertices.size() - 1)
                                 : 1 + (ring - 1) * around + i % around;
    };
    for (std::uint32_t ring = 0; ring + 1 < rings; ++ring)
        for (std::uint32_t i = 0; i < around; ++i)
            mesh.quads.push_back(
                {index(ring, i), index(ring, i + 1), index(ring + 1, i + 1), index(ring + 1, i)});
    return mesh;
}

/// A capsule along the y axis: a cylinder of length 2 `half_length` [m] with two half spheres of `radius`
/// [m].
inline TriangleMesh capsule(double radius, double half_length, int segments = 48)
{
    require(radius > 0 && half_length >= 0, "a capsule needs a positive radius", "firn::examples::capsule",
            "Give radius > 0 and half_length >= 0 in metres.");
    int const quarter = std::max(2, segments / 4);
    std::vector<Eigen::Vector2d> meridian;
    for (int side : {-1, 1})
        for (int i = 0; i <= quarter; ++i) {
            if (side == 1 && i == 0 && half_length == 0) continue; // the two halves share their equator
            double const angle = std::numbers::pi / 2 * (side == 1 ? i : i - quarter) / quarter;
            meridian.push_back({radius * std::cos(angle), radius * std::sin(angle) + side * half_length});
        }
    return triangulated(revolution(meridian, segments));
}

/// A sphere about the origin, inscribed: `segments` around, half as many from pole to pole.
inline TriangleMesh sphere(double radius, int segments = 48) { return capsule(radius, 0, segments); }

/// A torus about the origin: its tube of radius `minor` [m] follows a circle of radius `major` [m] about
/// `axis`.
inline TriangleMesh torus(double major, double minor, int major_segments = 96, int minor_segments = 48,
                          Point const& axis = Point::UnitY())
{
    require(minor > 0 && major > minor && major_segments >= 3 && minor_segments >= 3, "this is no torus",
            "firn::examples::torus", "Give major > minor > 0 in metres and 3 or more segments.");
    Eigen::Matrix3d const turn = detail::turn_y_to(axis.normalized());
    QuadMesh mesh;
    auto const n = static_cast<std::uint32_t>(major_segments), m = static_cast<std::uint32_t>(minor_segments);
    auto const index = [&](std::uint32_t i, std::uint32_t j) { return i % n * m + j % m; };
    for (std::uint32_t i = 0; i < n; ++i)
        for (std::uint32_t j = 0; j < m; ++j) {
            double const u = 2 * std::numbers::pi * i / n, v = 2 * std::numbers::pi * j / m;
            double const distance = major + minor * std::cos(v);
            mesh.vertices.push_back(
                turn * Point{distance * std::sin(u), minor * std::sin(v), distance * std::cos(u)});
            mesh.quads.push_back({index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)});
        }
    return triangulated(mesh);
}

/// A box about the origin with these half extents [m].
inline TriangleMesh box(Point const& half_extents)
{
    require(half_extents.minCoeff() > 0, "a box needs positive half extents", "firn::examples::box",
            "Give them in metres.");
    QuadMesh mesh;
    for (int corner = 0; corner < 8; ++corner)
        mesh.vertices.push_back(
            half_extents.cwiseProduct(Point(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1)));
    mesh.quads = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    return triangulated(mesh);
}

/// The surface where `field` (negative inside, about a distance [m]) is zero, by surface nets: one vertex in
/// each cell of side `cell` [m] that the surface crosses, one quadrilateral for each edge. Closed as long as
/// the surface stays within the box from -`reach` to `reach`, and free of self-intersections as long as no
/// feature is thinner than a cell; `soften` averages the field over neighbouring nodes once, which removes
/// such features.
///
/// Source: S. F. F. Gibson, Constrained elastic surface nets, MICCAI 1998.
inline QuadMesh isosurface(std::function<double(Point const&)> const& field, Point const& reach, double cell,
                           bool soften = true)
{
    Eigen::Vector3i const n = (reach * 2 / cell).array().ceil().cast<int>();
    Point const origin = -0.5 * cell * n.cast<double>();
    auto const node = [&](int i, int j, int k) {
        return (static_cast<std::size_t>(i) * (n.y() + 1) + j) * (n.z() + 1) + k;
    };
    auto const position = [&](int i, int j, int k) -> Point { return origin + cell * Point(i, j, k); };

    std::vector<double> value(node(n.x(), n.y(), n.z()) + 1);
    for (int i = 0; i <= n.x(); ++i)
        for (int j = 0; j <= n.y(); ++j)
            for (int k = 0; k <= n.z(); ++k) value[node(i, j, k)] = field(position(i, j, k));

    if (soften) {
        auto const sharp = value;
        std::array<std::size_t, 3> const strides{node(1, 0, 0), node(0, 1, 0), node(0, 0, 1)};
        for (int i = 1; i < n.x(); ++i)
            for (int j = 1; j < n.y(); ++j)
                for (int k = 1; k < n.z(); ++k) {
                    auto const at = node(i, j, k);
                    double around = 0;
                    for (auto const stride : strides) around += sharp[at - stride] + sharp[at + stride];
                    value[at] = sharp[at] / 2 + around / 12;
                }
    }

    QuadMesh mesh;
    auto constexpr none = std::uint32_t(-1);
    std::vector<std::uint32_t> vertex(value.size(), none); // of the cell with its lowest corner at this node
    for (int i = 0; i < n.x(); ++i)
        for (int j = 0; j < n.y(); ++j)
            for (int k = 0; k < n.z(); ++k) {
                Point sum = Point::Zero();
                int crossings = 0;
                for (int a = 0; a < 8; ++a)
                    for (int axis = 1; axis < 8; axis *= 2) {
                        if (a & axis) continue;
                        int const b = a | axis;
                        auto const corner = [&](int c) {
                            return Eigen::Vector3i(i + (c & 1), j + (c >> 1 & 1), k + (c >> 2));
                        };
                        auto const p = corner(a), q = corner(b);
                        double const at_p = value[node(p.x(), p.y(), p.z())],
                                     at_q = value[node(q.x(), q.y(), q.z())];
                        if ((at_p < 0) == (at_q < 0)) continue;
                        double const t = at_p / (at_p - at_q);
                        sum += position(p.x(), p.y(), p.z()) * (1 - t) + position(q.x(), q.y(), q.z()) * t;
                        ++crossings;
                    }
                if (crossings == 0) continue;
                vertex[node(i, j, k)] = static_cast<std::uint32_t>(mesh.vertices.size());
                mesh.vertices.push_back(sum / crossings);
            }

    for (int i = 0; i < n.x(); ++i)
        for (int j = 0; j < n.y(); ++j)
            for (int k = 0; k < n.z(); ++k)
                for (int axis = 0; axis < 3; ++axis) {
                    Eigen::Vector3i const here(i, j, k), along = Eigen::Vector3i::Unit(axis);
                    bool const at_border = here[(axis + 1) % 3] == 0 || here[(axis + 2) % 3] == 0;
                    if (at_border) continue;
                    Eigen::Vector3i const u = Eigen::Vector3i::Unit((axis + 1) % 3),
                                          v = Eigen::Vector3i::Unit((axis + 2) % 3);
                    auto const at = [&](Eigen::Vector3i const& c) { return node(c.x(), c.y(), c.z()); };
                    bool const inside = value[at(here)] < 0;
                    if (inside == (value[at(here + along)] < 0)) continue;
                    std::array<std::uint32_t, 4> quad{vertex[at(here - u - v)], vertex[at(here - v)],
                                                      vertex[at(here)], vertex[at(here - u)]};
                    if (!inside) std::swap(quad[1], quad[3]);
                    mesh.quads.push_back(quad);
                }
    return mesh;
}

namespace detail
{

/// About the distance [m] to an ellipsoid with these semi-axes.
/// Source: I. Quilez, Ellipsoid distance: k0 (k0 - 1) / k1.
inline double ellipsoid(Point const& x, Point const& centre, Point const& axes)
{
    Point const r = x - centre;
    double const k0 = r.cwiseQuotient(axes).norm(), k1 = r.cwiseQuotient(axes.cwiseAbs2()).norm();
    return k1 > 0 ? k0 * (k0 - 1) / k1 : -axes.minCoeff();
}

/// The union of two solids with a fillet `blend` [m] wide.
inline double join(double a, double b, double blend)
{
    double const h = std::max(blend - std::abs(a - b), 0.0) / blend;
    return std::min(a, b) - h * h * blend / 4;
}

/// The first solid without the second, the edge rounded over `blend` [m].
inline double carve(double a, double b, double blend) { return -join(-a, b, blend); }

/// Engraves a solid to `depth` [m] at distance 0 from a curve, fading over `width` [m].
inline double engrave(double solid, double distance, double width, double depth)
{
    return solid + depth * std::exp(-distance * distance / (width * width));
}

inline Point const eye_centre{0.135, 0.085, 0.22}; ///< of the left eye [m]; the right one mirrors it
inline Point const eye_axis = Point(0.14, 0.03, 1).normalized(); ///< where it looks
inline double constexpr eye_radius = 0.1;                        ///< [m]

/// A monkey's head without its eyes, about 1 m large.
inline double skull(Point const& at)
{
    Point const x{std::abs(at.x()), at.y(), at.z()}; // symmetric
    double head = ellipsoid(x, {0, 0.10, -0.06}, {0.345, 0.335, 0.34});
    head = join(head, ellipsoid(x, {0.12, -0.07, 0.12}, {0.17, 0.16, 0.15}), 0.08);   // cheeks
    head = join(head, ellipsoid(x, {0, -0.195, 0.225}, {0.25, 0.165, 0.19}), 0.07);   // muzzle
    head = join(head, ellipsoid(x, {0, -0.275, 0.15}, {0.17, 0.125, 0.14}), 0.06);    // chin
    head = join(head, ellipsoid(x, {0.125, 0.215, 0.2}, {0.145, 0.065, 0.12}), 0.07); // brow
    double ear = ellipsoid(x, {0.43, 0.085, -0.05}, {0.155, 0.175, 0.075});
    ear = carve(ear, ellipsoid(x, {0.445, 0.085, 0.04}, {0.105, 0.125, 0.075}), 0.03);
    return join(head, ear, 0.06);
}

} // namespace detail

/// A monkey-like head, about 1 m large, y up, facing +z: closed, in one piece, free of self-intersections;
/// about 13 000 triangles with the default `cell` [m].
inline TriangleMesh head(double cell = 0.0225)
{
    using namespace detail;
    auto const field = [](Point const& at) {
        Point const x{std::abs(at.x()), at.y(), at.z()};
        double solid = skull(at);
        solid =
            carve(solid, ellipsoid(x, eye_centre + Point(0, 0, 0.12), {0.13, 0.115, 0.12}), 0.08); // socket
        solid = join(solid, ellipsoid(x, eye_centre, Point::Constant(eye_radius)), 0.03);
        solid = engrave(solid, (x - eye_centre - eye_radius * eye_axis).norm(), 0.035, 0.06); // pupil
        solid = join(solid, ellipsoid(x, {0, -0.075, 0.37}, {0.085, 0.055, 0.065}), 0.06);    // nose
        solid = engrave(solid, (x - Point(0.036, -0.088, 0.43)).norm(), 0.025, 0.03);         // nostril
        Point const mouth = x - Point(0, 0.02, 0);
        double const arc = std::hypot(mouth.x(), mouth.y()) - 0.26, corner = std::max(mouth.x() - 0.16, 0.0);
        return x.z() > 0.1 && mouth.y() < 0 ? engrave(solid, std::hypot(arc, corner), 0.028, 0.03) : solid;
    };
    return triangulated(isosurface(field, {0.65, 0.55, 0.55}, cell));
}

/// The same monkey with about 500 quadrilaterals and open at the eyes, as such heads are often shared: three
/// components, the head with two holes and two eyeballs that do not touch it. It has no inside without a
/// repair.
inline TriangleMesh open_head()
{
    using namespace detail;
    auto const field = [](Point const& at) {
        Point const x{std::abs(at.x()), at.y(), at.z()};
        double const nose = ellipsoid(x, {0, -0.08, 0.35}, {0.11, 0.08, 0.09});
        double const ear = ellipsoid(x, {0.44, 0.085, -0.05}, {0.155, 0.175, 0.09});
        return join(join(skull(at), nose, 0.06), ear, 0.06);
    };
    auto const from_eye_axis = [](Point const& at) -> Point { // 0 behind the eye
        Point const x = Point{std::abs(at.x()), at.y(), at.z()} - eye_centre;
        return x - x.dot(eye_axis) * eye_axis;
    };
    double constexpr eyeball = 0.085, hole = 0.1; // radii [m]

    auto const whole = isosurface(field, {0.68, 0.595, 0.595}, 0.085, false);
    QuadMesh mesh;
    std::vector<std::uint32_t> renamed(whole.vertices.size(), std::uint32_t(-1));
    for (auto quad : whole.quads) {
        Point middle = Point::Zero();
        for (auto const corner : quad) middle += whole.vertices[corner] / 4;
        if (middle.z() > 0 && from_eye_axis(middle).norm() < hole) continue;
        for (auto& corner : quad) {
            if (renamed[corner] == std::uint32_t(-1)) {
                renamed[corner] = static_cast<std::uint32_t>(mesh.vertices.size());
                mesh.vertices.push_back(whole.vertices[corner]);
            }
            corner = renamed[corner];
        }
        mesh.quads.push_back(quad);
    }

    // Move vertices onto the surface, and those of a rim onto its hole's edge.
    std::set<std::pair<std::uint32_t, std::uint32_t>> edges;
    for (auto const& quad : mesh.quads)
        for (int i = 0; i < 4; ++i) edges.insert({quad[i], quad[(i + 1) % 4]});
    std::vector<bool> on_rim(mesh.vertices.size(), false);
    for (auto const& [a, b] : edges)
        if (!edges.contains({b, a})) on_rim[a] = on_rim[b] = true;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
        auto& x = mesh.vertices[v];
        for (int iteration = 0; iteration < 3; ++iteration) {
            double constexpr h = 1e-4;
            Point gradient;
            for (int axis = 0; axis < 3; ++axis)
                gradient[axis] =
                    (field(x + h * Point::Unit(axis)) - field(x - h * Point::Unit(axis))) / (2 * h);
            x -= std::clamp(0.5 * field(x), -0.01, 0.01) * gradient.normalized();
            if (!on_rim[v]) continue;
            Point outward = from_eye_axis(x);
            outward *= hole / outward.norm() - 1;
            x += x.x() < 0 ? Point{-outward.x(), outward.y(), outward.z()} : outward;
        }
    }

    auto const eye =
        revolution({{0, -1}, {0.59, -0.81}, {0.95, -0.31}, {0.95, 0.31}, {0.59, 0.81}, {0, 1}}, 8);
    for (double side : {-1.0, 1.0}) {
        auto const first = static_cast<std::uint32_t>(mesh.vertices.size());
        Point const axis{side * eye_axis.x(), eye_axis.y(), eye_axis.z()};
        Eigen::Matrix3d const turn = turn_y_to(axis);
        for (auto const& x : eye.vertices)
            mesh.vertices.push_back(Point{side * eye_centre.x(), eye_centre.y(), eye_centre.z()} +
                                    eyeball * (turn * x));
        for (auto quad : eye.quads) {
            for (auto& corner : quad) corner += first;
            mesh.quads.push_back(quad);
        }
    }
    return triangulated(mesh);
}

/// Writes a mesh as a Wavefront OBJ file.
inline void write_obj(TriangleMesh const& mesh, std::filesystem::path const& path)
{
    std::ofstream file(path);
    file.precision(9);
    for (auto const& x : mesh.vertices) file << "v " << x.x() << ' ' << x.y() << ' ' << x.z() << '\n';
    for (auto const& [a, b, c] : mesh.triangles)
        file << "f " << a + 1 << ' ' << b + 1 << ' ' << c + 1 << '\n';
    file.close();
    if (!file)
        throw Error{"the mesh could not be written", path.string(),
                    "Is there such a folder, and room on the disk?"};
}

} // namespace firn::examples
