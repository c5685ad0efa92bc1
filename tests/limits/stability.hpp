// SPDX-License-Identifier: MIT
#pragma once

#include "limits/hard_case.hpp"
#include "support/one_element.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

// Hard cases of stability over many steps, by explicit ones and by implicit ones.
namespace firn::test::stability
{

using Point = Vector<double, 2>;
using Points = std::vector<Point>;

constexpr double h = 0.1; // [m]

template <class Solver>
double kinetic(Solver const& solver)
{
    return Totals(solver).kinetic_energy;
}

/// The particles get random velocities of a millionth of the speed of waves, and strains of that size: one
/// without neighbours would just fly on.
template <class Solver>
void stir(Solver& solver)
{
    double const size = 1e-6;
    std::mt19937 random(5);
    std::normal_distribution<double> normal(0, size * wave_speed(solver.model()));
    std::vector<Point> velocities(solver.size());
    std::vector<Matrix<double, 2>> H(solver.size());
    for (auto& v : velocities) v = {normal(random), normal(random)};
    for (auto& each : H) each = size * random_matrix<2>(random);
    solver.template upload<Velocity>(velocities);
    solver.template upload<DisplacementGradient>(H);
}

/// Particles of which few have neighbours.
inline Points scattered_particles()
{
    Points points;
    for (int i = 0; i < 40; ++i) points.emplace_back(3 * h * (i % 8), 3 * h * (i / 8));
    return scattered<2>(points, 1.5 * h);
}

/// Particles out of reach of one another.
inline Points lone_particles()
{
    Points points;
    for (int i = 0; i < 40; ++i) points.emplace_back(6 * h * (i % 8), 6 * h * (i / 8));
    return scattered<2>(points, 0.5 * h);
}

inline Points free_block() { return box_of_points<2>({0, 0}, {8 * h, 8 * h}, h); }

/// The largest energy in the next steps of `courant` h / c, relative to the largest in the first twenty: near
/// the limit that of symplectic Euler swings by a factor of 39 within a few steps. Stops when it has grown by
/// 1e4. A refused step does not count as growth: the result is then infinite, or, where growth is required,
/// the last energy relative to the start; a factor of 39 is not enough there.
template <class SceneType, class... Effects>
double growth(Points const& points, double courant, int steps,
              typename SceneType::Solver::Transfer const& transfer, bool must_grow, Effects const&... effects)
{
    double const volume = h * h / 4;
    typename SceneType::Solver solver(lattice(h), {}, transfer);
    solver.add(points, volume);
    stir(solver);
    double const dt = courant * h / wave_speed(solver.model());
    double start = mechanical_energy(solver, volume), most = 0;
    for (int i = 0; i < steps && most < 1e4;) {
        bool const begins = i < 20 && !must_grow;
        std::size_t const count = begins || must_grow ? 1 : 20;
        try {
            solver.steps(count, dt, effects...);
        }
        catch (Error const&) {
            return must_grow ? most : std::numeric_limits<double>::infinity();
        }
        double& side = begins ? start : most;
        side = std::max(side, mechanical_energy(solver, volume) / (begins ? 1 : start));
        i += static_cast<int>(count);
    }
    return most;
}

/// Steps of `courant` h / c and a tenth of that, by turns of so many each: the largest energy in the last
/// half, of that in the first.
template <class SceneType, class... Effects>
double alternate(Points const& points, int turn, int steps, double courant = 0.4, Effects const&... effects)
{
    double const volume = h * h / 4;
    typename SceneType::Solver solver{lattice(h)};
    solver.add(points, volume);
    stir(solver);
    double const dt = courant * h / wave_speed(solver.model());
    double most[2]{mechanical_energy(solver, volume), 0};
    try {
        for (int i = 0; i < steps; i += 2 * turn)
            for (double each : {dt, dt / 10}) {
                solver.steps(static_cast<std::size_t>(turn), each, effects...);
                double& part = most[2 * i / steps];
                part = std::max(part, mechanical_energy(solver, volume));
            }
    }
    catch (Error const&) {
        return std::numeric_limits<double>::infinity();
    }
    return most[1] / most[0];
}

/// A block that drifts by a thousandth of a cell a step, then by a millionth.
template <class SceneType, class... Effects>
void drift(std::string const& name, double stress, double angle, double energy, int steps = 10000,
           double courant = 0.4, Effects const&... effects)
{
    HardCase const H8{"H8"};
    typename SceneType::Solver solver{lattice(h)};
    auto const points = scattered<2>(box_of_points<2>({0, 0}, {4 * h, 4 * h}, h), 0.1 * h);
    double const dt = courant * h / wave_speed(solver.model());
    double const modulus = solver.model().elasticity.p_wave_modulus();
    double most = 0, turn = 0, change = 0;
    auto const go = [&](double cells_a_step) {
        solver.template upload<Velocity>(std::vector<Vector<typename SceneType::Number, 2>>(
            points.size(), Point(cells_a_step * h / dt, 0).template cast<typename SceneType::Number>()));
        double const start = kinetic(solver);
        solver.steps(static_cast<std::size_t>(steps), dt, effects...);
        change = std::max(change, std::abs(kinetic(solver) / start - 1));
        most = std::max(most, largest_norm(solver.template download<Stress>()) / modulus);
        for (auto const& H : solver.template download<DisplacementGradient>())
            turn = std::max(turn, std::abs(double(H(0, 1)) - double(H(1, 0))) / 2);
    };
    solver.add(points, h * h / 4);
    go(1e-3);
    go(1e-6);
    H8.at_most(name + ": largest stress / wave modulus", most, stress);
    H8.at_most(name + ": turn of the block", turn, angle);
    H8.at_most(name + ": change of kinetic energy", change, energy);
}

/// The most energy of a block that rings with 5 % of strain in the second half of ten periods, of that in the
/// first: within a period that of symplectic Euler swings. And the largest strain.
template <class SceneType, class... Effects>
std::pair<double, double> ring(Points const& points, double volume, Occupancy& occupancy,
                               Effects const&... effects)
{
    typename SceneType::Solver solver{lattice(h)};
    solver.add(points, volume);
    occupancy = solver.occupancy();
    std::vector<Point> velocities;
    double const c = wave_speed(solver.model()), side = 8 * h;
    for (auto const& x : points)
        velocities.emplace_back(0.05 * c * std::cos(M_PI * x.x() / side),
                                0.05 * c * std::cos(M_PI * x.y() / side));
    solver.template upload<Velocity>(velocities);
    double most[2]{0, 0}, strain = 0;
    for (int i = 0; i < 80; ++i) {
        solver.advance(20 * side / c / 80, effects...);
        most[i / 40] = std::max(most[i / 40], mechanical_energy(solver, volume));
        strain = std::max(strain, largest_norm(solver.template download<DisplacementGradient>()));
    }
    return {most[1] / most[0], strain};
}

} // namespace firn::test::stability
