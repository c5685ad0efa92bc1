// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/io/triangle_mesh.hpp>

#include <assimp/Importer.hpp>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <Eigen/Core>
#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <unordered_map>
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

/// Exact positions as a key; -0 is turned into 0, so that equal positions have equal bits.
struct WeldKey
{
    std::array<std::uint64_t, 3> bits;

    explicit WeldKey(Eigen::Vector3d const& x)
    {
        for (int i = 0; i < 3; ++i) bits[i] = std::bit_cast<std::uint64_t>(x[i] + 0.0);
    }
    bool operator==(WeldKey const&) const = default;
};

struct WeldHash
{
    std::size_t operator()(WeldKey const& key) const
    {
        std::uint64_t hash = 0;
        for (auto const word : key.bits) {
            hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
            hash ^= hash >> 29;
        }
        return hash;
    }
};

/// Collects the triangles of a scene into one mesh, each position once.
class MeshCollector
{
public:
    MeshCollector(MeshPlacement const& placement, std::string path)
        : placement_(placement), path_(std::move(path))
    {}

    void add(aiScene const& scene, aiNode const& node, Eigen::Matrix4d const& parent)
    {
        Eigen::Matrix4d own;
        for (int row = 0; row < 4; ++row)
            for (int column = 0; column < 4; ++column) own(row, column) = node.mTransformation[row][column];
        Eigen::Matrix4d const to_world = parent * own;
        for (unsigned i = 0; i < node.mNumMeshes; ++i) add(*scene.mMeshes[node.mMeshes[i]], to_world);
        for (unsigned i = 0; i < node.mNumChildren; ++i) add(scene, *node.mChildren[i], to_world);
    }

    TriangleMesh mesh;

private:
    void add(aiMesh const& part, Eigen::Matrix4d const& to_world)
    {
        if (!(part.mPrimitiveTypes & aiPrimitiveType_TRIANGLE)) return;
        bool const mirrored = to_world.topLeftCorner<3, 3>().determinant() < 0;
        std::vector<std::uint32_t> index(part.mNumVertices);
        for (unsigned i = 0; i < part.mNumVertices; ++i) {
            auto const& v = part.mVertices[i];
            Eigen::Vector3d const in_file = (to_world * Eigen::Vector4d{v.x, v.y, v.z, 1}).template head<3>();
            if (!all_finite(in_file))
                throw Error{"vertex " + std::to_string(i) + " of mesh part '" + part.mName.C_Str() +
                                "' is not finite",
                            path_, "Repair the file: every coordinate must be a finite number."};
            Eigen::Vector3d const placed =
                placement_.rotation * (placement_.scale * in_file) + placement_.translation;
            if (!all_finite(placed))
                throw Error{"vertex " + std::to_string(i) + " of mesh part '" + part.mName.C_Str() +
                                "' is placed beyond all numbers",
                            path_, "Check the placement's scale and translation [m]."};
            index[i] = weld(placed);
        }
        for (unsigned i = 0; i < part.mNumFaces; ++i) {
            auto const& face = part.mFaces[i];
            if (face.mNumIndices != 3) continue;
            std::array<std::uint32_t, 3> corner{index[face.mIndices[0]], index[face.mIndices[1]],
                                                index[face.mIndices[2]]};
            if (mirrored) std::swap(corner[1], corner[2]);
            bool const collapsed = corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0];
            if (!collapsed) mesh.triangles.push_back(corner);
        }
    }

    std::uint32_t weld(Eigen::Vector3d const& x)
    {
        auto const [at, is_new] =
            known_.try_emplace(WeldKey{x}, static_cast<std::uint32_t>(mesh.vertices.size()));
        if (is_new) mesh.vertices.push_back(x);
        return at->second;
    }

    MeshPlacement placement_;
    std::string path_;
    std::unordered_map<WeldKey, std::uint32_t, WeldHash> known_;
};

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

/// A PLY header may promise more elements than its file can hold, and the importer would reserve their
/// memory; of one without an end it reads what lies behind the file.
inline void check_ply_header(std::filesystem::path const& path, std::uintmax_t file_size)
{
    std::ifstream file(path, std::ios::binary);
    std::string line;
    bool ends = false;
    for (int lines = 0; !ends && lines < 1000 && std::getline(file, line); ++lines) {
        std::istringstream words(line);
        std::string keyword, name, count;
        words >> keyword >> name >> count;
        ends = keyword == "end_header";
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
}

inline void check_mesh_file(std::filesystem::path const& path)
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

    auto extension = path.extension().string();
    for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    constexpr std::array known{".obj", ".stl", ".ply", ".gltf", ".glb"};
    if (std::ranges::find(known, extension) == known.end())
        refuse("this kind of mesh file is not known",
               "Use OBJ, STL, PLY, glTF or GLB; the name's extension tells.");
    if (extension == ".ply") check_ply_header(path, size);
}

} // namespace detail

/// Reads the triangles of an OBJ, STL, PLY, glTF or GLB file (by extension) and places them in the scene [m].
///
/// Node transforms are applied, polygons triangulated, vertices at exactly the same place welded (STL has
/// three for each triangle), triangles that this collapses dropped, and so are lines and points. The surface
/// may still be open or cross itself: `MeshInterior` is what judges that.
///
/// Throws firn::Error: no such file, a folder, unreadable, empty, an unknown extension, what the importer
/// says, no triangles, a vertex that is not finite, a placement that is none.
///
/// For trusted files only: assimp 5.2's importers, the PLY one above all, can crash or hang on a file that
/// was made to do so.
inline TriangleMesh read_mesh(std::filesystem::path const& path, MeshPlacement const& placement = {})
{
    detail::check_placement(placement);
    detail::check_mesh_file(path);

    Assimp::Importer importer;
    auto const* const scene = importer.ReadFile(path.string(), aiProcess_Triangulate | aiProcess_SortByPType |
                                                                   aiProcess_ValidateDataStructure);
    if (!scene || !scene->mRootNode)
        throw Error{std::string{"the mesh file could not be read: "} + importer.GetErrorString(),
                    path.string(),
                    "Check that the file is whole and of the kind its extension says, or export it again."};

    detail::MeshCollector collector(placement, path.string());
    collector.add(*scene, *scene->mRootNode, Eigen::Matrix4d::Identity());
    if (collector.mesh.triangles.empty())
        throw Error{"the file holds no triangles", path.string(),
                    "Export a surface of triangles or polygons; points and lines are not enough."};
    return std::move(collector.mesh);
}

} // namespace firn
