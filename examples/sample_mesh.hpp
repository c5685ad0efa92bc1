// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/shapes/signed_distance_grid.hpp>
#include <firn/io/triangle_mesh.hpp>

#include <Eigen/Core>

#include <cstdint>
#include <string>
#include <vector>

// The one unit of the examples that includes CGAL and assimp (sample_mesh.cpp): 20 s to compile, and GPL.
namespace firn::examples
{

/// How a solid becomes particles.
struct Sampling
{
    int particles = 100000;
    std::string pattern = "lattice"; ///< "lattice" (jittered), "uniform" or "poisson"
    std::uint64_t seed = 1;
    bool repair = false; ///< fill a mesh that is open or broken
};

/// Particles of a solid.
struct Sampled
{
    std::vector<Eigen::Vector3d> points; ///< [m]
    double volume = 0;                   ///< of the solid [m^3]
    double volume_per_point = 0;         ///< [m^3]
    Eigen::Vector3d size{0, 0, 0};       ///< of the solid's bounding box [m]
    bool repaired = false;
    std::string defect; ///< what was repaired
};

/// Reads a mesh file, scaled; throws a firn::Error that names the defect.
TriangleMesh read(std::string const& path, double scale);

/// Fills a closed mesh with particles on all cores; throws a firn::Error that names the defect and the
/// remedy.
Sampled sample(TriangleMesh const& mesh, Sampling const& how);

/// The signed distances of a closed mesh on a grid, `cell_size` [m] apart and up to `margin` [m] around it:
/// an obstacle of its form. Throws a firn::Error that names the defect and the remedy.
SignedDistanceGrid<float, 3> distances_of(TriangleMesh const& mesh, double cell_size, double margin);

} // namespace firn::examples
