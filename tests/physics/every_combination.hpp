// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"
#include "support/policies.hpp"

// What every combination of policies must do. Those without which a pair of policies would be in no test are
// always built (pairs_*.cpp); the full product, units of a model and a transfer each, is written by
// tests/CMakeLists.txt where it is asked for (FIRN_TEST_EVERY_COMBINATION).
namespace firn::test
{

/// A model with a transfer in all spaces, with both splines.
template <template <class> class Model, class Transfer>
using EverySpace = std::tuple<
    Scene<Model<Plane>, QuadraticBSpline, Transfer>, Scene<Model<Plane>, CubicBSpline, Transfer>,
    Scene<Model<PlaneFloat>, QuadraticBSpline, Transfer>, Scene<Model<PlaneFloat>, CubicBSpline, Transfer>,
    Scene<Model<Solid>, QuadraticBSpline, Transfer>, Scene<Model<Solid>, CubicBSpline, Transfer>,
    Scene<Model<SolidFloat>, QuadraticBSpline, Transfer>, Scene<Model<SolidFloat>, CubicBSpline, Transfer>>;

/// A block that is compressed from all sides as it falls on a ball: whatever its material, its momentum
/// changes by the impulses of gravity and of the ball. With the tent, for which no step is safe, steps are
/// shorter.
template <class SceneType>
void check_momentum()
{
    constexpr int d = SceneType::d;
    using Number = typename SceneType::Number;
    double const h = 0.05, dt = HasConstantInertia<typename SceneType::Kernel> ? 1e-4 : 2e-5;
    typename SceneType::Solver solver(lattice(h));
    Vector<double, d> const low = Vector<double, d>::Constant(0.013),
                            high = low + Vector<double, d>::Constant(0.4), middle = 0.5 * (low + high);
    auto const points = scattered<d>(box_of_points<d>(low, high, h), 0.2 * h);
    solver.add(points, std::pow(h / 2, d));
    std::vector<Vector<Number, d>> velocities;
    for (auto const& x : points) {
        Vector<double, d> v = -0.5 * (x - middle);
        v[1] -= 1;
        velocities.push_back(v.template cast<Number>());
    }
    solver.template upload<Velocity>(velocities);
    Totals const start(solver);
    Gravity const gravity{{1, -9.81, d == 3 ? 2.0 : 0.0}};
    Obstacle<Sphere> const ball{.shape = {0.1}, .motion = {.position = {middle[0], 0, middle[d - 1]}}};
    Vector<double, d> expected = start.momentum, received = Vector<double, d>::Zero();
    for (int i = 0; i < 100; ++i) {
        auto const report = solver.step(dt, gravity, ball);
        expected += start.mass * dt * gravity.acceleration.template head<d>();
        received += report.reactions[0].impulse.template head<d>();
    }
    Totals const end(solver);
    double const scale = start.momentum.norm(), rounding = SceneType::is_float ? 1e-5 : 1e-12;
    CHECK(std::abs(end.mass / start.mass - 1) <= rounding);
    CHECK((end.momentum + received - expected).norm() <= rounding * scale);
    CHECK(received[1] < -1e-3 * scale);
}

} // namespace firn::test
