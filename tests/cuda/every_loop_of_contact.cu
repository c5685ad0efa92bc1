// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>

using namespace firn;
using namespace firn::test;

TEST_CASE("a few steps through the loops of walls, shells, terrain, contact of particles and quarantine")
{
    using Sheet = Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Mls>;
    double const h = 0.1;
    Sheet::Solver solver(lattice(h));
    solver.add(ball_of_points<2>({0.3, 0.33}, 0.2, h), h * h / 4, {-3, -4});
    solver.quarantine(1);
    ReflectingWall const wall{.axis = 0};
    Obstacle<Shell<Box>> const lid{
        .shape = {{{0.2, 0.05, 1}}, 0.02}, .motion = {.position = {0.4, 0.7, 0}}, .on_particles = true};
    HeightField<float, 2> const hills({-1}, 0.25f, {13}, std::vector<float>(13, 0.05f));
    auto const hills_there = hills.on(TestedBackend{});
    Obstacle<std::decay_t<decltype(hills_there)>> const ground{.shape = hills_there, .on_particles = true};
    double const dt = 0.3 * solver.step(1e-6).stable_dt;
    for (int i = 0; i < 3; ++i) solver.step(dt, Gravity{}, wall, lid, ground);
    auto const before = solver.snapshot();
    solver.steps(5, dt, Gravity{}, wall, lid, ground);
    auto const went = solver.positions();
    solver.restore(before);
    solver.steps(5, dt, Gravity{}, wall, lid, ground);
    CHECK(solver.positions() == went);

    auto H = solver.download<DisplacementGradient>();
    H[3](0, 0) = -3; // inside out
    solver.upload<DisplacementGradient>(H);
    CHECK(solver.step(dt, Gravity{}, wall, lid, ground).isolated.size() == 1);
    solver.step(dt, Gravity{}, wall, lid, ground);
    CHECK(solver.size() == went.size() - 1);
}

TEST_CASE("a few steps through the loops of any number of obstacles, of which some act on particles")
{
    using Sheet = Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Mls>;
    double const h = 0.1;
    auto const run = [&](bool together) {
        Sheet::Solver solver(lattice(h));
        solver.add(ball_of_points<2>({0.3, 0.33}, 0.2, h), h * h / 4, {-3, -4});
        Obstacles<Sphere, ActsOn::particles> balls;
        for (int i = 0; i < 5; ++i)
            balls.list.push_back(
                {.shape = {0.08}, .motion = {.position = {0.15 * i, 0.1, 0}}, .on_particles = i % 2 == 0});
        double const dt = 1e-3;
        std::vector<StepReport> reports;
        if (together)
            reports = solver.steps(8, dt, balls);
        else
            for (int i = 0; i < 8; ++i) reports.push_back(solver.step(dt, balls));
        Eigen::Vector3d received(0, 0, 0);
        for (auto const& report : reports)
            for (auto const& reaction : report.reactions) received += reaction.impulse;
        CHECK(received.norm() > 0);
        return std::pair{Eigen::Vector3d(received), solver.positions()};
    };
    CHECK((run(true) == run(false)));
}
