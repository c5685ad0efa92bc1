// SPDX-License-Identifier: MIT
#pragma once

#include "limits/hard_case.hpp"
#include "support/one_element.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

// Hard cases of what is hit, crushed and lies at one place, by explicit steps and by implicit ones.
namespace firn::test::impact
{

template <class Model>
Model elastic(double young, double poisson, double density = 1000)
{
    Model model;
    model.density = static_cast<typename Model::Number>(density);
    model.elasticity = lame<typename Model::Number>(young, poisson);
    return model;
}

/// Calls `look(report)` after each of so many parts of a duration [s].
template <class Solver, class Look, class... Effects>
void watch(Solver& solver, double duration, int parts, Look const& look, Effects const&... effects)
{
    for (int i = 0; i < parts; ++i) look(solver.advance(duration / parts, effects...));
}

/// A cube that hits a wall at a speed beyond that of its waves: it touches after 1 ms.
template <class SceneType, class... Effects>
void hit_wall(std::string const& name, int cells, Effects const&... effects)
{
    HardCase const H2{"H2"};
    double const rounding = 16 * std::numeric_limits<double>::epsilon(); // of J, by what F may be off
    constexpr int d = SceneType::d;
    double const h = 0.2 / cells, volume = std::pow(h / 2, d);
    typename SceneType::Solver solver(lattice(h), elastic<typename SceneType::Model>(1e6, 0.3));
    Vector<double, d> const up = Vector<double, d>::Unit(1), high = Vector<double, d>::Constant(0.2);
    solver.add(box_of_points<d>(0.1 * up, high + 0.1 * up, h), volume, -100 * up);
    double const start = mechanical_energy(solver, volume);
    double most = 0, deepest = 0, flattest = 1, turned = 0;
    watch(
        solver, 0.01, 50,
        [&](AdvanceReport const&) {
            most = std::max(most, mechanical_energy(solver, volume) / start);
            for (auto const& x : solver.positions()) deepest = std::max(deepest, -x.y() / h);
            for (auto const& H : solver.template download<DisplacementGradient>()) {
                double const J = 1 + volume_change<double, d>(H);
                turned += !(J > -rounding); // corotated ones may come to a sheet: they have no barrier
                flattest = std::min(flattest, J);
            }
        },
        effects..., Obstacle<HalfSpace>{});
    H2.at_most(name + ": particles not finite", double(not_finite(solver)), 0);
    H2.at_most(name + ": deepest particle behind the wall [cells]", deepest, 1);
    H2.at_most(name + ": largest total energy / that at the start", most, 1.02);
    H2.at_most(name + ": particles inside out beyond rounding at any of 50 looks", turned, 0);
    H2.at_most(name + ": smallest volume of a particle / that at rest", flattest, 0.1); // it was an impact
}

/// A block that was crushed to a hundredth of its volume, and let go.
template <class SceneType, class... Effects>
void let_go(std::string const& name, [[maybe_unused]] double expected_step, Effects const&... effects)
{
    HardCase const H4{"H4"};
    constexpr int d = SceneType::d;
    double const h = 0.1, side = std::pow(0.01, 1.0 / d), volume = std::pow(h / 2, d);
    auto const material = elastic<typename SceneType::Model>(1e5, 0.2);
    typename SceneType::Solver solver(lattice(h), material);
    auto points = box_of_points<d>(Vector<double, d>::Zero(), Vector<double, d>::Constant(0.3), h);
    for (auto& x : points) x *= side;
    solver.add(points, volume);
    solver.template upload<DisplacementGradient>(
        std::vector<Matrix<double, d>>(points.size(), Matrix<double, d>::Identity() * (side - 1)));
    double const stored = mechanical_energy(solver, volume);
    [[maybe_unused]] double const at_rest =
        StepControl{}.wave * isolated_limit<QuadraticBSpline, Mls>(material.elasticity.expansion_ratio(d)) *
        h / std::sqrt(material.elasticity.p_wave_modulus() / material.density);
    [[maybe_unused]] double const first = solver.step(1e-9, effects...).stable_dt;
    double kinetic = 0, total = 0;
    watch(
        solver, 0.03, 60,
        [&](AdvanceReport const&) {
            kinetic = std::max(kinetic, Totals(solver).kinetic_energy / stored);
            total = std::max(total, mechanical_energy(solver, volume) / stored);
        },
        effects...);
    H4.at_most(name + ": particles not finite", double(not_finite(solver)), 0);
    H4.at_most(name + ": largest kinetic energy / energy stored", kinetic, 1.05);
    H4.at_most(name + ": largest total energy / energy stored", total, 1.05);
    if constexpr (SceneType::is_implicit)
        H4.at_least(name + ": largest kinetic energy / energy stored", kinetic, 0.5);
    else { // waves bound no others
        H4.at_most(name + ": stable step / that at rest", first / at_rest, expected_step + 0.01);
        H4.at_least(name + ": stable step / that at rest", first / at_rest, expected_step - 0.01);
    }
}

/// A block with a cluster in it: so many particles at one place, in groups of the same velocity.
template <class SceneType, int d = SceneType::d>
typename SceneType::Solver with_cluster(std::vector<Vector<double, d>> const& velocities, double volume,
                                        typename SceneType::Solver::Transfer const& transfer = {})
{
    double const h = 0.1;
    typename SceneType::Solver solver(lattice(h), elastic<typename SceneType::Model>(1e5, 0.3), transfer);
    auto const at = [](double all) { return Vector<double, d>(Vector<double, d>::Constant(all)); };
    solver.add(box_of_points<d>(at(0), at(0.3), h), std::pow(h / 2, d), Vector<double, d>::Unit(1));
    for (auto const& v : velocities)
        solver.add(std::vector<Vector<double, d>>{at(0.15)}, volume / double(velocities.size()), v);
    for (int i = 0; i < 50; ++i) solver.step(5e-4, Gravity{});
    return solver;
}

/// The largest difference of a cluster and its block from those with one particle in its place: of positions
/// [cells], and of H.
template <class Solver>
std::pair<double, double> difference(Solver const& cluster, Solver const& one)
{
    auto const x = cluster.positions(), y = one.positions();
    auto const H = cluster.template download<DisplacementGradient>(),
               G = one.template download<DisplacementGradient>();
    std::pair<double, double> most{};
    for (std::size_t i = 0; i < x.size(); ++i) {
        std::size_t const other = std::min(i, y.size() - 1);
        most.first = std::max(most.first, (x[i] - y[other]).norm() / 0.1);
        most.second = std::max(most.second, (H[i] - G[other]).norm());
    }
    return most;
}

/// 64 particles at one place, of the same velocity and of opposite ones, against one in their place.
template <class SceneType>
void be_one(std::string const& name, double largest,
            typename SceneType::Solver::Transfer const& transfer = {})
{
    HardCase const H12{"H12"};
    constexpr int d = SceneType::d;
    double const volume = 64 * std::pow(0.05, d);
    Vector<double, d> const rest = Vector<double, d>::Zero();
    Vector<double, d> fast = rest;
    fast[0] = 5, fast[d - 1] = 3;
    auto const one = with_cluster<SceneType>({rest}, volume, transfer);
    auto const check = [&](std::string const& what, std::vector<Vector<double, d>> const& velocities) {
        auto const cluster = with_cluster<SceneType>(velocities, volume, transfer);
        auto const [x, H] = difference(cluster, one);
        H12.at_most(name + what + ": difference of positions [cells]", x, largest);
        H12.at_most(name + what + ": difference of deformation gradients", H, largest);
        double const dt = 5e-4;
        H12.at_most(name + what + ": largest dt |C|",
                    dt * largest_norm(cluster.template download<AffineVelocity>()), 1);
    };
    std::vector<Vector<double, d>> velocities(64, rest);
    check("same velocity", velocities);
    for (std::size_t i = 0; i < velocities.size(); ++i) velocities[i] = i % 2 == 0 ? fast : -fast;
    check("opposite velocities", velocities);
}

} // namespace firn::test::impact
