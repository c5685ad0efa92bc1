// SPDX-License-Identifier: MIT
#include "support/meshes.hpp"
#include "catch.hpp"

#include <firn/io/read_mesh.hpp>
#include <firn/sampling/distance_from_mesh.hpp>
#include <firn/sampling/mesh_interior.hpp>
#include <firn/sampling/points.hpp>

#include <limits>

using Eigen::Vector3d;
using firn::MeshInterior;
using firn::Repair;

namespace
{

/// The error of `what`, which must be one that says where and what to do.
template <class What>
firn::Error error_of(What const& what)
{
    try {
        what();
    }
    catch (firn::Error const& error) {
        CHECK_FALSE(error.where().empty());
        CHECK_FALSE(error.remedy().empty());
        return error;
    }
    FAIL("nothing was refused");
    throw;
}

firn::Error interior_error(firn::TriangleMesh const& mesh, Repair repair = Repair::none)
{
    return error_of([&] { MeshInterior{mesh, repair}; });
}

void check_refused(std::filesystem::path const& path, std::string const& what)
{
    INFO(path.string());
    auto const error = error_of([&] { firn::read_mesh(path); });
    CHECK_THAT(error.what_is_wrong(), Contains(what));
    CHECK_THAT(error.where(), Contains(path.string()));
}

} // namespace

TEST_CASE("an open mesh is refused with the number of its edges and the place of its hole")
{
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    std::erase(mesh.triangles, std::array<std::uint32_t, 3>{4, 5, 6});
    auto const error = interior_error(mesh);
    CHECK_THAT(error.what_is_wrong(), Contains("open: 3 boundary edges around 1 hole; it has 1 component"));
    CHECK_THAT(error.where(), Contains("(0.333333, 0.333333, 1)"));
    CHECK_THAT(error.remedy(), Contains("Repair::fill"));

    auto const head = interior_error(meshes::head(24));
    CHECK_THAT(head.what_is_wrong(), Contains("around 2 holes; it has 3 components"));
}

TEST_CASE("a mesh that crosses itself is refused with the number of crossings and a place")
{
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    meshes::append(mesh, meshes::box({0.9, 0.2, 0.2}, {2, 0.8, 0.8}));
    auto const error = interior_error(mesh);
    CHECK_THAT(error.what_is_wrong(), Contains("crosses") && Contains("pairs of triangles"));
    CHECK_THAT(error.where(), Contains("near ("));
    CHECK_THAT(error.remedy(), Contains("Repair::fill"));
}

TEST_CASE("an edge with more than two triangles is refused with its place")
{
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    meshes::append(mesh, meshes::box({1, 1, 0}, {2, 2, 1})); // touches along an edge
    auto const error = interior_error(mesh);
    CHECK_THAT(error.what_is_wrong(), Contains("1 edge with more than two triangles"));
    CHECK_THAT(error.where(), Contains("(1, 1, 0.5)"));
}

TEST_CASE("solids that touch in a point are refused")
{
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    meshes::append(mesh, meshes::box({1, 1, 1}, {2, 2, 2}));
    CHECK_THAT(interior_error(mesh).what_is_wrong(), Contains("touches itself"));
}

TEST_CASE("a surface without an inside and outside is refused")
{
    // A Klein bottle: a torus of which one direction returns mirrored.
    firn::TriangleMesh mesh;
    std::uint32_t const n = 12;
    for (std::uint32_t i = 0; i < n; ++i)
        for (std::uint32_t j = 0; j < n; ++j) {
            double const u = 2 * std::numbers::pi * i / n, v = 2 * std::numbers::pi * j / n;
            double const r = 3 + std::cos(u / 2) * std::sin(v) - std::sin(u / 2) * std::sin(2 * v);
            mesh.vertices.push_back({r * std::cos(u), r * std::sin(u),
                                     std::sin(u / 2) * std::sin(v) + std::cos(u / 2) * std::sin(2 * v)});
        }
    auto const at = [&](std::uint32_t i, std::uint32_t j) {
        return i == n ? (n - j % n) % n : i * n + j % n;
    };
    for (std::uint32_t i = 0; i < n; ++i)
        for (std::uint32_t j = 0; j < n; ++j) {
            mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    CHECK_THAT(interior_error(mesh).what_is_wrong(), Contains("no inside and outside"));
}

TEST_CASE("a mesh without triangles, with lost corners or with coordinates that are no numbers is refused")
{
    CHECK_THAT(interior_error({}).what_is_wrong(), Contains("no triangles"));
    auto lost = meshes::box({0, 0, 0}, {1, 1, 1});
    lost.triangles[3][1] = 8;
    CHECK_THAT(interior_error(lost).what_is_wrong(), Contains("triangle 3") && Contains("vertex 8"));
    auto broken = meshes::box({0, 0, 0}, {1, 1, 1});
    broken.vertices[5].y() = std::numeric_limits<double>::quiet_NaN();
    CHECK_THAT(interior_error(broken).what_is_wrong(), Contains("vertex 5"));
    firn::TriangleMesh const point{{{0, 0, 0}, {1, 0, 0}}, {{0, 1, 1}, {0, 0, 0}}};
    CHECK_THAT(interior_error(point).what_is_wrong(), Contains("collapsed"));
    CHECK_THAT(interior_error(point, Repair::fill).what_is_wrong(), Contains("collapsed"));
}

TEST_CASE("a flat sheet has no interior, with repair neither")
{
    firn::TriangleMesh const sheet{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0.5}, {0, 1, 0.5}}, {{0, 1, 2}, {0, 2, 3}}};
    CHECK_THAT(interior_error(sheet).what_is_wrong(), Contains("open"));
    CHECK_THAT(interior_error(sheet, Repair::fill).what_is_wrong(), Contains("no volume"));
    firn::TriangleMesh const level{{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, {{0, 1, 2}, {0, 2, 3}}};
    CHECK_THAT(interior_error(level, Repair::fill).what_is_wrong(), Contains("no volume"));
    auto const squashed = meshes::box({0, 0, 0}, {1, 1, 0});
    CHECK_FALSE(interior_error(squashed).what_is_wrong().empty());
    CHECK_THAT(interior_error(squashed, Repair::fill).what_is_wrong(), Contains("no volume"));
    auto open_slab = meshes::box({0, 0, 0}, {1, 1, 1e-7}); // would need 1e21 cubes to measure
    open_slab.triangles.pop_back();
    CHECK_THAT(interior_error(open_slab, Repair::fill).what_is_wrong(), Contains("no volume"));
}

TEST_CASE("a distance grid of no cells or too many is refused")
{
    MeshInterior const box(meshes::box({0, 0, 0}, {1, 1, 1}));
    for (double const cell : {0.0, -1.0, std::nan(""), 1e-9})
        error_of([&] { firn::distance_from_mesh(box, cell, 0.1); });
    error_of([&] { firn::distance_from_mesh(box, 0.1, -1); });
    MeshInterior const sheet(meshes::box({0, 0, 0.52}, {1, 1, 0.53}));
    auto const missed = error_of([&] { firn::distance_from_mesh(sheet, 0.1, 0.1); });
    CHECK_THAT(missed.what_is_wrong(), Contains("no node"));
    MeshInterior const mapped(meshes::box({5e5, 0, 0}, {5e5 + 1, 1, 1})); // in coordinates of a map
    auto const far = error_of([&] { firn::distance_from_mesh(mapped, 0.1, 0.1); });
    CHECK_THAT(far.what_is_wrong(), Contains("far from its origin"));
    CHECK_NOTHROW(firn::distance_from_mesh<double>(mapped, 0.1, 0.1));
}

TEST_CASE("a mesh file that is not there, is none, or is empty is refused")
{
    meshes::Folder const folder;
    check_refused(folder / "none.obj", "no such mesh file");
    check_refused(folder / "", "not a file");
    check_refused(folder.file("a.txt", "v 0 0 0"), "kind of mesh file is not known");
    check_refused(folder.file("noextension", "v 0 0 0"), "kind of mesh file is not known");
    check_refused(folder.file("a.fbx", "; FBX 7.3.0"), "kind of mesh file is not known");
    for (char const* name : {"a.obj", "a.stl", "a.ply", "a.gltf", "a.glb"})
        check_refused(folder.file(name, ""), "empty");
}

TEST_CASE("garbage under the name of a mesh is refused")
{
    meshes::Folder const folder;
    std::string garbage;
    for (int i = 0; i < 1000; ++i) garbage += char(i * 37 + i / 7);
    for (char const* name : {"a.obj", "a.stl", "a.ply", "a.gltf", "a.glb"}) {
        check_refused(folder.file(name, garbage), "");
        check_refused(folder.file(name, "this is no mesh\n"), "");
    }
}

TEST_CASE("a mesh file cut short is refused, or what is left of it is an open mesh")
{
    meshes::Folder const folder;
    auto const ball = meshes::sphere(1, 12);
    auto const half = [](std::string const& text) { return text.substr(0, text.size() / 2); };
    folder.file("a.bin", half(meshes::gltf_buffer(ball)));
    check_refused(folder.file("a.stl", half(meshes::stl(ball))), "");
    check_refused(folder.file("a.ply", half(meshes::ply(ball))), "");
    check_refused(folder.file("a.glb", half(meshes::glb(ball))), "");
    check_refused(folder.file("a.gltf", half(meshes::gltf_json(ball, "a.bin", {0, 0, 0}))), "");
    check_refused(folder.file("b.gltf", meshes::gltf_json(ball, "a.bin", {0, 0, 0})), "");
    check_refused(folder.file("c.gltf", meshes::gltf_json(ball, "none.bin", {0, 0, 0})), "");
    // OBJ has no count: half a file is a whole smaller one.
    auto const text = meshes::obj(ball);
    auto const cut =
        firn::read_mesh(folder.file("a.obj", text.substr(0, text.rfind('\n', text.size() - 200) + 1)));
    CHECK_THAT(interior_error(cut).what_is_wrong(), Contains("open"));
}

TEST_CASE("a PLY header that promises more than the file holds is refused before memory is reserved for it")
{
    meshes::Folder const folder;
    for (char const* count : {"4000000000", "99999999999999999999", "-1", "many"})
        check_refused(folder.file("a.ply", "ply\nformat binary_little_endian 1.0\nelement vertex " +
                                               std::string{count} + "\nproperty float x\nend_header\n"),
                      "promises");
}

TEST_CASE("a PLY header without an end is refused before the importer looks for it")
{
    meshes::Folder const folder;
    for (char const* last : {"", "end_heade", "property float x\n"})
        check_refused(folder.file("a.ply", std::string("ply\nformat ascii 1.0\nelement vertex 1\n") + last),
                      "no end");
}

TEST_CASE("coordinates that are no numbers are refused with the vertex")
{
    meshes::Folder const folder;
    auto mesh = meshes::box({0, 0, 0}, {1, 1, 1});
    mesh.vertices[2].x() = std::numeric_limits<double>::quiet_NaN();
    check_refused(folder.file("a.stl", meshes::stl(mesh)), "is not finite");
    check_refused(folder.file("a.ply", meshes::ply(mesh)), "vertex 2 ");
    check_refused(folder.file("a.glb", meshes::glb(mesh)), "");
    mesh.vertices[2].x() = std::numeric_limits<double>::infinity();
    check_refused(folder.file("a.ply", meshes::ply(mesh)), "vertex 2 ");
    check_refused(folder.file("a.obj", meshes::obj(mesh)), "");
}

TEST_CASE("a file of points or lines alone is refused")
{
    meshes::Folder const folder;
    check_refused(folder.file("a.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n"), "");
    check_refused(folder.file("a.ply",
                              "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                              "property float z\nend_header\n0 0 0\n"),
                  "");
    check_refused(folder.file("b.obj", "v 0 0 0\nv 1 0 0\nv 1 0 0\nf 1 2 3\n"), "no triangles");
}

TEST_CASE("a defect is told in the file's coordinates and by its face")
{
    meshes::Folder const folder;
    auto const path =
        folder.file("a.obj", "o floor\nv 0 0 0\nv 1000 0 0\nv 1000 1000 0\nv 0 1000 0\nf 4 3 2 1\n"
                             "o lid\nv 0 0 1000\nv 1000 0 1000\nv 1000 1000 1000\nv 0 1000 1000\n"
                             "f 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\n"); // a side is missing
    firn::MeshPlacement const placement{.scale = 0.001, .translation = {10, 20, 30}};
    auto mesh = firn::read_mesh(path, placement);
    auto const error = interior_error(mesh);
    CHECK_THAT(error.where(), Contains("(10, 20.5, 30.5) m in the scene, (0, 500, 500) in " + path.string()));
    CHECK_THAT(error.where(), Contains("of 'lid'") || Contains("of 'floor'"));
    CHECK_THAT(error.where(), Contains("(line "));
    for (auto& x : mesh.vertices) x += Vector3d{1, 2, 3}; // as an example does
    CHECK_THAT(interior_error(mesh).where(), Contains("(11, 22.5, 33.5) m in the scene, (0, 500, 500) in"));
    CHECK_THAT(interior_error(firn::read_mesh(path)).where(),
               Contains("near (0, 500, 500) m, in " + path.string() + ", face "));
    // crossing, with both faces
    auto const crossing = folder.file("b.ply", [] {
        auto two = meshes::box({0, 0, 0}, {1, 1, 1});
        meshes::append(two, meshes::box({0.9, 0.2, 0.2}, {2, 0.8, 0.8}));
        return meshes::ply(two);
    }());
    CHECK_THAT(interior_error(firn::read_mesh(crossing)).where(),
               Contains("face ") && Contains(" and near ("));
    // after a change to its triangles a mesh has only coordinates
    mesh.triangles.pop_back();
    CHECK_THAT(interior_error(mesh).where(), Contains(" in " + path.string()) && !Contains("face "));
    // far away with as many digits as needed
    auto far = meshes::moved(meshes::box({0, 0, 0}, {0.2, 0.2, 0.2}), {512345.4, 4649776.1, 120.3});
    far.triangles.pop_back();
    CHECK_THAT(interior_error(far).where(), Contains("4649776.2"));
}

TEST_CASE("a point cloud, and a file of another kind, get a sentence that fits")
{
    using namespace std::string_literals;
    meshes::Folder const folder;
    auto const remedy_of = [](std::filesystem::path const& path) {
        return error_of([&] { firn::read_mesh(path); }).remedy();
    };
    check_refused(folder.file("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\n"), "point cloud");
    check_refused(folder.file("a.ply",
                              "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                              "property float z\nend_header\n0 0 0\n"),
                  "point cloud");
    CHECK_THAT(remedy_of(folder / "a.ply"), Contains("Reconstruct a closed surface"));
    check_refused(folder.file("b.obj", "\x89PNG\r\n\x1a\n"s + std::string(100, '\1')), "a PNG image");
    check_refused(folder.file("b.stl", "PK\x03\x04 whatever is in it"), "a ZIP archive, as 3MF");
    check_refused(folder.file("c.obj", "solid a\nendsolid a\n"), "an STL file");
    check_refused(folder.file("b.ply", "v 0 0 0\n"), "does not begin as a ply file");
    check_refused(folder.file("d.obj", "version https://git-lfs.github.com/spec/v1\n"), "pointer of Git LFS");
    check_refused(folder.file("e.obj", "Dear all,\nthis is a letter.\n"), "this is no OBJ file");
    check_refused(folder.file("f.obj", "v 0,5 1,0 2,0\n"), "'0,5' is no number");
    CHECK_THAT(remedy_of(folder / "f.obj"), Contains("not a comma"));
    check_refused(
        folder.file("c.ply", "ply\nformat ascii 1.0\nelement vertex 1\nelement tristrips 1\nend_header\n"),
        "triangle strips");
    check_refused(folder.file("c.stl", "SOLID a\nENDSOLID a\n"), "neither an ASCII STL file");
    auto const stl = meshes::stl(meshes::sphere(1, 8));
    check_refused(folder.file("d.stl", stl + "tail"), "its header promises");
    check_refused(folder.file("e.stl", stl.substr(0, stl.size() - 50)), "its header promises");
    CHECK_THAT(remedy_of(folder.file("a.step", "ISO-10303-21;")), Contains("CAD"));
    CHECK_THAT(remedy_of(folder.file("a.las", "LASF")), Contains("point cloud"));
    CHECK_THAT(remedy_of(folder.file("a.3mf", "PK\x03\x04")), Contains("Blender"));
}

TEST_CASE("a line of an OBJ file that cannot be read is told")
{
    meshes::Folder const folder;
    std::string const vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\n";
    auto const check = [&](std::string const& text, std::string const& what) {
        auto const path = folder.file("a.obj", vertices + text);
        check_refused(path, what);
        CHECK_THAT(error_of([&] { firn::read_mesh(path); }).where(), EndsWith("line 4"));
    };
    check("v 1 2\n", "fewer than three coordinates");
    check("v 1 2 3e999\n", "3e999");
    check("v 1 2 3 0\nf 1 2 3\n", "vertex 4 is not finite");
    check("f 1 2 4\n", "face 1 names vertex 4 of 3");
    check("f 1 2 -4\n", "face 1 names vertex -4 of 3");
    check("f 1 2 0\n", "'0'");
    check("f 1 2 x\n", "'x'");
}

TEST_CASE("where a solid is too large for what is asked, millimetres are thought of")
{
    MeshInterior const large(meshes::box({0, 0, 0}, {1000, 800, 600})),
        usual(meshes::box({0, 0, 0}, {1, 1, 1}));
    auto const remedies = [&](MeshInterior const& solid, double length) {
        return std::vector<std::string>{
            error_of([&] { firn::lattice_points(solid, firn::Spacing{length}); }).remedy(),
            error_of([&] { firn::poisson_disk_points(solid, firn::Radius{length}); }).remedy(),
            error_of([&] { firn::uniform_points(solid, firn::Count{std::size_t(1) << 63}); }).remedy(),
            error_of([&] { firn::distance_from_mesh(solid, length, 0.1); }).remedy()};
    };
    for (auto const& remedy : remedies(large, 0.01))
        CHECK_THAT(remedy, Contains("1000 m across") && Contains("MeshPlacement{.scale = 0.001}"));
    for (auto const& remedy : remedies(usual, 1e-5)) CHECK_THAT(remedy, !Contains("millimetres"));
}

TEST_CASE("a placement that is none is refused")
{
    meshes::Folder const folder;
    auto const path = folder.file("a.obj", meshes::obj(meshes::box({0, 0, 0}, {1, 1, 1})));
    for (double const scale : {0.0, -1.0, std::nan(""), std::numeric_limits<double>::infinity()})
        CHECK_THAT(error_of([&] { firn::read_mesh(path, {.scale = scale}); }).what_is_wrong(),
                   Contains("scale"));
    Eigen::Matrix3d const mirror = Vector3d{-1, 1, 1}.asDiagonal();
    CHECK_THAT(error_of([&] { firn::read_mesh(path, {.rotation = mirror}); }).what_is_wrong(),
               Contains("rotation"));
    CHECK_THAT(error_of([&] {
                   firn::read_mesh(path, {.translation = {0, std::nan(""), 0}});
               }).what_is_wrong(),
               Contains("translation"));
}
