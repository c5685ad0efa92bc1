// SPDX-License-Identifier: MIT
// Compiled by architectures.sh, never run.
#include <firn/cuda.hpp>
#include <firn/firn.hpp>

using namespace firn;

void scene(std::vector<Eigen::Vector2d> const& points)
{
    Solver<Cuda, NeoHookean<Space<2, float>>> solver(lattice(0.1));
    solver.add(points, 1e-4);
    solver.advance(0.1, Gravity{}, Obstacle<HalfSpace>{});
}
