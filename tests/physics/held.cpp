// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/budget.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/pose_path.hpp>
#include <firn/settle.hpp>

#include <cmath>
#include <limits>

using namespace firn;
using namespace firn::test;

namespace
{

using SceneType = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
using BarSolver = SceneType::Solver;

constexpr std::size_t per_column = 8; ///< particles
constexpr double cell = 1.0 / 16, height = 0.25, modulus = 1e5, density = 1000;

/// A bar from x = 0 to 1 that does not contract across: Poisson's ratio is 0.
BarSolver bar()
{
    NeoHookean<Plane> rubber;
    rubber.density = density;
    rubber.elasticity = lame<double>(modulus, 0);
    BarSolver solver(lattice(cell), rubber);
    solver.add(box_of_points<2>({0, 0}, {1, height}, cell), cell * cell / 4);
    return solver;
}

/// The nodes up to x = 1/8 or from 7/8 on, which are 3/4 apart.
Held<HalfSpace> left() { return {.shape = {{1, 0, 0}}, .motion = {.position = {0.14, 0, 0}}}; }
Held<HalfSpace> right(double speed)
{
    return {.shape = {{-1, 0, 0}},
            .motion = {.position = {0.86, 0, 0}, .velocity = {speed, 0, 0}, .time = 0}};
}

/// The mean axial stress in the middle third.
double stress_in_the_middle(BarSolver const& solver)
{
    auto const x = solver.positions();
    auto const stress = solver.download<Stress>();
    double sum = 0;
    int count = 0;
    for (std::size_t i = 0; i < x.size(); ++i)
        if (std::abs(x[i].x() - 0.5) < 1.0 / 6) sum += stress[i](0, 0), ++count;
    return sum / count;
}

} // namespace

TEST_CASE("what is held along a path is at each of its keys, if the calls end there, and else does not turn")
{
    PosePath path; // up, and down again, within a frame
    path.add(0, {0.5, 0, 0});
    path.add(0.013, {0.5, 0.01, 0});
    path.add(0.027, {0.52, -0.005, 0});
    double const frame = 0.04;
    Held<Box> region{.shape = {{2, 2, 1}}};
    BarSolver solver = bar(), at_once = bar();
    auto const from = solver.positions();
    auto const farthest = [&](BarSolver const& of, Motion const& pose) { // from where the path has it
        auto const x = of.positions();
        double worst = 0;
        for (std::size_t i = 0; i < x.size(); ++i)
            worst =
                std::max(worst, (x[i] - from[i] - (pose.position - path.at(0).position).head<2>()).norm());
        return worst;
    };
    int calls = 0;
    for (double left = frame; left > 0; ++calls) {
        REQUIRE(calls < 3);
        double const part = path.until_key(solver.time(), left);
        region.motion = path.during(solver.time(), part);
        solver.advance(part, region);
        left -= part;
        CHECK(farthest(solver, path.at(solver.time())) <= 1e-12);
    }
    CHECK(calls == 3);
    CHECK(solver.time() == Approx(frame).epsilon(1e-14));
    // one call takes the straight way: at the time of the first key it is not there
    region.motion = path.during(0, frame);
    auto const report =
        at_once.advance(frame, Budget{.cancelled = [&] { return at_once.time() >= 0.013; }}, region);
    CHECK(report.stopped_by == StoppedBy::cancel);
    CHECK(farthest(at_once, path.at(0.013)) > 5e-3);
}

TEST_CASE("a bar that is held at one end and pulled at the other bears E du/L, and the clamps bear it")
{
    BarSolver solver = bar();
    double const c = std::sqrt(modulus / density), pulled = 7.5e-4, time = 4 / c;
    Held<HalfSpace> gripped = right(pulled / time);
    auto const pull = solver.advance(time, Damping{2 * M_PI * c}, left(), gripped);
    gripped.motion = gripped.motion.at(time);
    gripped.motion.velocity.setZero();
    REQUIRE(settle(solver, {.rate = 2 * M_PI * c, .share = 1e-12, .longest = 20 / c}, left(), gripped)
                .is_at_rest);
    auto const rest = solver.advance(0.5 / c, left(), gripped);
    double const on_left = rest.reactions[0].impulse.x() / rest.time_of_forces,
                 on_right = rest.reactions[1].impulse.x() / rest.time_of_forces,
                 stress = stress_in_the_middle(solver), ideal = modulus * pulled / 0.75;
    // E times the strain, between two columns of particles
    auto const x = solver.positions();
    double const strain = (x[22 * per_column].x() - x[10 * per_column].x()) / (12 * cell / 2) - 1;
    CHECK(stress == Approx(modulus * strain).epsilon(2e-3)); // strains are a thousandth
    CHECK(on_left == Approx(stress * height).epsilon(1e-3));
    CHECK(on_right == Approx(-stress * height).epsilon(1e-3));
    // the grid smooths the edge of a clamp, which lengthens the bar by less than half a cell at each end
    CHECK(stress < ideal);
    CHECK(stress > ideal / (1 + cell / 0.75));
    CHECK(pull.reactions[1].impulse.x() < 0);
}

TEST_CASE("a clamp that pulls a bar at a speed v bears rho c v A while the front is under way, its momentum")
{
    BarSolver solver = bar();
    double const c = std::sqrt(modulus / density), v = 0.01;
    auto const begun = solver.advance(0.2 / c, right(v)), later = solver.advance(0.4 / c, right(v));
    double const force = later.reactions[0].impulse.x() / later.time_of_forces;
    CHECK(force == Approx(-density * c * v * height).epsilon(0.01));
    CHECK(solver.totals().momentum.x() ==
          Approx(-begun.reactions[0].impulse.x() - later.reactions[0].impulse.x()).epsilon(1e-12));
}

TEST_CASE(
    "held along one axis material is free along the others, and a velocity may differ from the region's")
{
    BarSolver solver = bar();
    // a roller: free to fall
    Held<Box> const roller{.shape = {{2, 2, 2}}, .axes = {true, false, true}};
    double const fallen = solver.advance(0.01, Gravity{{5, -9.81, 0}}, roller).time_of_forces;
    auto v = solver.download<Velocity>();
    CHECK(std::abs(v[100].x()) <= 1e-15);
    CHECK(v[100].y() == Approx(-9.81 * fallen).epsilon(1e-12));
    // a region that stands still, through which material is driven
    Held<Box> driven{.shape = {{2, 2, 2}}, .velocity = Eigen::Vector3d(0.5, 0.25, 0)};
    double const mass = solver.totals().mass;
    auto const report = solver.advance(0.01, driven);
    v = solver.download<Velocity>();
    CHECK((v[100] - Eigen::Vector2d(0.5, 0.25)).norm() <= 1e-12);
    CHECK(report.reactions[0].impulse.x() == Approx(-0.5 * mass).epsilon(1e-12));
    CHECK(solver.stable_step(driven) <= cell / 0.5);
    // one that turns: rigid motion about its reference point
    driven = {.shape = {{2, 2, 2}}, .motion = {.position = {0.5, 0, 0}, .angular_velocity = {0, 0, 2}}};
    solver.step(1e-4, driven);
    auto const x = solver.positions();
    v = solver.download<Velocity>();
    CHECK((v[100] - 2 * Eigen::Vector2d(-x[100].y(), x[100].x() - 0.5)).norm() <= 1e-3);
}

TEST_CASE("what holds nothing, or has no number for a speed, is refused, and nothing changes")
{
    BarSolver solver = bar();
    auto const before = solver.positions();
    for (int i = 0; i < 6; ++i) {
        Held<Box> wrong{.shape = {{1, 1, 1}}, .velocity = Eigen::Vector3d(0, 0, 0)};
        if (i == 0) wrong.velocity->x() = std::numeric_limits<double>::quiet_NaN();
        if (i == 1) wrong.velocity->y() = 1e16;
        if (i == 2) wrong.velocity->z() = 1;
        if (i == 3) wrong.axes = {false, false, true};
        if (i == 4) wrong.motion.position.x() = std::numeric_limits<double>::infinity();
        if (i == 5) wrong.shape.half_extents.x() = 0;
        refused([&] { solver.step(1e-4, wrong); });
    }
    CHECK((solver.positions() == before));
    CHECK(solver.time() == 0);
}
