// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/column.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/force.hpp>
#include <firn/effects/local_damping.hpp>
#include <firn/settle.hpp>

#include <algorithm>
#include <limits>

using namespace firn;
using namespace firn::test;

namespace
{

using SceneType = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
using FlipScene = Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>;

/// A column between slippery walls is brought to rest under its own weight.
template <class Type, class... Dampings>
SettleReport load(Column<Type>& column, Settling const& how, Dampings const&... dampings)
{
    return settle(column.solver, how, Gravity{}, dampings..., ReflectingWall{.axis = 0},
                  ReflectingWall{.axis = 0, .node = 2, .side = -1}, ReflectingWall{.axis = 1});
}

} // namespace

TEST_CASE("a column settles under its weight: stress and height are those of equilibrium")
{
    Column<SceneType> column(16);
    double const c = std::sqrt(double(column.solver.model().elasticity.p_wave_modulus()) / 1000);
    auto const report = load(column, {.rate = M_PI * c, .share = 1e-8, .longest = 10});
    CHECK(report.is_at_rest);
    CHECK(report.kinetic <= 1e-8 * report.largest_kinetic);
    CHECK(column.solver.time() < 10);
    column.observe(0);
    CHECK(column.error() <= 6e-3); // of the foot's stress, with 16 cells
    Column<SceneType> damped(16);  // for twelve periods
    damped.advance(0);
    damped.observe(0);
    CHECK(column.error() == Approx(damped.error()).margin(1e-4));
    CHECK(column.tip() == Approx(damped.tip()).epsilon(1e-3));
    // sigma = -rho g (H - Y) = M e for small strains: the top sinks by rho g H^2 / 2 M
    double const sunk = 1000 * 9.81 / (2 * 1000 * c * c);
    CHECK(-column.tip() == Approx(sunk).epsilon(0.06)); // strains are 7 per cent at the foot

    // too little damping: it swings for long, and a turning point is not taken for rest
    Column<SceneType> swinging(16);
    auto const late = load(swinging, {.rate = 0.1 * M_PI * c, .share = 1e-4, .longest = 30});
    CHECK(late.is_at_rest);
    CHECK(late.kinetic <= 1e-4 * late.largest_kinetic);
    CHECK(late.steps.substeps > 3 * report.steps.substeps);
    // at rest already
    auto const again =
        load(column, {.rate = M_PI * c, .longest = 10, .least = 1e-6 * report.largest_kinetic});
    CHECK(again.is_at_rest);
    CHECK(again.steps.substeps < report.steps.substeps);

    Column<SceneType> other(16);
    auto const too_short = load(other, {.rate = M_PI * c, .share = 1e-8, .longest = 0.05});
    CHECK(!too_short.is_at_rest);
    CHECK(other.solver.time() == Approx(0.05));
}

TEST_CASE(
    "local damping brings a column to the same rest as damping of velocities, and slows a fall by its share")
{
    Settling how{.share = 1e-6, .longest = 20};
    Column<FlipScene> damped(16), local(16);
    double const c = std::sqrt(double(local.solver.model().elasticity.p_wave_modulus()) / 1000);
    how.rate = M_PI * c;
    auto const by_velocity = load(damped, how), by_force = load(local, how, LocalDamping{0.8});
    CHECK(by_velocity.is_at_rest);
    CHECK(by_force.is_at_rest);
    local.observe(0);
    damped.observe(0);
    CHECK(local.error() <= 6e-3);
    CHECK(local.tip() == Approx(damped.tip()).epsilon(1e-3));
    // more steps than with the best rate of damping, fewer than with one three times as large
    CHECK(by_force.steps.substeps > by_velocity.steps.substeps);
    Column<FlipScene> creeping(16);
    CHECK(by_force.steps.substeps <
          load(creeping, {.rate = 3 * how.rate, .share = 1e-6, .longest = 20}).steps.substeps);

    FlipScene::Solver falling(lattice(0.1));
    falling.add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.1), 0.0025, {0, -1});
    auto const report = falling.advance(0.1, Gravity{}, LocalDamping{0.25});
    auto const v = falling.download<Velocity>();
    for (auto const& of : v)
        CHECK((of - Eigen::Vector2d(0, -1 - 0.75 * 9.81 * report.time_of_forces)).norm() <= 1e-12);
    auto const braking = falling.advance(0.1, Gravity{{0, 4, 0}}, LocalDamping{0.25});
    CHECK(falling.download<Velocity>()[0].y() ==
          Approx(v[0].y() + 1.25 * 4 * braking.time_of_forces).epsilon(1e-12));
}

TEST_CASE("a force accelerates what is inside its region, and only that")
{
    double const h = 0.05;
    SceneType::Solver solver(lattice(h));
    auto const inside = box_of_points<2>({0.2, 0.2}, {0.4, 0.4}, h),
               outside = box_of_points<2>({2, 0}, {2.2, 0.2}, h),
               half = box_of_points<2>({0.7, 0.2}, {1.3, 0.4}, h);
    for (auto const& points : {inside, outside, half}) solver.add(points, h * h / 4);
    // it ends at x = 1, in the middle of the third block
    Force<Box> const wind{.shape = {{1, 1, 1}}, .acceleration = {0, 3, 0}};
    double time = 0;
    for (int i = 0; i < 20; ++i) time += solver.step(1e-4, wind).time_of_forces;
    auto const v = solver.download<Velocity>();
    auto const mean = [&](std::size_t first, std::size_t count) {
        Eigen::Vector2d sum(0, 0);
        for (std::size_t i = first; i < first + count; ++i) sum += v[i];
        return Eigen::Vector2d(sum / double(count));
    };
    CHECK((mean(0, inside.size()) - Eigen::Vector2d(0, 3 * time)).norm() <= 1e-12);
    CHECK(mean(inside.size(), outside.size()).norm() == 0);
    CHECK(mean(inside.size() + outside.size(), half.size()).y() == Approx(1.5 * time).epsilon(1e-3));
    CHECK(solver.stable_step(wind) <= std::sqrt(0.5 * h / 3));

    // a region that moves is where it is in the middle of the step
    SceneType::Solver other(lattice(h));
    other.add(inside, h * h / 4);
    Force<Box> passing = wind;
    passing.motion = {.position = {10, 0, 0}, .velocity = {-1, 0, 0}, .time = 0};
    other.step(1e-4, passing);
    CHECK(other.download<Velocity>()[0].norm() == 0);
    passing.motion.time = -10;
    other.step(1e-4, passing);
    CHECK(other.download<Velocity>()[0].y() > 0);
}

TEST_CASE("loads and dampings that make no sense are refused, and nothing changes")
{
    SceneType::Solver solver(lattice(0.1));
    solver.add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.1), 0.0025);
    auto const before = solver.positions();
    double const nan = std::numeric_limits<double>::quiet_NaN();
    Force<Box> const fine{.shape = {{1, 1, 1}}};
    for (int i = 0; i < 3; ++i) {
        Force<Box> wrong = fine;
        if (i == 0) wrong.acceleration.x() = nan;
        if (i == 1) wrong.acceleration.z() = 1;
        if (i == 2) wrong.shape.half_extents.x() = -1;
        refused([&] { solver.step(1e-4, wrong); });
    }
    for (double const rate : {-1.0, nan}) refused([&] { solver.step(1e-4, Damping{rate}); });
    FlipScene::Solver other(lattice(0.1));
    other.add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.1), 0.0025);
    for (double const share : {-0.1, 1.0, nan}) refused([&] { other.step(1e-4, LocalDamping{share}); });
    CHECK(other.time() == 0);
    Settling const good{.rate = 1, .longest = 1};
    for (int i = 0; i < 7; ++i) {
        Settling wrong = good;
        if (i == 0) wrong.rate = 0;
        if (i == 1) wrong.rate = nan;
        if (i == 2) wrong.share = 1;
        if (i == 3) wrong.share = nan;
        if (i == 4) wrong.longest = std::numeric_limits<double>::infinity();
        if (i == 5) wrong.between = -1;
        if (i == 6) wrong.least = nan;
        refused([&] { settle(solver, wrong); });
    }
    CHECK((solver.positions() == before));
    CHECK(solver.time() == 0);
}
