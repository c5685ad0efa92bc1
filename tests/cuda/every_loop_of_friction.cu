// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

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
