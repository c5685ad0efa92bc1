// SPDX-License-Identifier: MIT
// Whole substeps: sorting into cells, scatter, grid, gather and the bounds of the next step.
// Entries are named step/backend/model/kernel/transfer/precision/state/particles, with --threads in the
// context.
#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <benchmark/benchmark.h>

#include <chrono>
#include <cmath>
#include <random>
#include <string>
#include <vector>

namespace
{

using namespace firn;

/// How the particles lie: regularly, at random, or as a splash leaves them (thrown on a floor and deformed).
enum class State
{
    lattice,
    random,
    splash
};
constexpr char const* names[]{"lattice", "random", "splash"};

constexpr double cell = 0.01; ///< [m]; eight particles per cell at the start

std::vector<Eigen::Vector3d> cube(int count, State state)
{
    int const side = static_cast<int>(std::lround(std::cbrt(double(count))));
    double const spacing = cell / 2;
    std::mt19937 random(7);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < side * side * side; ++i) {
        Eigen::Vector3d const place(i % side, i / side % side, i / side / side);
        Eigen::Vector3d const jitter(unit(random), unit(random), unit(random));
        if (state == State::lattice)
            points.push_back((place + Eigen::Vector3d::Constant(0.45) + 0.1 * jitter) * spacing);
        else
            points.push_back(side * spacing * jitter);
    }
    return points;
}

template <class Model, class Kernel, class Transfer>
void step(benchmark::State& run, State state, int count, int threads)
{
    Solver<OpenMP, Model, Kernel, Transfer> solver(lattice(cell), {}, {}, {}, OpenMP{threads});
    solver.add(cube(count, state), std::pow(cell / 2, 3), {0, -5, 0});
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.3)};
    if (state == State::splash) solver.advance(0.05, Gravity{}, floor);
    double const dt = solver.step(1e-6, Gravity{}, floor).stable_dt;
    std::uint64_t steps = 0;
    for (auto _ : run) {
        auto const start = std::chrono::steady_clock::now();
        solver.step(dt / 2, Gravity{}, floor);
        run.SetIterationTime(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
        ++steps;
    }
    auto const size = static_cast<double>(solver.size());
    run.counters["particle_steps_per_second"] =
        benchmark::Counter(size * static_cast<double>(steps), benchmark::Counter::kIsRate);
    run.counters["bytes_per_particle"] = static_cast<double>(solver.bytes_per_particle);
    run.counters["memory_per_particle"] = static_cast<double>(solver.memory()) / size;
}

template <class Model, class Kernel, class Transfer>
void add(int threads)
{
    for (State state : {State::lattice, State::random, State::splash})
        for (int count : {10000, 100000}) {
            std::string const name = std::string("step/openmp/") + Model::name + "/" + Kernel::name + "/" +
                                     Transfer::name + "/float/" + names[int(state)] + "/" +
                                     std::to_string(count) + "/threads:" + std::to_string(threads);
            benchmark::RegisterBenchmark(
                name.c_str(),
                [=](benchmark::State& run) { step<Model, Kernel, Transfer>(run, state, count, threads); })
                ->UseManualTime()
                ->Unit(benchmark::kMillisecond);
        }
}

} // namespace

int main(int argc, char** argv)
{
    using S = Space<3, float>;
    for (int threads : {1, 2}) {
        add<Snow<S>, CubicBSpline, Flip>(threads);
        add<Snow<S>, QuadraticBSpline, Mls>(threads);
        add<NeoHookean<S>, QuadraticBSpline, Mls>(threads);
    }
    benchmark::AddCustomContext("firn", openmp_info());
    benchmark::Initialize(&argc, argv);
    if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
    benchmark::RunSpecifiedBenchmarks();
}
