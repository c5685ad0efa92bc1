// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

using namespace firn;
using namespace firn::test;

// A column of height 1 m between slippery walls: see tests/physics/implicit.cpp for its height.
TEST_CASE("a body comes to rest in one solve, and stays as it was where there is no state of rest")
{
    double const h = 1.0 / 16;
    Solver<Cuda, NeoHookean<Plane>, QuadraticBSpline, Mls, Implicit> column(
        lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
    column.add(box_of_points<2>({0, 0}, {2 * h, 1}, h), h * h / 4);
    ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = 2, .side = -1}, floor{.axis = 1};
    auto const before = column.positions();
    CHECK_FALSE(refused([&] { column.settle(Gravity{}); }).what_is_wrong().empty());
    CHECK(column.positions() == before);
    auto const report = column.settle(Gravity{}, left, right, floor);
    CHECK(report.load_steps == 1);
    CHECK(report.reactions[2].impulse.y() == Approx(-9810 * 2 * h).epsilon(1e-3));
    std::size_t const top = before.size() - 1;
    double const H = column.download<DisplacementGradient>()[top](1, 1);
    CHECK(before[top].y() - column.positions()[top].y() - H * h / 4 == Approx(0.0348553).epsilon(2e-3));
}

TEST_CASE("a step that is not solved leaves the state, and an implicit scene goes on after it")
{
    double const h = 0.1;
    Solver<Cuda, NeoHookean<Plane>, CubicBSpline, Flip, ImplicitMidpoint> hasty(
        lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
        {Flip{}, ImplicitMidpoint{{.tolerance = 1e-12, .newton = 1}}}); // too few for such a residual
    hasty.add(box_of_points<2>({0, 0}, {0.5, 0.5}, h), h * h / 4);
    auto const before = hasty.positions();
    CHECK_THROWS_AS(hasty.step(0.01, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()}),
                    StepError);
    CHECK_FALSE(hasty.solved().converged);
    CHECK(hasty.positions() == before);
    for (auto const& v : hasty.download<Velocity>()) CHECK(v.norm() < 1e-12);
    hasty.step(1e-9, Gravity{{0, 0, 0}});
    CHECK(hasty.time() == 1e-9);
}
