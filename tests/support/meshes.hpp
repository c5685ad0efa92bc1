// SPDX-License-Identifier: MIT
#pragma once

#include <firn/io/triangle_mesh.hpp>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <numbers>
#include <string>

/// Meshes of known volume, and minimal writers of files to read them back from.
namespace meshes
{

using Eigen::Vector3d;
using firn::TriangleMesh;

/// Appends `other` to `mesh` unchanged, as further components.
inline void append(TriangleMesh& mesh, TriangleMesh const& other)
{
    auto const base = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
    for (auto const& [a, b, c] : other.triangles) mesh.triangles.push_back({a + base, b + base, c + base});
}

inline TriangleMesh inverted(TriangleMesh mesh)
{
    for (auto& triangle : mesh.triangles) std::swap(triangle[1], triangle[2]);
    return mesh;
}

inline TriangleMesh moved(TriangleMesh mesh, Vector3d const& by)
{
    for (auto& x : mesh.vertices) x += by;
    return mesh;
}

/// Removes the triangles with a centre that satisfies `where`.
template <class Where>
TriangleMesh without(TriangleMesh mesh, Where const& where)
{
    std::erase_if(mesh.triangles, [&](auto const& t) {
        return where(Vector3d{(mesh.vertices[t[0]] + mesh.vertices[t[1]] + mesh.vertices[t[2]]) / 3});
    });
    return mesh;
}

/// A sphere about the origin: `n` rings of 2n triangles pairs, poles along z.
inline TriangleMesh sphere(double radius, std::uint32_t n)
{
    TriangleMesh mesh;
    auto const around = 2 * n;
    mesh.vertices.push_back({0, 0, radius});
    for (std::uint32_t ring = 1; ring < n; ++ring)
        for (std::uint32_t i = 0; i < around; ++i) {
            double const polar = std::numbers::pi * ring / n, turn = 2 * std::numbers::pi * i / around;
            mesh.vertices.push_back(radius * Vector3d{std::sin(polar) * std::cos(turn),
                                                      std::sin(polar) * std::sin(turn), std::cos(polar)});
        }
    mesh.vertices.push_back({0, 0, -radius});
    auto const at = [&](std::uint32_t ring, std::uint32_t i) { return 1 + (ring - 1) * around + i % around; };
    auto const south = static_cast<std::uint32_t>(mesh.vertices.size() - 1);
    for (std::uint32_t i = 0; i < around; ++i) {
        mesh.triangles.push_back({0, at(1, i), at(1, i + 1)});
        for (std::uint32_t ring = 1; ring + 1 < n; ++ring) {
            mesh.triangles.push_back({at(ring, i), at(ring + 1, i), at(ring + 1, i + 1)});
            mesh.triangles.push_back({at(ring, i), at(ring + 1, i + 1), at(ring, i + 1)});
        }
        mesh.triangles.push_back({at(n - 1, i), south, at(n - 1, i + 1)});
    }
    return mesh;
}

/// A torus about z: ring radius `R`, tube radius `r`, 2 · around · tube triangles.
inline TriangleMesh torus(double R, double r, std::uint32_t around, std::uint32_t tube)
{
    TriangleMesh mesh;
    for (std::uint32_t i = 0; i < around; ++i)
        for (std::uint32_t j = 0; j < tube; ++j) {
            double const u = 2 * std::numbers::pi * i / around, v = 2 * std::numbers::pi * j / tube;
            double const distance = R + r * std::cos(v);
            mesh.vertices.push_back({distance * std::cos(u), distance * std::sin(u), r * std::sin(v)});
        }
    auto const at = [&](std::uint32_t i, std::uint32_t j) { return i % around * tube + j % tube; };
    for (std::uint32_t i = 0; i < around; ++i)
        for (std::uint32_t j = 0; j < tube; ++j) {
            mesh.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
            mesh.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
        }
    return mesh;
}

/// An axis-aligned box of twelve triangles.
inline TriangleMesh box(Vector3d const& lowest, Vector3d const& highest)
{
    TriangleMesh mesh;
    for (int corner = 0; corner < 8; ++corner)
        mesh.vertices.push_back({(corner & 1 ? highest : lowest).x(), (corner & 2 ? highest : lowest).y(),
                                 (corner & 4 ? highest : lowest).z()});
    mesh.triangles = {{0, 2, 1}, {1, 2, 3}, {4, 5, 6}, {5, 7, 6}, {0, 1, 4}, {1, 5, 4},
                      {2, 6, 3}, {3, 6, 7}, {0, 4, 2}, {2, 4, 6}, {1, 3, 5}, {3, 7, 5}};
    return mesh;
}

/// A ball with a hollow in it.
inline TriangleMesh hollow_ball(double outer, double inner, std::uint32_t n)
{
    auto mesh = sphere(outer, n);
    append(mesh, inverted(sphere(inner, n)));
    return mesh;
}

/// Directions of the eyes of `head`.
inline std::array<Vector3d, 2> eyes()
{
    return {Vector3d{0.4, 0.35, 0.85}.normalized(), Vector3d{-0.4, 0.35, 0.85}.normalized()};
}

/// A ball of radius 1 as a modeller makes a head: where the eyes are, the skull has holes, and each is filled
/// by a ball that is a component of its own and sticks in the hole without touching its rim.
/// With `holes = false` the skull is closed (the eyeballs still cross it).
inline TriangleMesh head(std::uint32_t n, bool holes = true)
{
    auto mesh = sphere(1, n);
    if (holes)
        mesh = without(mesh, [](Vector3d const& x) {
            return x.normalized().dot(eyes()[0]) > 0.965 || x.normalized().dot(eyes()[1]) > 0.965;
        });
    for (auto const& eye : eyes()) append(mesh, moved(sphere(0.2, n / 3), 0.95 * eye));
    return mesh;
}

/// A thin hollow ball with fins that share an edge with its outside each, around the equator: edges of three
/// triangles, open sheets, and little volume in a large box.
inline TriangleMesh finned_shell(double inner, std::uint32_t n, std::uint32_t fins)
{
    auto mesh = hollow_ball(1, inner, n);
    auto const around = 2 * n;
    for (std::uint32_t fin = 0; fin < fins; ++fin) {
        auto const a = 1 + (n / 2 - 1) * around + fin * around / fins, b = a + around;
        auto const c = static_cast<std::uint32_t>(mesh.vertices.size());
        for (auto const foot : {a, b}) mesh.vertices.push_back(1.2 * Vector3d{mesh.vertices[foot]});
        mesh.triangles.push_back({a, b, c});
        mesh.triangles.push_back({b, c + 1, c});
    }
    return mesh;
}

// ---- files

/// A fresh folder below the system's temporary folder, removed with everything in it.
class Folder
{
public:
    Folder()
    {
        auto pattern = (std::filesystem::temp_directory_path() / "firn-XXXXXX").string();
        path_ = ::mkdtemp(pattern.data());
    }
    Folder(Folder const&) = delete;
    ~Folder()
    {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    std::filesystem::path operator/(std::string const& name) const { return path_ / name; }
    /// Writes a file of `content` and returns its path.
    std::filesystem::path file(std::string const& name, std::string const& content) const
    {
        std::ofstream(path_ / name, std::ios::binary) << content;
        return path_ / name;
    }

private:
    std::filesystem::path path_;
};

inline std::string obj(TriangleMesh const& mesh)
{
    std::string text;
    for (auto const& x : mesh.vertices)
        text +=
            "v " + std::to_string(x.x()) + " " + std::to_string(x.y()) + " " + std::to_string(x.z()) + "\n";
    for (auto const& [a, b, c] : mesh.triangles)
        text +=
            "f " + std::to_string(a + 1) + " " + std::to_string(b + 1) + " " + std::to_string(c + 1) + "\n";
    return text;
}

template <class T>
std::string bytes(T const& value)
{
    std::string result(sizeof(T), '\0');
    std::memcpy(result.data(), &value, sizeof(T));
    return result;
}

inline std::string bytes(Vector3d const& x)
{
    return bytes(float(x.x())) + bytes(float(x.y())) + bytes(float(x.z()));
}

/// Binary STL: three vertices of its own for each triangle.
inline std::string stl(TriangleMesh const& mesh)
{
    std::string text(80, ' ');
    text += bytes(std::uint32_t(mesh.triangles.size()));
    for (auto const& triangle : mesh.triangles) {
        text += bytes(Vector3d{0, 0, 0});
        for (auto const corner : triangle) text += bytes(mesh.vertices[corner]);
        text += bytes(std::uint16_t(0));
    }
    return text;
}

/// Binary PLY.
inline std::string ply(TriangleMesh const& mesh)
{
    std::string text =
        "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(mesh.vertices.size()) +
        "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
        std::to_string(mesh.triangles.size()) + "\nproperty list uchar int vertex_indices\nend_header\n";
    for (auto const& x : mesh.vertices) text += bytes(x);
    for (auto const& triangle : mesh.triangles) {
        text += char(3);
        for (auto const corner : triangle) text += bytes(std::int32_t(corner));
    }
    return text;
}

/// glTF 2.0 as JSON and a binary chunk; the mesh hangs on a node that moves it by `translation`.
inline std::string gltf_json(TriangleMesh const& mesh, std::string const& buffer_uri,
                             Vector3d const& translation)
{
    Eigen::AlignedBox3d box;
    for (auto const& x : mesh.vertices) box.extend(x.cast<float>().cast<double>());
    auto const list = [](Vector3d const& x) {
        std::string text = "[";
        text += std::to_string(x.x()) + "," + std::to_string(x.y()) + "," + std::to_string(x.z());
        return text += "]";
    };
    auto const vertex_bytes = std::to_string(mesh.vertices.size() * 12);
    auto const index_bytes = std::to_string(mesh.triangles.size() * 12);
    return R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"translation":)" +
           list(translation) +
           R"(}],"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],)" +
           R"("buffers":[{)" + (buffer_uri.empty() ? "" : "\"uri\":\"" + buffer_uri + "\",") +
           "\"byteLength\":" + std::to_string(mesh.vertices.size() * 12 + mesh.triangles.size() * 12) +
           R"(}],"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":)" + vertex_bytes +
           R"(},{"buffer":0,"byteOffset":)" + vertex_bytes + ",\"byteLength\":" + index_bytes +
           R"(}],"accessors":[{"bufferView":0,"componentType":5126,"type":"VEC3","count":)" +
           std::to_string(mesh.vertices.size()) + ",\"min\":" + list(box.min()) +
           ",\"max\":" + list(box.max()) +
           R"(},{"bufferView":1,"componentType":5125,"type":"SCALAR","count":)" +
           std::to_string(mesh.triangles.size() * 3) + "}]}";
}

inline std::string gltf_buffer(TriangleMesh const& mesh)
{
    std::string text;
    for (auto const& x : mesh.vertices) text += bytes(x);
    for (auto const& triangle : mesh.triangles)
        for (auto const corner : triangle) text += bytes(corner);
    return text;
}

inline std::string glb(TriangleMesh const& mesh, Vector3d const& translation = Vector3d::Zero())
{
    auto json = gltf_json(mesh, "", translation);
    json.resize((json.size() + 3) / 4 * 4, ' ');
    auto const buffer = gltf_buffer(mesh);
    auto const total = std::uint32_t(12 + 8 + json.size() + 8 + buffer.size());
    return "glTF" + bytes(std::uint32_t(2)) + bytes(total) + bytes(std::uint32_t(json.size())) + "JSON" +
           json + bytes(std::uint32_t(buffer.size())) + std::string("BIN\0", 4) + buffer;
}

} // namespace meshes
