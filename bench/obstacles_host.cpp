// SPDX-License-Identifier: MIT
// The least program with two obstacles: as two arguments or, with FIRN_BENCH_LIST, as a list whose length is
// known at run time. obstacles.sh times its compilation.
#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#if defined(FIRN_BENCH_LIST)
#include <firn/effects/obstacles.hpp>
#endif

int main()
{
    firn::Solver<firn::OpenMP, firn::NeoHookean<firn::Space<3, float>>> solver(firn::lattice(0.02));
    solver.add(std::vector<Eigen::Vector3d>{{0, 1, 0}, {0.01, 1, 0}}, 1e-6);
#if defined(FIRN_BENCH_LIST)
    firn::Obstacles<> const scene{{{.shape = firn::HalfSpace{}}, {.shape = firn::Sphere{0.1}}}};
    solver.advance(1.0 / 24, firn::Gravity{}, scene);
#else
    solver.advance(1.0 / 24, firn::Gravity{}, firn::Obstacle<firn::HalfSpace>{},
                   firn::Obstacle<firn::Sphere>{.shape = {0.1}});
#endif
    return solver.positions()[0].y() < 1 ? 0 : 1;
}
