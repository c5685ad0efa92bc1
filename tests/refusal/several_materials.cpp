// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

using Jelly = NeoHookean<Plane>;
using Rubber = FixedCorotated<Plane>;
using Pair = Scene<Materials<Rubber, Jelly>, QuadraticBSpline, Mls>::Solver;
double const not_a_number = std::numeric_limits<double>::quiet_NaN();

/// Two blocks side by side that have already taken a few steps.
Pair running_scene()
{
    Pair solver(lattice(0.1));
    solver.add<Rubber>(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025, {0.1, 0});
    solver.add<Jelly>(box_of_points<2>({0.4, 0}, {0.8, 0.4}, 0.1), 0.0025, {-0.1, 0});
    for (int i = 0; i < 5; ++i) solver.step(1e-3, Gravity{});
    return solver;
}

/// Whether two scenes are in the same state to the last bit.
bool same(Pair const& a, Pair const& b)
{
    return a.time() == b.time() && a.ids() == b.ids() && a.positions() == b.positions() &&
           a.masses() == b.masses() && a.download<Velocity>() == b.download<Velocity>() &&
           a.download<DisplacementGradient>() == b.download<DisplacementGradient>();
}

} // namespace

TEST_CASE("each of several materials is asked whether its parameters make sense")
{
    Jelly light;
    light.density = -1;
    CHECK(refused([&] {
              Pair(lattice(0.1), {Rubber{}, light});
          })
              .remedy()
              .find("kg/m^3") != std::string::npos);
    Rubber soft;
    soft.elasticity.mu = not_a_number;
    refused([&] { Pair(lattice(0.1), {soft, Jelly{}}); });
}

TEST_CASE("bad particles of one material are refused, and nothing changes of either")
{
    auto solver = running_scene();
    auto const untouched = running_scene();
    using Points = std::vector<Eigen::Vector2d>;
    refused([&] { solver.add<Jelly>(Points{{0, 0}, {not_a_number, 0}}, 1e-3); });
    refused([&] { solver.add<Rubber>(Points{{0, 0}}, -1); });
    refused([&] { solver.add<Rubber>(Points{{0, 0}}, 1e-3, {0, not_a_number}); });
    refused([&] { solver.add<Jelly>(Points{{0, 0}}, 1e-25); }); // far lighter than those of the other one
    refused([&] { solver.add<Jelly>(Points{{0, 0}}, 1e25); });
    refused([&] { solver.upload<Velocity, Jelly>({{1, 0}}); });
    refused([&] {
        solver.upload<Velocity, Rubber>(
            std::vector<Eigen::Vector2d>(solver.size<Rubber>(), {0, not_a_number}));
    });
    CHECK(same(solver, untouched));
    CHECK(solver.add<Jelly>(Points{{0, 3}}, 1e-3) == untouched.size()); // no id was spent
}

TEST_CASE("a drain that makes no sense is refused, and removes no particle")
{
    auto solver = running_scene();
    auto const untouched = running_scene();
    refused([&] { solver.remove_if(Inside<Sphere>{.shape = {-1}}); });
    refused([&] { solver.remove_if<Jelly>(Outside<Box>{.shape = {{1, 0, 1}}}); });
    for (int axis = 0; axis < 3; ++axis) {
        Motion nowhere, hurled;
        nowhere.position[axis] = not_a_number;
        hurled.angular_velocity[axis] = 1e160; // its square is no number
        refused([&] { solver.remove_if(Inside<Sphere>{.pose = nowhere}); });
        refused([&] { solver.remove_if(Outside<Sphere>{.shape = {5}, .pose = nowhere}); });
        refused([&] { solver.step(1e-4, Obstacle<HalfSpace>{.motion = nowhere}); });
        refused([&] { solver.step(1e-4, Obstacle<HalfSpace>{.motion = hurled}); });
    }
    CHECK(same(solver, untouched));
}

TEST_CASE("where no particle is left, particles of any mass may come")
{
    auto solver = running_scene();
    refused([&] {
        solver.add<Jelly>(std::vector<Eigen::Vector2d>{{0, 3}}, 1e-27);
    }); // beside the others it would be lost
    solver.remove_if(Inside<Sphere>{.shape = {1e6}});
    REQUIRE(solver.size() == 0);
    solver.add<Jelly>(std::vector<Eigen::Vector2d>{{0, 3}}, 1e-27);
    solver.step(1e-6, Gravity{});
    CHECK(solver.masses()[0] > 0);
    CHECK(solver.masses()[0] < 1e-20);
}

TEST_CASE("a material of which nothing is there bounds no step")
{
    Fluid<Plane> honey;
    honey.viscosity = 1e4;
    using Both = Scene<Materials<Jelly, Fluid<Plane>>, QuadraticBSpline, Mls>::Solver;
    Both scene(lattice(0.1), {Jelly{}, honey});
    scene.add<Jelly>(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025);
    Scene<Jelly, QuadraticBSpline, Mls>::Solver jelly(lattice(0.1));
    jelly.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025);
    CHECK(scene.advance(0.1, Gravity{}).substeps == jelly.advance(0.1, Gravity{}).substeps);
    scene.add<Fluid<Plane>>(box_of_points<2>({2, 0}, {2.4, 0.4}, 0.1), 0.0025);
    auto const report = scene.advance(1e-2, Gravity{});
    CHECK(report.limited_by[int(StepLimit::viscosity)] > 5);
    scene.remove_if<Fluid<Plane>>(Outside<Sphere>{.shape = {1e-6}});
    CHECK(scene.bounds().material == 0); // that of the remaining material
    CHECK(scene.step(1e-6).stable_dt < 1.05 * jelly.step(1e-6).stable_dt);
    CHECK(scene.advance(1e-2, Gravity{}).limited_by[int(StepLimit::viscosity)] == 0);

    // and particles that are isolated in the middle of several steps
    using Reversed = Scene<Materials<Fluid<Plane>, Jelly>, QuadraticBSpline, Mls>::Solver;
    Reversed steps(lattice(0.1), {honey, Jelly{}});
    steps.add<Fluid<Plane>>(std::vector<Eigen::Vector2d>{{5, 0}}, 0.0025);
    steps.add<Jelly>(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025);
    steps.upload<Velocity, Fluid<Plane>>({{1e7, 0}});
    steps.quarantine(1);
    auto const reports = steps.steps(3, 1e-5);
    REQUIRE(reports[0].isolated.size() == 1);
    CHECK(steps.bounds().material == 1);
    CHECK(reports[2].stable_dt < 1.05 * jelly.step(1e-6).stable_dt);
}

TEST_CASE("a step of two materials that goes wrong names the material and its particle, and changes nothing")
{
    auto solver = running_scene();
    auto const untouched = running_scene();
    auto const error = refused([&] { solver.step(100.0, Gravity{}); });
    CHECK(error.what_is_wrong().find("particle ") == 0);
    CHECK(error.what_is_wrong().find("(material 0)") != std::string::npos);
    CHECK(same(solver, untouched));
    solver.step(1e-3, Gravity{});
    CHECK(solver.time() > untouched.time());

    auto H = std::vector<Eigen::Matrix2d>(solver.size<Jelly>(), Eigen::Matrix2d::Zero());
    H[17](0, 0) = -1.5; // det F = -0.5: rubber would bear it
    solver.upload<DisplacementGradient, Jelly>(H);
    std::string const id = std::to_string(solver.size<Rubber>() + 17);
    auto const inverted = refused([&] { solver.advance(0.01); });
    CHECK(inverted.what_is_wrong().find("particle " + id + " of neo_hookean (material 1) was turned") == 0);
}

TEST_CASE("two bodies hurled at a wall take rejected steps, repeat them shorter, and lose nothing")
{
    double const speed = 60, mass = 0.09 * 1000;
    Pair solver(lattice(0.05), {}, {}, {.deformation = 0.09, .rejection = 0.1});
    auto const box = box_of_points<2>({0, 0.1}, {0.3, 0.4}, 0.05);
    auto above = box;
    for (auto& x : above) x.y() += 0.3;
    solver.add<Rubber>(box, 0.025 * 0.025, {0, -speed});
    solver.add<Jelly>(above, 0.025 * 0.025, {0, -speed});
    auto const report = solver.advance(0.01, Obstacle<HalfSpace>{});
    CHECK(report.rejected > 0);
    CHECK(report.lost == 0);
    for (auto const& x : solver.positions()) CHECK(x.allFinite());
    double const expected = -speed * 2 * mass - report.reactions[0].impulse.y();
    CHECK(std::abs(Totals(solver).momentum.y() - expected) < 1e-10 * speed * 2 * mass);
    CHECK(Totals(solver).mass == Approx(2 * mass));
}

TEST_CASE("a run of two materials that ends in a failed step leaves the last good state of both")
{
    double const speed = 60;
    Pair solver(lattice(0.05), {}, {}, {.deformation = 0.09, .rejection = 0.1, .retries = 0});
    auto const box = box_of_points<2>({0, 0.1}, {0.3, 0.4}, 0.05);
    auto above = box;
    for (auto& x : above) x.y() += 0.3;
    solver.add<Rubber>(box, 0.025 * 0.025, {0, -speed});
    solver.add<Jelly>(above, 0.025 * 0.025, {0, -speed});
    refused([&] { solver.advance(0.02, Obstacle<HalfSpace>{}); });
    CHECK(solver.time() > 0);
    auto const x = solver.positions();
    auto const v = solver.download<Velocity>();
    for (std::size_t i = 0; i < x.size(); ++i) {
        CHECK(x[i].allFinite());
        if (x[i].y() > 0.3) CHECK(std::abs(v[i].y() + speed) < 1e-6 * speed); // above the shock
    }
    auto const before = Totals(solver);
    solver.step(1e-6);
    CHECK((Totals(solver).momentum - before.momentum).norm() < 1e-12 * before.momentum.norm());
}

TEST_CASE("particles of several materials are taken out, and all others are as if they had been removed")
{
    auto isolates = running_scene(), removes = running_scene();
    isolates.quarantine(2);
    auto const rubber = static_cast<std::uint32_t>(isolates.size<Rubber>());
    auto const spoil = [](Pair& solver, std::size_t of_jelly) {
        auto H = solver.download<DisplacementGradient, Jelly>();
        H[of_jelly](1, 1) = -1.5; // det F = -0.5
        solver.upload<DisplacementGradient, Jelly>(H);
    };
    for (auto* of : {&isolates, &removes}) {
        auto H = of->download<DisplacementGradient, Rubber>();
        H[30](0, 1) = 1e200;
        of->upload<DisplacementGradient, Rubber>(H);
        spoil(*of, 17);
    }
    auto const x = isolates.positions();
    for (std::uint32_t const id : {30u, rubber + 17})
        CHECK(removes.remove_if(
                  Inside<Sphere>{.shape = {1e-6}, .pose = {.position = {x[id].x(), x[id].y(), 0}}}) == 1);
    auto const isolated = isolates.step(1e-3, Gravity{}).isolated;
    removes.step(1e-3, Gravity{});
    REQUIRE(isolated.size() == 2);
    CHECK(isolated[0].material == 0);
    CHECK(isolated[0].particle == 30);
    CHECK(isolated[0].cause == FailureCause::not_finite);
    CHECK(isolated[1].material == 1);
    CHECK(isolated[1].particle == rubber + 17);
    CHECK(isolated[1].cause == FailureCause::inverted);
    CHECK(isolated[1].position.head<2>() == x[rubber + 17]);
    CHECK(same(isolates, removes));
    for (auto* of : {&isolates, &removes}) {
        for (int i = 0; i < 10; ++i) of->step(1e-3, Gravity{});
        of->advance(0.01);
    }
    CHECK(same(isolates, removes));
    spoil(isolates, 20); // one more, where another was removed before: an error that names it
    auto const error = refused([&] { isolates.advance(0.01); });
    CHECK(error.what_is_wrong().find("particle " + std::to_string(rubber + 21) +
                                     " of neo_hookean (material 1) was turned") == 0);
    CHECK(isolates.isolated().size() == 2);

    auto fast = running_scene(), without = running_scene(); // no step gets on with it
    fast.quarantine(1);
    for (auto* of : {&fast, &without}) {
        auto v = of->download<Velocity, Jelly>();
        v[5] = {of == &fast ? 1e14 : 0, 0};
        of->upload<Velocity, Jelly>(v);
    }
    Eigen::Vector2d const there = without.positions<Jelly>()[5];
    without.remove_if(Inside<Sphere>{.shape = {1e-6}, .pose = {.position = {there.x(), there.y(), 0}}});
    auto const report = fast.advance(0.01);
    without.advance(0.01);
    REQUIRE(report.isolated.size() == 1);
    CHECK(report.isolated[0].cause == FailureCause::stalled);
    CHECK(report.isolated[0].material == 1);
    CHECK(report.isolated[0].particle == rubber + 5);
    CHECK(same(fast, without));
}

TEST_CASE("a stiffness that is not above 0 is refused")
{
    Scene<Heterogeneous<Snow<Plane>>, QuadraticBSpline, Mls>::Solver solver(lattice(0.1));
    solver.add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.1), 0.0025);
    for (double bad : {0.0, -1.0, not_a_number})
        refused([&] { solver.upload<Stiffness>(std::vector<double>(solver.size(), bad)); });
    CHECK(solver.download<Stiffness>() == std::vector<double>(solver.size(), 1));
}
