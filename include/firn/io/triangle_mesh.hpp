// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstdint>
#include <vector>

namespace firn
{

/// A triangle surface: positions [m] and, per triangle, three indices into them (counter-clockwise from
/// outside).
struct TriangleMesh
{
    std::vector<Eigen::Vector3d> vertices;
    std::vector<std::array<std::uint32_t, 3>> triangles;
};

} // namespace firn
