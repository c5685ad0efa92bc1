// SPDX-License-Identifier: MIT
// Compiled by architectures.sh, never run.
#include <firn/cuda.hpp>
#include <firn/firn.hpp>

using namespace firn;

void in_the_plane(std::vector<Eigen::Vector2d> const& points)
{
    Solver<Cuda, NeoHookean<Space<2, float>>> solver(lattice(0.1));
    solver.add(points, 1e-4);
    solver.advance(0.1, Gravity{}, Obstacle<HalfSpace>{});
}

void in_space(std::vector<Eigen::Vector3d> const& points)
{
    Solver<Cuda, FixedCorotated<Space<3, double>>, CubicBSpline, Flip> solver(lattice(0.1));
    solver.add(points, 1e-4);
    solver.advance(0.1, Gravity{});
}
