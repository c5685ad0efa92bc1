// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

using namespace firn;
using namespace firn::test;

// Small enough for compute-sanitizer: tests/physics/implicit.cpp looks at what implicit steps find.
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

// See tests/physics/implicit_contact.cpp.
TEST_CASE("a block that slides on a floor is slowed down by friction in implicit steps")
{
    double const h = 0.04, mu = 0.3;
    Solver<Cuda, NeoHookean<Plane>, QuadraticBSpline, Apic, Implicit> block(
        lattice(h), {.density = 1000, .elasticity = lame<double>(1e8, 0.3)});
    auto points = box_of_points<2>({0, 0}, {5 * h, 3 * h}, h);
    for (auto& x : points) x.y() += h / 2;
    block.add(points, h * h / 4, {2, 0});
    Obstacle<HalfSpace> const plane{.contact = Contact::coulomb(mu)};
    double const dt = 5 * h / std::sqrt(block.model().elasticity.p_wave_modulus() / 1000);
    for (int i = 1; i <= 10; ++i) block.step(dt, Gravity{{0, -0.981 * i, 0}}, plane);
    auto const before = block.totals().momentum;
    Eigen::Vector3d received(0, 0, 0);
    for (auto const& report : block.steps(5, dt, Gravity{}, plane)) received += report.reactions[0].impulse;
    CHECK(-received.x() / received.y() == Approx(mu).epsilon(1e-3));
    CHECK(block.totals().momentum.x() - before.x() ==
          Approx(-mu * 9.81 * 5 * dt * block.totals().mass).epsilon(0.1));
}

TEST_CASE("steps are as long as the error of their positions allows, on a device, too")
{
    double const h = 0.1, dt = 0.02;
    Solver<Cuda, NeoHookean<Plane>, QuadraticBSpline, Apic, Implicit> block(
        lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
        {Apic{}, Implicit{.error = 1e-3}});
    block.add(box_of_points<2>({0, 0}, {0.5, 0.5}, h), h * h / 4);
    Obstacle<HalfSpace> const far_below{.contact = Contact::coulomb(0.3), .motion = {.position = {0, -9, 0}}};
    block.step(dt, Gravity{}, far_below);
    CHECK(block.solved().error == Approx(9.81 * dt * dt / 2));
    auto const report = block.advance(0.1, Gravity{}, far_below);
    CHECK(report.limited_by[static_cast<std::size_t>(StepLimit::accuracy)] > 3);
    CHECK(block.solved().error < 2e-3);
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
