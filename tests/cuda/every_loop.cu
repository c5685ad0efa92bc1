// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <random>

using namespace firn;
using namespace firn::test;

using Short =
    Combinations<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>, Scene<Snow<Plane>, CubicBSpline, Flip>,
                 Scene<FixedCorotated<Solid>, CubicBSpline, Apic>>;

// Small enough for compute-sanitizer, which looks at every access: see bench/gpu.sh.
TEMPLATE_LIST_TEST_CASE("a few steps through every loop", "", Short)
{
    constexpr int d = TestType::d;
    typename TestType::Solver solver(lattice(0.1));
    Vector<double, d> velocity = Vector<double, d>::Constant(-60);
    auto const points = ball_of_points<d>(Vector<double, d>::Constant(0.2), 0.2, 0.1);
    solver.add(points, std::pow(0.05, d), velocity);
    for (int i = 0; i < 5; ++i) solver.step(i % 2 ? 2e-4 : 3e-4, Gravity{}, Obstacle<HalfSpace>{});
    auto const v = solver.template download<Velocity>();
    solver.template upload<Velocity>(v);
    auto far = points;
    for (auto& x : far) x += Vector<double, d>::Constant(3);
    solver.add(far, std::pow(0.05, d), velocity);
    for (int i = 0; i < 5; ++i) solver.step(3e-4, Gravity{}, Obstacle<HalfSpace>{});
    CHECK_THROWS_AS(solver.step(1.0), Error);
    solver.step(1e-5);
    CHECK(solver.positions().size() == 2 * points.size());

    // queued steps: blocks appear and are removed; a crowd in one cell, one particle far away, some removed
    typename TestType::Solver flying(lattice(0.1));
    flying.add(points, std::pow(0.05, d));
    flying.add(std::vector(40, Vector<double, d>(Vector<double, d>::Constant(0.51))), 1e-6);
    flying.add(std::vector{Vector<double, d>(Vector<double, d>::Constant(9.5))}, 1e-6);
    double const dt = 0.5 * flying.step(1e-6).stable_dt;
    using Velocities = Vector<typename TestType::Number, d>;
    flying.template upload<Velocity>(
        std::vector<Velocities>(flying.size(), Velocities::Constant(typename TestType::Number(-0.06 / dt))));
    flying.steps(d == 3 && TestType::is_float ? 80 : 20, dt);
    flying.advance(10 * dt, Gravity{});
    std::size_t const before = flying.size(),
                      gone = flying.remove_if(OnTheLeft{flying.positions()[points.size() / 2][0]});
    CHECK(gone > 0);
    CHECK(flying.size() == before - gone);
    cuda::Array<typename TestType::Number> places(Cuda{});
    places.resize(d * flying.size());
    flying.write_positions(places.data());
    flying.steps(5, dt);
    std::vector<typename TestType::Number> here(places.size());
    places.download(0, here);
    CHECK(std::isfinite(here.back()));
}

TEST_CASE("a few steps of so many blocks that no loop follows a step before it ends", "[many_blocks]")
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.1));
    std::vector<Vector<double, 3>> points; // each in a block of its own
    for (int i = 0; i < 1100; ++i)
        points.push_back(0.8 * Vector<double, 3>(i % 11, i / 11 % 10, i / 110) +
                         Vector<double, 3>(0.32, 0.03, 0.03));
    solver.add(points, 1e-4, {60, 0, 0}); // the third step takes all to other blocks at once
    solver.steps(4, 2e-4, Gravity{});
    solver.advance(2e-4, Gravity{});
    std::size_t const gone = solver.remove_if(OnTheLeft{3.0});
    CHECK(gone > 0);
    CHECK(solver.size() == points.size() - gone);
    solver.steps(2, 2e-4);
}

TEST_CASE("crowded blocks lose no momentum, nor does what moves between them", "[many_blocks]")
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.1));
    std::vector<Vector<double, 3>> points; // more than a thousand blocks, of which a few have hundreds each
    for (int i = 0; i < 1100; ++i)
        points.push_back(0.8 * Vector<double, 3>(i % 11, i / 11 % 10, i / 110) +
                         Vector<double, 3>::Constant(0.2));
    std::mt19937 random(5);
    auto const unit = [&] { return double(random()) * 0x1p-32; };
    for (int i = 0; i < 3000; ++i) // some of their cells are fuller by far than others
        points.push_back({0.7 * unit() * unit(), 0.35 * unit(), 0.7 * unit() * unit()});
    solver.add(points, 1e-6);
    std::vector<Vector<float, 3>> velocities;
    Vector<double, 3> before = Vector<double, 3>::Zero(), after = before;
    for (std::size_t i = 0; i < points.size(); ++i) {
        velocities.push_back(100 * Vector<double, 3>(unit() - 0.3, unit() - 0.4, unit()).cast<float>());
        before += velocities.back().cast<double>();
    }
    solver.upload<Velocity>(velocities);
    solver.steps(4, 2e-4);
    for (auto const& v : solver.download<Velocity>()) after += v.cast<double>();
    CHECK((after - before).norm() < 2e-6 * before.norm());
}
