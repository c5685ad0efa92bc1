// SPDX-License-Identifier: MIT
#pragma once

#include "limits/hard_case.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

// Hard cases of places and numbers at the limits, by explicit steps and by implicit ones.
namespace firn::test::limits
{

/// A block that falls on a floor and comes to rest.
template <class SceneType>
void come_to_rest(std::string const& name, double largest_gap)
{
    HardCase const H15{"H15"};
    constexpr int d = SceneType::d;
    double const h = 0.05;
    typename SceneType::Model material;
    material.elasticity = lame<typename SceneType::Number>(1e5, 0.3);
    typename SceneType::Solver solver(lattice(h), material);
    auto points = box_of_points<d>(Vector<double, d>::Zero(), Vector<double, d>::Constant(0.2), h);
    for (auto& x : points) x.y() += 0.137;
    solver.add(points, std::pow(h / 2, d));
    Obstacle<HalfSpace> const floor{};
    double deepest = 0;
    for (int i = 0; i < 40; ++i) {
        if constexpr (SceneType::is_implicit)
            solver.advance(1.0 / 40, Gravity{}, floor); // which damp
        else
            solver.advance(1.0 / 40, Gravity{}, floor, Damping{i < 8 ? 0.0 : 10.0});
        for (auto const& x : solver.positions()) deepest = std::max(deepest, -x.y() / h);
    }
    double lowest = 1e9;
    for (auto const& x : solver.positions()) lowest = std::min(lowest, x.y() / h);
    double const fastest = largest_norm(solver.template download<Velocity>());
    H15.at_most(name + ": speed in the end [m/s]", fastest, 0.02);
    H15.at_most(name + ": gap under its lowest particles' faces [cells]", lowest - 0.25, largest_gap);
    H15.at_most(name + ": deepest particle in the floor [cells]", deepest, 0.1);
}

/// How far a scene far from the origin gets from one at it [cells].
template <class SceneType, class... Effects>
double drift_apart(double distance, std::size_t steps = 1000, Effects const&... effects)
{
    constexpr int d = SceneType::d;
    using At = Vector<double, d>;
    double const h = 0.01;
    auto const points = box_of_points<d>(At::Zero(), At::Constant(2 * h), h);
    At const far = At::Constant(distance);
    typename SceneType::Model material;
    material.elasticity = lame<typename SceneType::Number>(1e5, 0.3);
    typename SceneType::Solver here(lattice(h), material), there(lattice(h), material);
    At velocity = At::Zero();
    velocity[0] = 0.003, velocity[1] = 0.001;
    auto moved = points;
    for (auto& x : moved) x += far;
    // slower than what stalls where world positions are floats: 4.8 mm/s at 10 m, 0.3 m/s at 1 km
    here.add(points, 1e-7, velocity);
    there.add(moved, 1e-7, velocity);
    here.steps(steps, 0.1 / double(steps), effects...);
    there.steps(steps, 0.1 / double(steps), effects...);
    auto const a = here.positions(), b = there.positions();
    double most = 0;
    for (std::size_t i = 0; i < a.size(); ++i) most = std::max(most, (b[i] - far - a[i]).norm() / h);
    return most;
}

/// The error message of a call that throws, and how long the call takes [s].
template <class Call>
std::pair<std::string, double> complaint(Call const& call)
{
    auto const start = std::chrono::steady_clock::now();
    std::string said;
    try {
        call();
    }
    catch (Error const& error) {
        said = error.what();
    }
    std::chrono::duration<double> const spent = std::chrono::steady_clock::now() - start;
    return {said, spent.count()};
}

} // namespace firn::test::limits
