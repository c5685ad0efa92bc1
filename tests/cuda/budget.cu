// SPDX-License-Identifier: MIT
// Compiled by budget.sh, never run: what the compiler says of these loops is the test.
#include <firn/cuda.hpp>
#include <firn/firn.hpp>

using namespace firn;
using Solid = Space<3, float>;

template <class Model, class Kernel, class Transfer>
void step(std::vector<Eigen::Vector3d> const& points)
{
    Solver<Cuda, Model, Kernel, Transfer> solver(lattice(0.1));
    solver.add(points, 1e-4);
    solver.advance(0.1, Gravity{}, Obstacle<HalfSpace>{});
    solver.step(0.1);
}

void all(std::vector<Eigen::Vector3d> const& points)
{
    step<NeoHookean<Solid>, QuadraticBSpline, Mls>(points);
    step<FixedCorotated<Solid>, QuadraticBSpline, Mls>(points);
    step<Snow<Solid>, QuadraticBSpline, Mls>(points);
    step<Sand<Solid>, QuadraticBSpline, Mls>(points);
    step<CamClay<Solid>, QuadraticBSpline, Mls>(points);
    step<HerschelBulkley<Solid>, QuadraticBSpline, Mls>(points);
    step<Fluid<Solid>, QuadraticBSpline, Mls>(points);
    step<Snow<Solid>, QuadraticBSpline, Flip>(points);
    step<Snow<Solid>, CubicBSpline, Flip>(points);
}
