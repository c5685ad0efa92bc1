// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

// Small enough for compute-sanitizer: tests/physics/implicit.cpp looks at what implicit steps find. Others
// are in every_loop_of_rest.cu and every_loop_of_friction.cu: nvcc takes minutes for all of them.
TEST_CASE("implicit steps go through every loop, with the same bits in every run")
{
    auto const run = [] {
        double const h = 0.1, volume = h * h * h / 8;
        using Two = Materials<NeoHookean<SolidFloat>, FixedCorotated<SolidFloat>>;
        Solver<Cuda, Two, QuadraticBSpline, Apic, Implicit> solver(
            lattice(h),
            {{.density = 1000, .elasticity = lame<float>(1e6, 0.3)},
             {.density = 1000, .elasticity = lame<float>(1e7, 0.3)}},
            {Apic{}, Implicit{.share = 0.1}});
        solver.add<Material<0>>(box_of_points<3>({0, 0, 0}, {0.5, 0.4, 0.2}, h), volume);
        solver.add<Material<1>>(box_of_points<3>({0, 0.4, 0}, {0.2, 0.6, 0.2}, h), volume, {4, 0, 0});
        Obstacle<HalfSpace> const floor{.contact = Contact::sticky(), .motion = {.position = {0, 0.02, 0}}};
        ReflectingWall const wall{.axis = 2};
        // as long that the upper one changes cells, and coarse grids help
        for (int i = 0; i < 2; ++i) {
            solver.step(0.03, Gravity{}, floor, wall);
            CHECK(solver.solved().converged);
            CHECK(solver.solved().products > 5);
        }
        CHECK(solver.advance(0.02, Gravity{}, floor, wall).substeps > 0);
        return solver.positions();
    };
    auto const once = run();
    CHECK(run() == once);
}
