// SPDX-License-Identifier: MIT
#pragma once

#include "flops.hpp"
#include "machine.hpp"
#include "scene.hpp"
#include "totals.hpp"

#include <benchmark/benchmark.h>

#include <chrono>
#include <memory>
#include <string>
#include <utility>

// Whole substeps: the order of cells, both transfers, grid, material, and the bounds of the next step.
namespace firn::bench
{

inline std::pair<std::string, std::shared_ptr<void>> scene_under_way; ///< of which entry, see scene_of()

/// The scene of the current benchmark, and the share of its particles that leave their cells. Google
/// Benchmark calls the function again until it has run for long enough, and a splash takes longer to set up
/// than to time.
template <class Solver>
std::pair<Scene<Solver>, double>& scene_of(std::string const& entry, Layout layout, int count, int threads)
{
    using Held = std::pair<Scene<Solver>, double>;
    if (scene_under_way.first != entry) {
        scene_under_way = {}; // its memory, before there is another one
        auto held = std::make_shared<Held>(Scene<Solver>(layout, count, OpenMP{threads}), 0);
        held->second = held->first.leaver_share();
        scene_under_way = {entry, std::move(held)};
    }
    return *static_cast<Held*>(scene_under_way.second.get());
}

template <class Model, class Kernel, class Transfer>
void step(benchmark::State& run, std::string const& entry, Layout layout, int count, int threads)
{
    using Solver = Solver<OpenMP, Model, Kernel, Transfer>;
    using Number = typename Solver::Number;
    auto& [scene, leaver_share] = scene_of<Solver>(entry, layout, count, threads);
    Solver& solver = scene.solver;

    constexpr int together = 10; // all layers of a lattice change their cells, each once
    Totals const before(solver);
    Eigen::Vector3d pushed = Eigen::Vector3d::Zero();
    double const start_time = solver.time(), user = user_seconds();
    auto const start = std::chrono::steady_clock::now();
    std::uint64_t steps = 0;
    while (run.KeepRunningBatch(together))
        for (int i = 0; i < together; ++i, ++steps)
            for (auto const& reaction : scene.step().reactions) pushed += reaction.impulse;
    std::chrono::duration<double> const wall = std::chrono::steady_clock::now() - start;
    double const cpu = user_seconds() - user;
    double const particle_steps = double(solver.size()) * double(steps);

    Totals const after(solver);
    Eigen::Vector3d const expected =
        before.momentum - pushed + scene.pull(before.mass, solver.time() - start_time);

    // What must move: the state, read and written, and the order of cells.
    double const traffic = 2.0 * Solver::state_bytes_per_particle + 8;
    double const flops = flops_per_particle_step<Model, Kernel, Transfer>();
    run.counters["particle_steps_per_second"] = particle_steps / wall.count();
    run.counters["per_second_of_user_time"] = particle_steps / cpu;
    run.counters["bytes_per_particle"] = double(Solver::bytes_per_particle);
    run.counters["memory_per_particle"] = double(solver.memory()) / double(solver.size());
    if constexpr (!requires(Transfer transfer) {
                      transfer.passes();
                  }) { // transfers that gather and scatter once
        run.counters["bytes_per_particle_step"] = traffic;
        run.counters["percent_of_copy_bandwidth"] = 100 * traffic * particle_steps / cpu / copy_bandwidth();
        run.counters["flops_per_particle_step"] = flops;
        run.counters["percent_of_fma_peak"] =
            100 * flops * particle_steps / cpu / multiply_add_peak<Number>();
    }
    run.counters["leaver_share"] = leaver_share;
    run.counters["mass_error"] = std::abs(after.mass - before.mass) / before.mass;
    run.counters["momentum_error"] = (after.momentum - expected).norm() / before.momentum.norm();
}

/// Registers step/openmp/MODEL/KERNEL/TRANSFER/PRECISION/LAYOUT/PARTICLES for some layouts and sizes.
template <class Model, class Kernel, class Transfer>
void add_steps(int threads,
               std::initializer_list<Layout> layouts = {Layout::lattice, Layout::random, Layout::splash},
               std::initializer_list<int> counts = {10000, 100000, 1000000, 10000000})
{
    constexpr bool is_float = std::is_same_v<typename Model::Space::Scalar, float>;
    for (Layout layout : layouts)
        for (int count : counts) {
            std::string const name = std::string("step/openmp/") + Model::name + "/" + Kernel::name + "/" +
                                     Transfer::name + "/" + (is_float ? "float" : "double") + "/" +
                                     layout_names[int(layout)] + "/" + std::to_string(count);
            benchmark::RegisterBenchmark(name.c_str(), [=](benchmark::State& run) {
                step<Model, Kernel, Transfer>(run, name, layout, count, threads);
            })->Unit(benchmark::kMillisecond);
        }
}

void add_double_steps(int threads);   ///< step_double.cpp: its own file, to be compiled beside the other
void add_material_steps(int threads); ///< step_materials.cpp: the same
void add_phases(int threads);         ///< phases.cpp
void add_safety(int threads);         ///< safety.cpp
void add_sampling(int threads);       ///< sampling.cpp, where CGAL is
void add_compile_time();              ///< compile_time.cpp

} // namespace firn::bench
