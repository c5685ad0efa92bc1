// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"

#include <firn/io/read_mesh.hpp>

#include <numbers>
#include <sstream>

using Eigen::Vector3d;

namespace
{

/// Checks that `mesh` is `expected`, its vertices and triangles in any order, to the accuracy of a file.
void check_same(firn::TriangleMesh const& mesh, firn::TriangleMesh const& expected)
{
    CHECK(mesh.vertices.size() == expected.vertices.size());
    CHECK(mesh.triangles.size() == expected.triangles.size());
    auto const sums = [](firn::TriangleMesh const& m) {
        Eigen::Array4d result = Eigen::Array4d::Zero(); // enclosed volume, sum of area · centre
        for (auto const& [i, j, k] : m.triangles) {
            auto const &a = m.vertices[i], &b = m.vertices[j], &c = m.vertices[k];
            result[0] += a.dot(b.cross(c)) / 6;
            result.tail<3>() += ((b - a).cross(c - a).norm() / 6 * (a + b + c)).array();
        }
        return result;
    };
    CHECK((sums(mesh) - sums(expected)).abs().maxCoeff() < 1e-4);
}

} // namespace

TEST_CASE("a mesh is read the same from every kind of file, welded")
{
    meshes::Folder const folder;
    auto const ring = meshes::moved(meshes::torus(1, 0.25, 24, 12), {0.1, 0.2, 0.3});
    check_same(firn::read_mesh(folder.file("a.obj", meshes::obj(ring))), ring);
    check_same(firn::read_mesh(folder.file("a.stl", meshes::stl(ring))), ring);
    check_same(firn::read_mesh(folder.file("a.ply", meshes::ply(ring))), ring);
    check_same(firn::read_mesh(folder.file("a.glb", meshes::glb(ring))), ring);
    folder.file("a.bin", meshes::gltf_buffer(ring));
    check_same(firn::read_mesh(folder.file("a.gltf", meshes::gltf_json(ring, "a.bin", {0, 0, 0}))), ring);
    check_same(firn::read_mesh(folder.file("LOUD.OBJ", meshes::obj(ring))), ring);
}

TEST_CASE("nodes move their meshes")
{
    meshes::Folder const folder;
    auto const box = meshes::box({0, 0, 0}, {1, 2, 3});
    check_same(firn::read_mesh(folder.file("a.glb", meshes::glb(box, {1, -2, 3}))),
               meshes::moved(box, {1, -2, 3}));
}

TEST_CASE("a node that mirrors its mesh keeps the outside outside")
{
    meshes::Folder const folder;
    auto const box = meshes::box({0, 0, 0}, {1, 2, 3});
    auto json = meshes::gltf_json(box, "a.bin", {0, 0, 0});
    json.replace(json.find("\"translation\":["),
                 json.find("]", json.find("\"translation\":[")) + 1 - json.find("\"translation\":["),
                 "\"scale\":[-1,1,1]");
    folder.file("a.bin", meshes::gltf_buffer(box));
    check_same(firn::read_mesh(folder.file("a.gltf", json)), meshes::box({-1, 0, 0}, {0, 2, 3}));
}

TEST_CASE("a mesh is scaled, rotated and moved, in this order")
{
    meshes::Folder const folder;
    auto const path = folder.file("a.obj", meshes::obj(meshes::box({0, 0, 0}, {1, 2, 3})));
    firn::MeshPlacement placement{.scale = 0.5, .translation = {10, 0, 0}};
    placement.rotation = Eigen::AngleAxisd(std::numbers::pi / 2, Vector3d::UnitZ()).toRotationMatrix();
    auto const mesh = firn::read_mesh(path, placement);
    Eigen::AlignedBox3d box;
    for (auto const& x : mesh.vertices) box.extend(x);
    CHECK((box.min() - Vector3d{9, 0, 0}).norm() < 1e-12);
    CHECK((box.max() - Vector3d{10, 0.5, 1.5}).norm() < 1e-12);
    placement.scale = 1e308; // finite, as are the corners in the file
    CHECK_THROWS_AS(firn::read_mesh(path, placement), firn::Error);
}

TEST_CASE("polygons become triangles; lines, points and collapsed triangles are dropped")
{
    meshes::Folder const folder;
    auto const mesh = firn::read_mesh(folder.file("a.obj", "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 1 0\n"
                                                           "f 1 2 3 4\nl 1 3\np 2\nf 2 3 5\n"));
    CHECK(mesh.triangles.size() == 2);
    CHECK(mesh.vertices.size() == 4);
}

TEST_CASE("an OBJ file keeps its precision, wherever it lies")
{
    meshes::Folder const folder;
    auto const mesh = firn::read_mesh(folder.file(
        "a.obj",
        "v 512345.4 4649776.1 120.3\nv 512345.6 4649776.1 120.3\nv 512345.4 4649776.3 120.3\nf 1 2 3\n"));
    REQUIRE(mesh.vertices.size() == 3);
    CHECK(mesh.vertices[0] == Vector3d{512345.4, 4649776.1, 120.3});
    CHECK(mesh.vertices[2] == Vector3d{512345.4, 4649776.3, 120.3});
}

TEST_CASE("numbers of an OBJ file come in all forms")
{
    meshes::Folder const folder;
    auto const mesh = firn::read_mesh(folder.file("a.obj", "\xef\xbb\xbf# with a byte order mark\r\n"
                                                           "v .5 -.5 5.\r\nv\t+.25 1e-1 1.E+2 # a comment\r\n"
                                                           "v -1.5e0 .5e1 2 0.1 0.2 0.3\r\nv 2 4 6 2\r\n"
                                                           "o lid of it\r\nf 1/1/1 2//1 \\\r\n 3/2\r\n"
                                                           "g bottom\r\nf -4 -1 -3\r\n"));
    REQUIRE(mesh.vertices.size() == 4);
    CHECK(mesh.vertices[0] == Vector3d{0.5, -0.5, 5});
    CHECK(mesh.vertices[1] == Vector3d{0.25, 0.1, 100});
    CHECK(mesh.vertices[2] == Vector3d{-1.5, 5, 2});
    CHECK(mesh.vertices[3] == Vector3d{1, 2, 3});
    REQUIRE(mesh.source);
    CHECK(mesh.source->parts == std::vector<std::string>{"lid of it", "bottom"});
    CHECK(mesh.source->faces[0].line == 7);
    CHECK(mesh.source->faces[1].line == 10);
    CHECK(mesh.source->faces[1].number == 2);
    CHECK(mesh.source->faces[1].part == 1);
}

TEST_CASE("what is read in single precision is refused where that would bend it")
{
    meshes::Folder const folder;
    auto const ascii = [](firn::TriangleMesh const& mesh) {
        std::ostringstream text;
        text.precision(12);
        text << "ply\nformat ascii 1.0\nelement vertex 8\nproperty double x\nproperty double y\nproperty "
                "double "
                "z\nelement face 12\nproperty list uchar int vertex_indices\nend_header\n";
        for (auto const& x : mesh.vertices) text << x.x() << ' ' << x.y() << ' ' << x.z() << '\n';
        for (auto const& [a, b, c] : mesh.triangles) text << "3 " << a << ' ' << b << ' ' << c << '\n';
        return text.str();
    };
    auto const check_refused = [&](std::filesystem::path const& path) {
        try {
            firn::read_mesh(path);
            FAIL_CHECK("nothing was refused: " << path);
        }
        catch (firn::Error const& error) {
            CHECK_THAT(error.what(), Contains("single precision") && Contains("MeshPlacement::translation"));
        }
    };
    auto const cube = meshes::box({512345.4, 4649776.1, 120.3}, {512345.6, 4649776.3, 120.5});
    check_refused(folder.file("a.ply", ascii(cube)));
    check_refused(folder.file("b.ply", meshes::ply(cube)));
    check_refused(folder.file("a.stl", meshes::stl(cube)));
    check_refused(folder.file("a.glb", meshes::glb(cube)));
    auto const unit = meshes::box({0, 0, 0}, {1, 1, 1});
    check_refused(folder.file("b.glb", meshes::glb(unit, {0, 4649776.1, 0}))); // moved there by its node
    // a million spacings, and ten thousand that are the file's own
    CHECK_NOTHROW(firn::read_mesh(folder.file("c.ply", ascii(meshes::moved(unit, {10, 0, 0})))));
    CHECK_NOTHROW(firn::read_mesh(folder.file("b.stl", meshes::stl(meshes::moved(unit, {1000, 0, 0})))));
    check_refused(folder.file("d.ply", ascii(meshes::moved(unit, {1000, 0, 0}))));
    // a vertex that no face names changes nothing
    auto stray = cube;
    stray.vertices.push_back({0, 0, 0});
    check_refused(folder.file("e.ply", ascii(stray)));
    stray = unit;
    stray.vertices.push_back({1e7, 0, 0});
    CHECK_NOTHROW(firn::read_mesh(folder.file("f.ply", ascii(stray))));
}
