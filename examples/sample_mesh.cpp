// SPDX-License-Identifier: MIT
#include "sample_mesh.hpp"

#include <firn/io/read_mesh.hpp>
#include <firn/openmp.hpp>
#include <firn/sampling/distance_from_mesh.hpp>
#include <firn/sampling/mesh_interior.hpp>
#include <firn/sampling/points.hpp>

#include <cstdio>
#include <unistd.h>

namespace firn::examples
{

namespace
{

/// Tells on a terminal how far the filling of a mesh is.
void show_filling(double share)
{
    if (isatty(fileno(stderr)) != 0)
        std::fprintf(stderr, "\rfilling %3.0f %%%s", 100 * share, share < 1 ? "" : "\n");
}

/// The interior of the mesh. Where Repair::fill would help, the error names the option that passes it.
MeshInterior interior(TriangleMesh const& mesh, bool repair, OpenMP const& loop)
{
    if (repair) return MeshInterior(mesh, Repair::fill, loop, show_filling);
    try {
        return MeshInterior(mesh, Repair::none, loop);
    }
    catch (Error const& error) {
        throw Error{error.what_is_wrong(), error.where(),
                    error.remedy() + " (--repair passes Repair::fill.)"};
    }
}

} // namespace

TriangleMesh read(std::string const& path, double scale) { return read_mesh(path, {.scale = scale}); }

Sampled sample(TriangleMesh const& mesh, Sampling const& how)
{
    OpenMP const loop;
    MeshInterior const solid = interior(mesh, how.repair, loop);
    Count const count{how.particles};
    auto points = how.pattern == "uniform"   ? uniform_points(solid, count, how.seed, loop)
                  : how.pattern == "poisson" ? poisson_disk_points(solid, count, how.seed, loop)
                                             : lattice_points(solid, count, 0.5, how.seed, loop);
    return {std::move(points.points),     solid.volume(),   points.volume_per_point,
            solid.bounding_box().sizes(), solid.repaired(), solid.defect()};
}

SignedDistanceGrid<float, 3> distances_of(TriangleMesh const& mesh, double cell_size, double margin)
{
    OpenMP const loop;
    return distance_from_mesh(MeshInterior(mesh, Repair::none, loop), cell_size, margin, loop);
}

} // namespace firn::examples
