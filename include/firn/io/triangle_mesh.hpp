// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace firn
{

/// Where a mesh's vertices and triangles are in the file that it was read from, so that errors can say so.
///
/// It describes a mesh with vertices and triangles as `read_mesh` returned them; vertices may have been moved
/// since. If their number differs from the one here, errors tell the place in the scene alone. After a
/// reordering, reset `TriangleMesh::source`.
struct MeshSource
{
    /// A face of the file, which has become one or more triangles.
    struct Face
    {
        std::uint32_t part = 0;   ///< index into `parts`
        std::uint32_t number = 0; ///< OBJ: from 1 through the file; otherwise from 0 in its part
        std::uint32_t line = 0;   ///< from 1; 0 where it is not known
    };

    std::string file;                      ///< its path
    std::vector<Eigen::Vector3d> vertices; ///< the file's coordinates of the mesh's vertices, in its units
    std::vector<Face> faces;               ///< the face of each triangle
    std::vector<std::string> parts; ///< names of the objects, groups or meshes in the file; may be empty
};

/// A triangle surface: positions [m] and, per triangle, three indices into them (counter-clockwise from
/// outside).
struct TriangleMesh
{
    std::vector<Eigen::Vector3d> vertices;
    std::vector<std::array<std::uint32_t, 3>> triangles;
    std::shared_ptr<MeshSource const> source{}; ///< null for a mesh that was not read from a file
};

} // namespace firn
