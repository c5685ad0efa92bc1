// SPDX-License-Identifier: MIT
#include "batch.hpp"
#include "catch.hpp"

using namespace firn;
using namespace firn::test;

// Others are in batch_of_jelly.cu: nvcc takes minutes for all of them.
using Scenes =
    Combinations<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>, Scene<Snow<Plane>, CubicBSpline, Flip>,
                 Scene<FixedCorotated<Solid>, CubicBSpline, Apic>>; // as in every_loop.cu

TEMPLATE_LIST_TEST_CASE("steps that are queued together are those that are taken one by one, bit by bit", "",
                        Scenes)
{
    auto const run = [](std::size_t batch) {
        Thrown<TestType> scene(batch, 6);
        auto const first =
            scene.solver.advance(0.001 * sample_of(30, 50), Gravity{}, scene.floor, scene.sphere);
        CHECK(first.substeps > 10);
        auto const second =
            scene.solver.advance(0.001 * sample_of(15, 30), Gravity{}, scene.floor, scene.sphere);
        return std::tuple{told(first), told(second), state_of(scene.solver)};
    };
    auto const one_by_one = run(1);
    for (std::size_t batch : {2, 5, 64}) CHECK((run(batch) == one_by_one)); // not to be printed
}

TEST_CASE("so are those of a run with rejected steps")
{
    auto const run = [](std::size_t batch) {
        Thrown<Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>> scene(
            batch, 60, {.deformation = 0.09, .rejection = 0.1});
        auto const report = scene.solver.advance(0.01, scene.floor);
        CHECK(report.rejected > 0);
        return std::tuple{told(report), state_of(scene.solver)};
    };
    auto const one_by_one = run(1);
    for (std::size_t batch : {3, 64}) CHECK((run(batch) == one_by_one));
}

TEST_CASE("so are those of two materials with rejected steps")
{
    using Solver = Scene<Materials<FixedCorotated<Plane>, NeoHookean<Plane>>, QuadraticBSpline, Mls>::Solver;
    auto const run = [](std::size_t batch) {
        Solver solver(lattice(0.05), {}, {}, {.deformation = 0.09, .rejection = 0.1}, Cuda{.batch = batch});
        auto const points = ball_of_points<2>({0.013, 0.4}, 0.2, 0.05);
        solver.add<Material<0>>(points, std::pow(0.025, 2), {18, -60});
        auto beside = points;
        for (auto& x : beside) x[0] += 0.5;
        solver.add<Material<1>>(beside, std::pow(0.025, 2), {-18, -60});
        auto const report = solver.advance(0.01, Obstacle<HalfSpace>{});
        CHECK(report.rejected > 0);
        return std::tuple{told(report), solver.time(), solver.positions()};
    };
    auto const one_by_one = run(1);
    for (std::size_t batch : {3, 64}) CHECK((run(batch) == one_by_one));
}

TEST_CASE("a failed step in the middle of a batch leaves the state of the last good step")
{
    auto const run = [](std::size_t batch) {
        Thrown<Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>> scene(
            batch, 60, {.deformation = 0.09, .rejection = 0.1, .retries = 0});
        std::string error;
        try {
            scene.solver.advance(0.02, scene.floor);
        }
        catch (Error const& what) {
            error = what.what();
        }
        CHECK(!error.empty());
        CHECK(scene.solver.time() > 0);
        auto const stopped = state_of(scene.solver);
        scene.solver.step(1e-6);
        return std::tuple{error, stopped, state_of(scene.solver)};
    };
    auto const one_by_one = run(1);
    for (std::size_t batch : {4, 64}) CHECK((run(batch) == one_by_one));
}
