// SPDX-License-Identifier: MIT
// What contact between bodies costs: steps by turns of blocks in a row that touch, as one material, as so
// many Materials, and as so many Bodies:
//     bodies [rounds]
// Prints medians of milliseconds per step, their ratio to the first, and the bytes of each solver. The same
// file is compiled for a device.
#include "timing.hpp"

#include <firn/firn.hpp>
#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#else
#include <firn/openmp.hpp>
#endif

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

using namespace firn;

namespace
{

#if defined(__CUDACC__)
using Backend = Cuda;
int const side = 128; // particles along each axis of all blocks together
Backend backend() { return {}; }
#else
using Backend = OpenMP;
int const side = 64;
Backend backend() { return {.threads = 1}; }
#endif
using Block = NeoHookean<Space<3, float>>;

double const h = 0.05;

/// A scene of as many blocks as the model has materials.
template <class Model>
Solver<Backend, Model> row_of()
{
    Solver<Backend, Model> solver(lattice(h), Model{}, {}, {}, backend());
    constexpr int blocks = int(Solver<Backend, Model>::materials);
    auto const add = [&](int block, [[maybe_unused]] auto material) {
        std::vector<Eigen::Vector3d> points;
        for (int i = side * block / blocks; i < side * (block + 1) / blocks; ++i)
            for (int j = 0; j < side; ++j)
                for (int l = 0; l < side; ++l)
                    points.push_back(h / 2 * Eigen::Vector3d(i + 0.5, j + 0.5, l + 0.5));
        solver.template add<decltype(material)>(points, std::pow(h / 2, 3));
    };
    [&]<std::size_t... k>(std::index_sequence<k...>) { (add(int(k), Material<k>{}), ...); }
    (std::make_index_sequence<std::size_t(blocks)>{});
    return solver;
}

/// Seconds per step of a call of ten steps.
template <class SolverType>
double timed(SolverType& solver, double dt)
{
    auto const start = std::chrono::steady_clock::now();
    solver.steps(10, dt, Gravity{}, Obstacle<HalfSpace>{});
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / 10;
}

template <class SeveralMaterials, class SeveralBodies>
void compare(int rounds)
{
    auto one = row_of<Block>();
    auto materials = row_of<SeveralMaterials>();
    auto bodies = row_of<SeveralBodies>();
    double const dt = 0.5 * one.stable_step(Gravity{}, Obstacle<HalfSpace>{});
    std::vector<double> seconds[3];
    for (int i = 0; i < rounds; ++i) {
        seconds[0].push_back(timed(one, dt));
        seconds[1].push_back(timed(materials, dt));
        seconds[2].push_back(timed(bodies, dt));
    }
    char const* const names[]{"one material", "Materials", "Bodies"};
    double const bytes[]{double(one.memory()), double(materials.memory()), double(bodies.memory())};
    double const first = bench::median(seconds[0]);
    std::printf("%zu particles, %zu blocks\n", one.size(), bodies.materials);
    for (int i = 0; i < 3; ++i) {
        double const middle = bench::median(seconds[i]);
        std::printf("%-13s %8.3f ms %6.3f  %7.1f MB\n", names[i], 1e3 * middle, middle / first,
                    bytes[i] / 1e6);
    }
}

} // namespace

int main(int argc, char** argv)
{
    int const rounds = argc > 1 ? std::atoi(argv[1]) : 15;
    compare<Materials<Block, Block>, BodiesOf<Block, 2>>(rounds);
    compare<Materials<Block, Block, Block, Block, Block, Block, Block, Block>, BodiesOf<Block, 8>>(rounds);
}
