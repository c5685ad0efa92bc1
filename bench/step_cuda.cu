// SPDX-License-Identifier: MIT
// Whole substeps on a device: `benchmarks_cuda [options of Google Benchmark]`.
#include "scene.hpp"
#include "totals.hpp"

#include <benchmark/benchmark.h>
#include <firn/cuda.hpp>

#include <chrono>
#include <string>

namespace firn::bench
{
namespace
{

/// Bytes per second, read and written, of a copy from device memory to device memory.
double copy_bandwidth()
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
constexpr int steps_at_once = 40;

template <class Model, class Kernel, class Transfer>
void step(benchmark::State& run, Layout layout, int count, double courant_number)
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
        for (auto _ : run) { // ends when the host knows what the steps found out
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

/// Registers step/cuda/MODEL/KERNEL/TRANSFER/PRECISION/LAYOUT/PARTICLES for some sizes, and for 1 million
/// random particles also step/…/random/COURANT/PARTICLES: cells per step.
template <class Model, class Kernel, class Transfer>
void add()
{
    constexpr bool is_float = std::is_same_v<typename Model::Space::Real, float>;
    std::string const name = std::string("step/cuda/") + Model::name + "/" + Kernel::name + "/" +
                             Transfer::name + "/" + (is_float ? "float" : "double") + "/";
    auto const add_one = [&](std::string const& scene, Layout layout, int count, double courant_number) {
        benchmark::RegisterBenchmark(
            (name + scene + "/" + std::to_string(count)).c_str(),
            [=](benchmark::State& run) { step<Model, Kernel, Transfer>(run, layout, count, courant_number); })
            ->Unit(benchmark::kMillisecond)
            ->Iterations((count > 10000000  ? 40
                          : count > 2000000 ? 200
                                            : 1000) / // setting a scene up takes longer
                         steps_at_once)
            ->UseRealTime();
    };
    for (Layout layout : {Layout::lattice, Layout::random, Layout::splash})
        for (int count : {10000, 125000, 1000000, 8000000, 64000000})
            if (layout != Layout::splash || count <= 1000000)
                add_one(layout_names[int(layout)], layout, count, courant);
    for (double number : {0.03, 0.29}) // 0.3 is where a step is beyond the stable one
        add_one("random/" + std::to_string(number).substr(0, 4), Layout::random, 1000000, number);
}

} // namespace
} // namespace firn::bench

int main(int argc, char** argv)
{
    using namespace firn;
    using S = Space<3, float>;
    bench::add<NeoHookean<S>, QuadraticBSpline, Mls>();
    bench::add<FixedCorotated<S>, QuadraticBSpline, Mls>();
    bench::add<Snow<S>, QuadraticBSpline, Mls>();
    bench::add<Snow<S>, CubicBSpline, Mls>();
    bench::add<Snow<S>, CubicBSpline, Flip>();
    bench::add<NeoHookean<Space<3, double>>, QuadraticBSpline, Mls>();
    benchmark::AddCustomContext("firn", cuda_info());
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
}
