// SPDX-License-Identifier: MIT
#pragma once

#include "scene.hpp"
#include "totals.hpp"

#include <benchmark/benchmark.h>
#include <firn/cuda.hpp>

#include <chrono>
#include <string>

// Whole substeps on a device.
namespace firn::bench
{

/// Bytes per second, read and written, of a copy from device memory to device memory.
inline double copy_bandwidth()
{
    static double const best = [] {
        std::size_t const bytes = std::size_t(1) << 30;
        cuda::Queue const queue;
        cuda::Array<char> from(queue), to(queue);
        from.resize(bytes);
        to.resize(bytes);
        double shortest = 1e9;
        for (int i = 0; i < 10; ++i) {
            queue.wait();
            auto const start = std::chrono::steady_clock::now();
            cuda::check(cudaMemcpyAsync(to.data(), from.data(), bytes, cudaMemcpyDeviceToDevice),
                        "cudaMemcpyAsync");
            queue.wait();
            std::chrono::duration<double> const took = std::chrono::steady_clock::now() - start;
            shortest = std::min(shortest, took.count());
        }
        return 2.0 * double(bytes) / shortest;
    }();
    return best;
}

/// Steps of one call: some frames of a game have as many.
inline constexpr int steps_at_once = 40;

/// Steps of half the stable length, or as long as the library makes them (Solver::advance).
enum class Length
{
    equal,
    automatic
};

template <class Model, class Kernel, class Transfer>
void step(benchmark::State& run, Layout layout, int count, double courant_number, Length length)
{
    using Solver = Solver<Cuda, Model, Kernel, Transfer>;
    try {
        Scene<Solver> scene(layout, count, Cuda{}, courant_number);
        Solver& solver = scene.solver;
        scene.steps(64); // lists find their lengths
        Totals const before(solver);
        Eigen::Vector3d pushed = Eigen::Vector3d::Zero();
        double const start_time = solver.time();
        auto const start = std::chrono::steady_clock::now();
        std::uint64_t steps = 0;
        for (auto _ : run) {                   // ends when the host knows what the steps found out
            if (length == Length::automatic) { // in flight: nothing pushes
                steps += solver.advance(scene.stable * steps_at_once).substeps;
                continue;
            }
            for (auto const& report : scene.steps(steps_at_once))
                for (auto const& reaction : report.reactions) pushed += reaction.impulse;
            steps += steps_at_once;
        }
        std::chrono::duration<double> const wall = std::chrono::steady_clock::now() - start;
        double const per_second = double(solver.size()) * double(steps) / wall.count();
        Totals const after(solver);
        Eigen::Vector3d const expected =
            before.momentum - pushed + scene.pull(before.mass, solver.time() - start_time);
        double const traffic = 2.0 * Solver::state_bytes_per_particle + 5;
        run.counters["ms_per_step"] = 1e3 * wall.count() / double(steps);
        run.counters["particle_steps_per_second"] = per_second;
        run.counters["bytes_per_particle"] = double(Solver::bytes_per_particle);
        run.counters["memory_per_particle"] = double(solver.memory()) / double(solver.size());
        run.counters["percent_of_copy_bandwidth"] = 100 * traffic * per_second / copy_bandwidth();
        run.counters["mass_error"] = std::abs(after.mass - before.mass) / before.mass;
        run.counters["momentum_error"] = (after.momentum - expected).norm() / before.momentum.norm();
        // last, because it takes more steps
        if (solver.size() <= 2000000) run.counters["leaver_share"] = scene.leaver_share();
    }
    catch (Error const& error) {
        run.SkipWithError(error.what());
    }
}

/// Registers step/cuda/MODEL/KERNEL/TRANSFER/PRECISION/SCENE/PARTICLES.
template <class Model, class Kernel, class Transfer>
void add_step(std::string const& scene, Layout layout, int count, double courant_number = courant,
              Length length = Length::equal)
{
    constexpr bool is_float = std::is_same_v<typename Model::Space::Scalar, float>;
    std::string const name = std::string("step/cuda/") + Model::name + "/" + Kernel::name + "/" +
                             Transfer::name + "/" + (is_float ? "float" : "double") + "/" + scene + "/" +
                             std::to_string(count);
    benchmark::RegisterBenchmark(name.c_str(),
                                 [=](benchmark::State& run) {
                                     step<Model, Kernel, Transfer>(run, layout, count, courant_number,
                                                                   length);
                                 })
        ->Unit(benchmark::kMillisecond)
        ->Iterations((count > 10000000  ? 40
                      : count > 2000000 ? 200
                                        : 1000) / // setting a scene up takes longer
                     steps_at_once)
        ->UseRealTime();
}

/// Registers a scheme in flight and splashed, a million particles each.
template <class Model, class Transfer = Mls>
void add_million()
{
    for (Layout layout : {Layout::random, Layout::splash})
        add_step<Model, QuadraticBSpline, Transfer>(layout_names[int(layout)], layout, 1000000);
}

/// All layouts in some sizes, and for 1 million random particles also step/…/random/COURANT/PARTICLES: cells
/// per step.
template <class Model, class Kernel, class Transfer>
void add_layouts()
{
    for (Layout layout : {Layout::lattice, Layout::jittered, Layout::random, Layout::splash})
        for (int count : {10000, 125000, 1000000, 8000000, 64000000})
            if (layout != Layout::splash || count <= 1000000)
                add_step<Model, Kernel, Transfer>(layout_names[int(layout)], layout, count);
    for (int count : {10000, 125000, 1000000, 8000000}) // twice as long, so that as many leave their cells
        add_step<Model, Kernel, Transfer>("jittered/advance", Layout::jittered, count, courant / 2,
                                          Length::automatic);
    for (double number : {0.03, 0.29}) // 0.3 is where a step is beyond the stable one
        add_step<Model, Kernel, Transfer>("random/" + std::to_string(number).substr(0, 4), Layout::random,
                                          1000000, number);
}

void add_cubic_and_double();  ///< step_cuda_cubic.cu: its own file, to be compiled beside the others
void add_plastic_materials(); ///< step_cuda_plastic.cu: likewise
void add_transfers();         ///< step_cuda_transfers.cu: the same
void add_launches();          ///< launches_cuda.cu

/// Runs what was registered and is asked for; what main() returns.
inline int run_steps(int argc, char** argv)
{
    benchmark::AddCustomContext("firn", cuda_info());
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
    return 0;
}

} // namespace firn::bench
