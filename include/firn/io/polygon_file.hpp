// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/io/triangle_mesh.hpp>

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// The content of a mesh file as it is, and checks of a file before it is read.
namespace firn::detail
{

/// The polygons of a file, in its own coordinates.
struct PolygonFile
{
    struct Polygon
    {
        std::size_t first = 0, count = 0; ///< of its corners
        MeshSource::Face face;
    };

    std::vector<Eigen::Vector3d> vertices;
    std::vector<std::uint32_t> corners; ///< vertices of all polygons, one polygon after the other
    std::vector<Polygon> polygons;
    std::vector<std::string> parts;

    std::span<std::uint32_t const> corners_of(Polygon const& polygon) const
    {
        return std::span{corners}.subspan(polygon.first, polygon.count);
    }
};

/// "face 12 (line 34) of 'lid'"
inline std::string describe(MeshSource::Face const& face, std::span<std::string const> parts)
{
    std::string text = "face " + std::to_string(face.number);
    if (face.line > 0) text += " (line " + std::to_string(face.line) + ")";
    if (face.part < parts.size() && !parts[face.part].empty()) text += " of '" + parts[face.part] + "'";
    return text;
}

[[noreturn]] inline void refuse_cloud(std::size_t vertices, std::filesystem::path const& path)
{
    throw Error{
        "the file holds no triangles or polygons: " +
            (vertices > 0 ? "it is a point cloud, or lines, of " + std::to_string(vertices) + " vertices"
                          : std::string{"it is empty"}),
        path.string(),
        vertices > 0 ? "Reconstruct a closed surface from the points (Poisson reconstruction in MeshLab "
                       "or CloudCompare), and export that."
                     : "Export a surface of triangles or polygons."};
}

inline std::string lower_extension(std::filesystem::path const& path)
{
    auto extension = path.extension().string();
    for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    return extension;
}

/// What to do with files of a kind that is not read.
inline char const* remedy_for_kind(std::string_view extension)
{
    struct Kind
    {
        char const* extensions;
        char const* remedy;
    };
    constexpr std::array kinds{
        Kind{" .step .stp .iges .igs .brep .x_t .x_b .sat .sldprt .ipt .catpart .f3d .fcstd .3dm ",
             "This is a CAD model of exact surfaces: have the CAD program mesh it, and export STL or OBJ."},
        Kind{" .las .laz .e57 .pcd .xyz .pts .asc .csv ",
             "This is a point cloud: reconstruct a closed surface from it (Poisson reconstruction in MeshLab "
             "or "
             "CloudCompare), and export that as PLY or OBJ."},
        Kind{" .tif .tiff .asc .dem .hgt .png .jpg .jpeg .bmp ",
             "This is a raster: pass heights to firn::HeightField, or make a mesh of it."},
        Kind{" .vtp .vtu .vtk .msh .inp .bdf ", "Export the surface of it as STL, PLY or OBJ."},
    };
    std::string const needle = " " + std::string{extension} + " ";
    if (extension.size() > 1)
        for (auto const& kind : kinds)
            if (std::string_view{kind.extensions}.find(needle) != std::string_view::npos) return kind.remedy;
    return "Use OBJ, STL, PLY, glTF or GLB (Blender opens most other kinds and exports these); the name's "
           "extension tells.";
}

/// The kind of file that first bytes stand for, and the extension of meshes that may begin so.
struct FirstBytes
{
    std::string_view bytes;
    char const* kind;
    char const* extension = "";
};

/// Refuses a file with first bytes of another kind than that of its extension.
inline void check_first_bytes(std::filesystem::path const& path, std::string const& extension)
{
    using namespace std::string_view_literals;
    constexpr std::array known{
        FirstBytes{"\x89PNG"sv, "a PNG image"},
        FirstBytes{"\xff\xd8\xff"sv, "a JPEG image"},
        FirstBytes{"GIF8"sv, "a GIF image"},
        FirstBytes{"II*\0"sv, "a TIFF image"},
        FirstBytes{"MM\0*"sv, "a TIFF image"},
        FirstBytes{"%PDF"sv, "a PDF document"},
        FirstBytes{"PK\x03\x04"sv, "a ZIP archive, as 3MF and USDZ files are"},
        FirstBytes{"\x1f\x8b"sv, "compressed by gzip"},
        FirstBytes{"7z\xbc\xaf"sv, "a 7z archive"},
        FirstBytes{"Kaydara FBX"sv, "an FBX file"},
        FirstBytes{"; FBX"sv, "an FBX file"},
        FirstBytes{"ISO-10303-21"sv, "a STEP file"},
        FirstBytes{"BLENDER"sv, "a Blender file"},
        FirstBytes{"PXR-USDC"sv, "a USD file"},
        FirstBytes{"#usda"sv, "a USD file"},
        FirstBytes{"LASF"sv, "a LAS point cloud"},
        FirstBytes{"# .PCD"sv, "a PCD point cloud"},
        FirstBytes{"# vtk"sv, "a VTK file"},
        FirstBytes{"OFF\n"sv, "an OFF file"},
        FirstBytes{"<"sv, "an XML or HTML document"},
        FirstBytes{"version https://git-lfs"sv, "a pointer of Git LFS, which has not fetched the file"},
        FirstBytes{"{"sv, "a JSON document", ".gltf"},
        FirstBytes{"glTF"sv, "a GLB file", ".glb"},
        FirstBytes{"ply\n"sv, "a PLY file", ".ply"},
        FirstBytes{"ply\r"sv, "a PLY file", ".ply"},
        FirstBytes{"solid "sv, "an STL file", ".stl"},
    };
    std::string begin(64, '\0');
    std::ifstream file(path, std::ios::binary);
    file.read(begin.data(), static_cast<std::streamsize>(begin.size()));
    begin.resize(static_cast<std::size_t>(file.gcount()));
    char const* kind = nullptr;
    bool named = false;
    for (auto const& other : known)
        if (begin.starts_with(other.bytes)) {
            kind = other.kind;
            named = other.extension == extension;
        }
    bool const begins_as_its_kind =
        named || extension == ".obj" || extension == ".stl" || extension == ".gltf";
    if ((kind && !named) || !begins_as_its_kind)
        throw Error{kind ? "the file is not what its name says: it is " + std::string{kind}
                         : "the file does not begin as a " + extension.substr(1) + " file does",
                    path.string(), "Export the mesh as OBJ, STL, PLY, glTF or GLB, with that extension."};
}

} // namespace firn::detail
