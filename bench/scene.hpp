// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

#include <cmath>
#include <random>
#include <vector>

// The scenes that are timed: eight particles per cell, in flight or splashed.
namespace firn::bench
{

/// How the particles lie: regularly (jittered by a tenth of their spacing), each anywhere in its eighth of a
/// cell, anywhere in the body, or as a splash leaves them: thrown on a floor, deformed and scattered.
enum class Layout
{
    lattice,
    jittered,
    random,
    splash
};
inline constexpr char const* layout_names[]{"lattice", "jittered", "random", "splash"};

inline constexpr double cell = 0.01;    ///< [m]; eight particles per cell at the start
inline constexpr double courant = 0.1;  ///< cells that a body in flight falls per step
inline constexpr double throwing = 5.0; ///< speed of what splashes [m/s]

inline std::vector<Eigen::Vector3d> cube(int count, Layout layout)
{
    int const side = static_cast<int>(std::lround(std::cbrt(double(count))));
    double const spacing = cell / 2;
    std::mt19937 random(7);
    auto const unit = [&] { return double(random()) * 0x1p-32; };
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < side * side * side; ++i) {
        Eigen::Vector3d const place(i % side, i / side % side, i / side / side);
        Eigen::Vector3d jitter;
        for (double& x : jitter) x = unit();
        if (layout == Layout::random)
            points.push_back(side * spacing * jitter);
        else if (layout == Layout::jittered)
            points.push_back(spacing * (place + jitter));
        else
            points.push_back((place + Eigen::Vector3d::Constant(0.45) + 0.1 * jitter) * spacing);
    }
    return points;
}

/// A solver that is ready to take equal steps of half the stable length.
template <class Solver>
struct Scene
{
    Solver solver;
    bool on_floor;
    double dt = 0, stable = 0; ///< of a step, and the stable one [s]
    Gravity gravity{};
    Obstacle<HalfSpace> floor{.shape = {{0, 1, 0}}, .contact = Contact::coulomb(0.3)};

    template <class Backend>
    Scene(Layout layout, int count, Backend backend, double courant_number = courant)
        : solver(lattice(cell), {}, {}, {}, std::move(backend)), on_floor(layout == Layout::splash)
    {
        auto const points = cube(count, layout);
        double const volume = std::pow(cell / 2, 3);
        if (on_floor) {
            solver.add(points, volume, {0, -throwing, 0});
            solver.advance(0.5 * std::cbrt(double(count)) * cell / 2 / throwing, gravity, floor);
            dt = 0.5 * solver.step(1e-6, gravity, floor).stable_dt;
        }
        else {
            solver.add(points, volume);
            stable = solver.step(1e-6).stable_dt; // at rest: all that bounds it is the wave
            dt = 0.5 * stable;
            using Velocities = Vector<typename Solver::Number, 3>;
            auto const fall = static_cast<typename Solver::Number>(-courant_number * cell / dt);
            solver.template upload<Velocity>(std::vector<Velocities>(solver.size(), Velocities(0, fall, 0)));
        }
        step();
        step(); // the first two steps find out that steps are equal
    }

    StepReport step() { return step(dt); }
    std::vector<StepReport> steps(std::size_t count)
    {
        return on_floor ? solver.steps(count, dt, gravity, floor) : solver.steps(count, dt);
    }
    StepReport step(double length)
    {
        return on_floor ? solver.step(length, gravity, floor) : solver.step(length);
    }

    /// What gravity gives to a mass [kg] in a time [s].
    Eigen::Vector3d pull(double mass, double duration) const
    {
        return on_floor ? Eigen::Vector3d(mass * duration * gravity.acceleration) : Eigen::Vector3d::Zero();
    }

    /// The cell of each particle, by id.
    std::vector<Coordinates<3>> cells() const
    {
        std::vector<Coordinates<3>> found;
        for (auto const& x : solver.positions())
            found.push_back(locate<3>(solver.lattice(), Solver::kernel::degree, x).cell);
        return found;
    }

    /// The share of the particles that leave their cells in a step, averaged over ten steps. Layers of a
    /// lattice change cells together, every few steps.
    double leaver_share()
    {
        double left = 0;
        int const steps = 10;
        auto before = cells();
        for (int i = 0; i < steps; ++i) {
            step();
            auto const after = cells();
            for (std::size_t p = 0; p < after.size(); ++p) left += before[p] != after[p];
            before = after;
        }
        return left / (steps * double(before.size()));
    }
};

} // namespace firn::bench
