// SPDX-License-Identifier: MIT
// The least a program needs in order to step particles; compile_time.cpp times its compilation.
#include <firn/firn.hpp>
#include <firn/openmp.hpp>

int main()
{
    firn::Solver<firn::OpenMP, firn::NeoHookean<firn::Space<3, float>>> solver(firn::lattice(0.02));
    solver.add(std::vector<Eigen::Vector3d>{{0, 1, 0}, {0.01, 1, 0}}, 1e-6);
    solver.advance(1.0 / 24, firn::Gravity{}, firn::Obstacle<firn::HalfSpace>{});
    return solver.positions()[0].y() < 1 ? 0 : 1;
}
