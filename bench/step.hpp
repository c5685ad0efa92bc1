// SPDX-License-Identifier: MIT
#pragma once

#include "machine.hpp"

#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>
#include <numeric>
#include <random>
#include <string>
#include <vector>

// Whole substeps: the order of cells, both transfers, grid, material, and the bounds of the next step.
namespace firn::bench
{

/// How the particles lie: regularly (jittered by a tenth of their spacing), at random, or as a splash leaves
/// them: thrown on a floor, deformed and scattered.
enum class Layout
{
    lattice,
    random,
    splash
};
inline constexpr char const* layout_names[]{"lattice", "random", "splash"};

inline constexpr double cell = 0.01;    ///< [m]; eight particles per cell at the start
inline constexpr double courant = 0.1;  ///< cells that a body in flight moves per step
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
        else
            points.push_back((place + Eigen::Vector3d::Constant(0.45) + 0.1 * jitter) * spacing);
    }
    return points;
}

template <class Solver>
Eigen::Vector3d momentum(Solver const& solver)
{
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    auto const velocity = solver.template download<Velocity>();
    auto const mass = solver.masses();
    for (std::size_t i = 0; i < mass.size(); ++i) sum += mass[i] * velocity[i].template cast<double>();
    return sum;
}

template <class Model, class Kernel, class Transfer>
void step(benchmark::State& run, Layout layout, int count, int threads)
{
    using Solver = Solver<OpenMP, Model, Kernel, Transfer>;
    Solver solver(lattice(cell), {}, {}, {}, OpenMP{threads});
    auto const points = cube(count, layout);
    double const volume = std::pow(cell / 2, 3);
    Obstacle<HalfSpace> const floor{.shape = {{0, 1, 0}}, .contact = Contact::coulomb(0.3)};
    Gravity const gravity;
    double dt = 0;
    if (layout == Layout::splash) {
        solver.add(points, volume, {0, -throwing, 0});
        solver.advance(0.5 * std::cbrt(double(count)) * cell / 2 / throwing, gravity, floor);
        dt = 0.5 * solver.step(1e-6, gravity, floor).stable_dt;
    }
    else {
        solver.add(points, volume);
        dt = 0.5 * solver.step(1e-6).stable_dt; // at rest: all that bounds it is the wave
        double const speed = courant * cell / dt;
        using Vec = Vector<typename Solver::Number, 3>;
        solver.template upload<Velocity>(std::vector<Vec>(
            solver.size(), Vec(Eigen::Vector3d(0.48, -0.8, 0.36).cast<typename Solver::Number>() *
                               typename Solver::Number(speed))));
    }
    auto const advance = [&] {
        return layout == Layout::splash ? solver.step(dt, gravity, floor) : solver.step(dt);
    };
    advance(); // the first two steps find out that steps are equal
    advance();

    Eigen::Vector3d const before = momentum(solver);
    double const mass = [&] {
        auto const m = solver.masses();
        return std::accumulate(m.begin(), m.end(), 0.0);
    }();
    Eigen::Vector3d pushed = Eigen::Vector3d::Zero();
    double const start_time = solver.time(), user = user_seconds();
    auto const start = std::chrono::steady_clock::now();
    std::uint64_t steps = 0;
    for (auto _ : run) {
        for (auto const& reaction : advance().reactions) pushed += reaction.impulse;
        ++steps;
    }
    std::chrono::duration<double> const wall = std::chrono::steady_clock::now() - start;
    double const cpu = user_seconds() - user;
    double const particle_steps = double(solver.size()) * double(steps);

    Eigen::Vector3d expected = before - pushed;
    if (layout == Layout::splash) expected += mass * gravity.acceleration * (solver.time() - start_time);
    auto const masses = solver.masses();
    double const mass_after = std::accumulate(masses.begin(), masses.end(), 0.0);

    // What must move: the fields that are read, the state that is written, and the order of cells.
    using Move =
        MoveParticles<typename Solver::Space, Model, Kernel, Transfer, Chain<>, typename Solver::State>;
    double const traffic = double(3 * sizeof(typename Solver::Number) +
                                  Move::Read::components(3) * sizeof(typename Solver::Number) + 4 + 4) +
                           double(Solver::state_bytes_per_particle + 6);
    run.counters["particle_steps_per_second"] = particle_steps / wall.count();
    run.counters["per_second_of_user_time"] = particle_steps / cpu;
    run.counters["bytes_per_particle"] = double(Solver::bytes_per_particle);
    run.counters["memory_per_particle"] = double(solver.memory()) / double(solver.size());
    run.counters["bytes_per_particle_step"] = traffic;
    run.counters["percent_of_copy_bandwidth"] = 100 * traffic * particle_steps / cpu / copy_bandwidth();
    run.counters["mass_error"] = std::abs(mass_after - mass) / mass;
    run.counters["momentum_error"] = (momentum(solver) - expected).norm() / before.norm();
}

/// Registers step/openmp/MODEL/KERNEL/TRANSFER/PRECISION/LAYOUT/PARTICLES for some sizes.
template <class Model, class Kernel, class Transfer>
void add_steps(int threads)
{
    constexpr bool is_float = std::is_same_v<typename Model::Space::Real, float>;
    for (Layout layout : {Layout::lattice, Layout::random, Layout::splash})
        for (int count : {10000, 100000, 1000000, 10000000}) {
            std::string const name = std::string("step/openmp/") + Model::name + "/" + Kernel::name + "/" +
                                     Transfer::name + "/" + (is_float ? "float" : "double") + "/" +
                                     layout_names[int(layout)] + "/" + std::to_string(count);
            benchmark::RegisterBenchmark(name.c_str(), [=](benchmark::State& run) {
                step<Model, Kernel, Transfer>(run, layout, count, threads);
            })->Unit(benchmark::kMillisecond);
        }
}

void add_double_steps(int threads); ///< step_double.cpp: its own file, to be compiled beside the other

} // namespace firn::bench
