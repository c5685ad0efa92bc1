// SPDX-License-Identifier: MIT
#include "step.hpp"

namespace firn::bench
{
namespace
{

/// The ways to guard against failures: steps of given length with a check of the outcome; steps whose length
/// the solver chooses; a quarantine for failing particles; and an occupancy query over the whole scene.
enum class Care
{
    steps,
    advance,
    quarantine,
    occupancy
};
constexpr char const* care_names[]{"steps", "advance", "quarantine", "occupancy"};

template <class Model, class Kernel, class Transfer>
void take_care(benchmark::State& run, Care care, int count, int threads)
{
    Scene<Solver<OpenMP, Model, Kernel, Transfer>> scene(Layout::lattice, count, OpenMP{threads});
    if (care == Care::quarantine) scene.solver.quarantine(100);
    double const user = user_seconds();
    std::uint64_t steps = 0;
    for (auto _ : run) {
        if (care == Care::advance)
            steps += scene.solver.advance(8 * scene.dt).substeps;
        else if (care == Care::occupancy)
            benchmark::DoNotOptimize(scene.solver.occupancy());
        else
            steps += scene.steps(8).size();
    }
    if (steps == 0) steps = static_cast<std::uint64_t>(run.iterations());
    run.counters["user_nanoseconds_per_particle"] =
        1e9 * (user_seconds() - user) / double(steps) / double(scene.solver.size());
    run.counters["memory_per_particle"] = double(scene.solver.memory()) / double(scene.solver.size());
}

template <class Model, class Kernel, class Transfer>
void add_cares(int threads)
{
    for (Care care : {Care::steps, Care::advance, Care::quarantine, Care::occupancy}) {
        std::string const name = std::string("safety/openmp/") + Model::name + "/" + Kernel::name + "/" +
                                 Transfer::name + "/float/lattice/100000/" + care_names[int(care)];
        benchmark::RegisterBenchmark(name.c_str(), [=](benchmark::State& run) {
            take_care<Model, Kernel, Transfer>(run, care, 100000, threads);
        })->Unit(benchmark::kMillisecond);
    }
}

} // namespace

void add_safety(int threads)
{
    using S = Space<3, float>;
    add_cares<NeoHookean<S>, QuadraticBSpline, Mls>(threads);
    add_cares<Snow<S>, CubicBSpline, Mls>(threads);
}

} // namespace firn::bench
