// SPDX-License-Identifier: MIT
#include "../examples/meshes.hpp"

#include <firn/openmp.hpp>
#include <firn/sampling/mesh_interior.hpp>
#include <firn/sampling/points.hpp>
#include <firn/sampling/poisson_disk_points.hpp>

#include <benchmark/benchmark.h>

#include <string>

// Particles from a mesh: the heads of the examples, one of them to be filled, and a torus, 100 000 points
// each.
namespace firn::bench
{

void add_sampling(int threads)
{
    auto const add = [&](std::string const& name, TriangleMesh const& mesh, auto const& sample) {
        benchmark::RegisterBenchmark(("sampling/openmp/" + name + "/100000").c_str(),
                                     [=](benchmark::State& run) {
                                         std::size_t points = 0;
                                         for (auto _ : run) {
                                             MeshInterior const solid(mesh, Repair::fill, OpenMP{threads});
                                             points = sample(solid, OpenMP{threads}).points.size();
                                         }
                                         run.counters["points_per_second"] = benchmark::Counter(
                                             double(points), benchmark::Counter::kIsIterationInvariantRate);
                                     })
            ->Unit(benchmark::kMillisecond)
            ->UseRealTime();
    };
    constexpr std::size_t count = 100000;
    for (auto const& [name, mesh] : {std::pair{"head", examples::head()},
                                     {"open_head", examples::open_head()},
                                     {"torus", examples::torus(1, 0.4)}}) {
        std::string const of = name;
        add("lattice/" + of, mesh, [](auto const& solid, auto const& loop) {
            return lattice_points(solid, Count{count}, 0.5, 1, loop);
        });
        add("uniform/" + of, mesh,
            [](auto const& solid, auto const& loop) { return uniform_points(solid, Count{count}, 1, loop); });
        add("poisson_disk/" + of, mesh, [](auto const& solid, auto const& loop) {
            return poisson_disk_points(solid, Count{count}, 1, loop);
        });
    }
}

} // namespace firn::bench
