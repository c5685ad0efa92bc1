// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/meshes.hpp"

#include <firn/io/read_mesh.hpp>

#include <numbers>

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
