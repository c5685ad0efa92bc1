// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/io/cut_polygon.hpp>
#include <firn/io/polygon_file.hpp>
#include <firn/io/read_obj.hpp>
#include <firn/io/triangle_mesh.hpp>
#include <firn/io/weld.hpp>

#include <assimp/Importer.hpp>
#include <assimp/scene.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace firn
{

/// Where a mesh file is put in the scene: x = rotation · (scale · file coordinates) + translation.
///
/// OBJ, STL and PLY files carry no unit: `scale` is the metres per file unit (0.001 for millimetres).
struct MeshPlacement
{
    double scale = 1;                                       ///< metres per file unit, above 0
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity(); ///< a proper rotation
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();  ///< [m]
};

namespace detail
{

/// Reads the polygons of a file that assimp reads, in single precision. Node transforms are applied.
class AssimpReader
{
public:
    explicit AssimpReader(std::filesystem::path const& path) : path_(path) {}

    /// `exact`: the file itself holds its coordinates in single precision.
    PolygonFile read(bool exact)
    {
        Assimp::Importer importer;
        // No validation: it would refuse a mesh without faces with other words.
        auto const* const scene = importer.ReadFile(path_.string(), 0);
        if (!scene || !scene->mRootNode)
            throw Error{
                std::string{"the mesh file could not be read: "} + importer.GetErrorString(), path_.string(),
                "Check that the file is whole and of the kind its extension says, or export it again."};
        add(*scene, *scene->mRootNode, Eigen::Matrix4d::Identity());
        if (!file_.polygons.empty()) check_precision(exact && !moved_);
        return std::move(file_);
    }

private:
    void add(aiScene const& scene, aiNode const& node, Eigen::Matrix4d const& parent)
    {
        Eigen::Matrix4d own;
        for (unsigned row = 0; row < 4; ++row)
            for (unsigned column = 0; column < 4; ++column)
                own(row, column) = node.mTransformation[row][column];
        Eigen::Matrix4d const to_world = parent * own;
        for (unsigned i = 0; i < node.mNumMeshes; ++i)
            if (node.mMeshes[i] < scene.mNumMeshes) add(*scene.mMeshes[node.mMeshes[i]], to_world);
        for (unsigned i = 0; i < node.mNumChildren; ++i) add(scene, *node.mChildren[i], to_world);
    }

    void add(aiMesh const& part, Eigen::Matrix4d const& to_world)
    {
        Eigen::Matrix3d const linear = to_world.topLeftCorner<3, 3>();
        Eigen::Vector3d const shift = to_world.topRightCorner<3, 1>();
        moved_ = moved_ || to_world != Eigen::Matrix4d::Identity();
        bool const mirrored = linear.determinant() < 0;
        auto const base = static_cast<std::uint32_t>(file_.vertices.size());
        auto const name = static_cast<std::uint32_t>(file_.parts.size());
        file_.parts.emplace_back(part.mName.C_Str());
        for (unsigned i = 0; i < part.mNumVertices; ++i) {
            auto const& v = part.mVertices[i];
            Eigen::Vector3d const in_part{v.x, v.y, v.z}, in_file = linear * in_part + shift;
            if (!all_finite(in_file))
                throw Error{"vertex " + std::to_string(i) + " of mesh part '" + part.mName.C_Str() +
                                "' is not finite",
                            path_.string(), "Repair the file: every coordinate must be a finite number."};
            file_.vertices.push_back(in_file);
        }
        for (unsigned i = 0; i < part.mNumFaces; ++i) {
            auto const& face = part.mFaces[i];
            if (face.mNumIndices < 3) continue; // a point or a line
            file_.polygons.push_back({file_.corners.size(), face.mNumIndices, {name, i, 0}});
            for (unsigned k = 0; k < face.mNumIndices; ++k) {
                auto const corner = face.mIndices[mirrored ? face.mNumIndices - 1 - k : k];
                if (corner >= part.mNumVertices)
                    throw Error{describe(file_.polygons.back().face, file_.parts) + " names vertex " +
                                    std::to_string(corner) + " of " + std::to_string(part.mNumVertices),
                                path_.string(), "The file is damaged: export it again."};
                file_.corners.push_back(base + corner);
                // vertices that belong to no face say nothing about the surface
                Eigen::Vector3d const& in_file = file_.vertices[base + corner];
                auto const& v = part.mVertices[corner];
                box_.extend(in_file);
                largest_ =
                    std::max({largest_, in_file.cwiseAbs().maxCoeff(), shift.cwiseAbs().maxCoeff(),
                              (linear.cwiseAbs() * Eigen::Vector3d(v.x, v.y, v.z).cwiseAbs()).maxCoeff()});
            }
        }
    }

    /// Refuses a mesh so far from its origin that single precision does not tell its corners apart.
    void check_precision(bool exact) const
    {
        double const extent = box_.sizes().maxCoeff();
        auto const largest = static_cast<float>(largest_);
        double const spacing = std::nextafter(largest, std::numeric_limits<float>::infinity()) - largest;
        // Coordinates that the file holds in single precision are read exactly, but may not be accurate
        // themselves.
        double const wanted = exact ? 1e3 : 1e5;
        if (exactly_equal(extent, 0) || extent >= wanted * spacing) return;
        std::ostringstream what;
        what << "the mesh measures " << extent << " in the file's units but lies " << largest_
             << " from its origin, where single precision tells only multiples of " << spacing
             << (exact ? " apart, and the file holds no more than that" : " apart");
        throw Error{what.str(), path_.string(),
                    "Move the mesh to its origin before it is exported, and give the place as "
                    "MeshPlacement::translation. Or export OBJ, which is read in double precision."};
    }

    std::filesystem::path path_;
    PolygonFile file_;
    Eigen::AlignedBox3d box_;
    double largest_ = 0; ///< of all numbers that were added up to coordinates
    bool moved_ = false;
};

/// Cuts a file's polygons into triangles and puts them in place, each position once.
inline TriangleMesh placed(PolygonFile const& file, MeshPlacement const& placement,
                           std::filesystem::path const& path)
{
    TriangleMesh mesh;
    auto source = std::make_shared<MeshSource>();
    source->file = path.string();
    source->parts = file.parts;
    constexpr auto unseen = ~std::uint32_t(0);
    std::vector<std::uint32_t> index(file.vertices.size(), unseen);
    Weld weld;
    auto const index_of = [&](std::uint32_t vertex) {
        auto& known = index[vertex];
        if (known != unseen) return known;
        Eigen::Vector3d const& x = file.vertices[vertex];
        Eigen::Vector3d const there = placement.rotation * (placement.scale * x) + placement.translation;
        if (!all_finite(there))
            throw Error{"vertex " + std::to_string(vertex) + ", counted from 0, is placed beyond all numbers",
                        path.string(), "Check the placement's scale and translation [m]."};
        known = weld(there);
        if (known == mesh.vertices.size()) {
            mesh.vertices.push_back(there);
            source->vertices.push_back(x);
        }
        return known;
    };
    PolygonCutter cut;
    std::vector<Eigen::Vector3d> polygon;
    for (auto const& face : file.polygons) {
        auto const corners = file.corners_of(face);
        polygon.clear();
        for (auto const corner : corners) polygon.push_back(file.vertices[corner]);
        for (auto const& [i, j, k] : cut(polygon)) {
            std::array const corner{index_of(corners[i]), index_of(corners[j]), index_of(corners[k])};
            if (corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0]) continue;
            mesh.triangles.push_back(corner);
            source->faces.push_back(face.face);
        }
    }
    mesh.source = std::move(source);
    return mesh;
}

inline void check_placement(MeshPlacement const& placement)
{
    require(is_finite(placement.scale) && placement.scale > 0,
            "the mesh's scale is not a finite number above 0", "read_mesh",
            "Pass a finite scale above 0: the metres per unit of the file.");
    require(all_finite(placement.translation), "the mesh's translation is not finite", "read_mesh",
            "Pass finite coordinates [m].");
    auto const& R = placement.rotation;
    bool const proper = all_finite(R) && (R * R.transpose()).isIdentity(1e-6) && R.determinant() > 0;
    require(proper, "the mesh's rotation is not a rotation matrix", "read_mesh",
            "Pass an orthonormal matrix of determinant 1; scale the mesh by `scale`.");
}

/// Refuses PLY headers that the importer fails on: of more elements than the file can hold, it would reserve
/// their memory; of one without an end, it reads beyond the file; of triangle strips, it loses triangles.
/// Returns whether the file holds numbers of single precision.
inline bool check_ply_header(std::filesystem::path const& path, std::uintmax_t file_size)
{
    std::ifstream file(path, std::ios::binary);
    std::string line;
    bool ends = false, in_single = true;
    for (int lines = 0; !ends && lines < 1000 && std::getline(file, line); ++lines) {
        std::istringstream words(line);
        std::string keyword, name, count;
        words >> keyword >> name >> count;
        ends = keyword == "end_header";
        if ((keyword == "format" && name == "ascii") ||
            (keyword == "property" && (name == "double" || name == "float64")))
            in_single = false;
        if (keyword == "element" && name == "tristrips" && count != "0")
            throw Error{"the PLY file holds triangle strips, which are not read", path.string(),
                        "Export it with faces."};
        if (keyword != "element") continue;
        bool const is_number =
            !count.empty() && std::ranges::all_of(count, [](unsigned char c) { return std::isdigit(c); });
        if (!is_number || count.size() > 18 || std::stoull(count) > file_size)
            throw Error{"the PLY header promises '" + line + "', which the file is too short to hold",
                        path.string(), "The file is damaged or truncated: export it again."};
    }
    if (!ends)
        throw Error{"the PLY header has no end", path.string(),
                    "The file is damaged or truncated: export it again."};
    return in_single;
}

/// Refuses files that are no mesh files; returns the extension, which tells the kind.
inline std::string check_mesh_file(std::filesystem::path const& path)
{
    namespace fs = std::filesystem;
    auto const refuse = [&](char const* what, char const* remedy) {
        throw Error{what, path.string(), remedy};
    };
    std::error_code failed;
    auto const status = fs::status(path, failed);
    if (!fs::exists(status)) refuse("there is no such mesh file", "Check the path and the working folder.");
    if (!fs::is_regular_file(status))
        refuse("this is not a file", "Pass the path of a mesh file, not of a folder.");
    auto const size = fs::file_size(path, failed);
    if (failed || !std::ifstream(path))
        refuse("the mesh file cannot be read", "Check the file's permissions.");
    if (size == 0) refuse("the mesh file is empty", "Export the mesh again.");

    auto const extension = lower_extension(path);
    constexpr std::array known{".obj", ".stl", ".ply", ".gltf", ".glb"};
    if (std::ranges::find(known, extension) == known.end())
        refuse("this kind of mesh file is not known", remedy_for_kind(extension));
    check_first_bytes(path, extension);
    return extension;
}

/// Refuses files that are no STL files, since the importer does not say why. Returns whether it is a binary
/// one.
inline bool check_stl(std::filesystem::path const& path, std::uintmax_t size)
{
    std::ifstream file(path, std::ios::binary);
    std::string start(4096, '\0');
    file.read(start.data(), std::streamsize(start.size()));
    start.resize(std::size_t(file.gcount()));
    std::uint32_t triangles = 0; // of a binary file
    for (std::size_t i = 84; start.size() >= 84 && i > 80; --i)
        triangles = triangles << 8 | static_cast<unsigned char>(start[i - 1]);
    auto const promised = 84 + 50 * std::uintmax_t(triangles);
    if (start.size() >= 84 && size == promised) return true;
    if (start.starts_with("solid") &&
        (start.find("facet") != std::string::npos || start.find("endsolid") != std::string::npos))
        return false;
    bool const is_text = std::ranges::none_of(start, [](char c) { return c == '\0'; });
    if (is_text || start.size() < 84)
        throw Error{"this is neither an ASCII STL file, which begins with 'solid' and has a 'facet', nor a "
                    "binary one",
                    path.string(), "Export it again, or give it the extension of its kind."};
    throw Error{"its header promises " + std::to_string(triangles) + " triangles, which are " +
                    std::to_string(promised) + " bytes, and the file has " + std::to_string(size),
                path.string(), "The file is damaged or truncated: export it again."};
}

/// Whether a file of this kind, which is not OBJ, holds its coordinates in single precision.
inline bool holds_single_precision(std::filesystem::path const& path, std::string const& extension)
{
    auto const size = std::filesystem::file_size(path);
    if (extension == ".ply") return check_ply_header(path, size);
    return extension != ".stl" || check_stl(path, size); // glTF knows no other
}

} // namespace detail

/// Reads the triangles of an OBJ, STL, PLY, glTF or GLB file (by extension) and places them in the scene [m].
///
/// Node transforms are applied, and vertices at exactly the same place are welded (STL has three for each
/// triangle). Polygons are cut into triangles, whether their corners are convex, concave or straight and
/// whether or not doubled edges connect holes with their outline. Triangles that collapse are dropped, and so
/// are lines and points. The surface may still be open or cross itself: `MeshInterior` checks that.
///
/// OBJ is read in double precision. The other kinds are read in single precision, which is the file's own in
/// glTF, binary STL and most PLY files. Coordinates have a spacing there; a mesh smaller than 1e5 spacings
/// (1e3, if single precision is the file's own) is refused, since it would be bent.
///
/// Throws firn::Error: no such file, a folder, unreadable, empty, an unknown extension, content of another
/// kind, what the importer says, no triangles (a point cloud), a vertex that is not finite, too far from the
/// origin, a placement that is none. It names the file's line, face or vertex where that is known.
///
/// For trusted files only: assimp 5.2's importers, which read all kinds but OBJ, can crash or hang on a file
/// that was made to do so, the PLY one above all.
inline TriangleMesh read_mesh(std::filesystem::path const& path, MeshPlacement const& placement = {})
{
    detail::check_placement(placement);
    auto const extension = detail::check_mesh_file(path);
    auto const file = extension == ".obj"
                          ? detail::ObjReader(path).read()
                          : detail::AssimpReader(path).read(detail::holds_single_precision(path, extension));
    if (file.polygons.empty()) detail::refuse_cloud(file.vertices.size(), path);
    auto mesh = detail::placed(file, placement, path);
    if (mesh.triangles.empty())
        throw Error{"the file holds no triangles: its faces are collapsed", path.string(),
                    "Export a surface of triangles or polygons; points and lines are not enough."};
    return mesh;
}

} // namespace firn
