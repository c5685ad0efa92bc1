// SPDX-License-Identifier: MIT
#include "sample_mesh.hpp"

#include <firn/io/read_mesh.hpp>
#include <firn/openmp.hpp>
#include <firn/sampling/distance_from_mesh.hpp>
#include <firn/sampling/mesh_interior.hpp>
#include <firn/sampling/points.hpp>

namespace firn::examples
{

TriangleMesh read(std::string const& path, double scale) { return read_mesh(path, {.scale = scale}); }

Sampled sample(TriangleMesh const& mesh, Sampling const& how)
{
    OpenMP const loop;
    MeshInterior const solid(mesh, how.repair ? Repair::fill : Repair::none, loop);
    Count const count{how.particles};
    auto points = how.pattern == "uniform"   ? uniform_points(solid, count, how.seed, loop)
                  : how.pattern == "poisson" ? poisson_disk_points(solid, count, how.seed, loop)
                                             : lattice_points(solid, count, 0.5, how.seed, loop);
    return {std::move(points.points), solid.volume(), points.volume_per_point, solid.repaired(),
            solid.defect()};
}

SignedDistanceGrid<float, 3> distances_of(TriangleMesh const& mesh, double cell_size, double margin)
{
    OpenMP const loop;
    return distance_from_mesh(MeshInterior(mesh, Repair::none, loop), cell_size, margin, loop);
}

} // namespace firn::examples
