// SPDX-License-Identifier: MIT
// What contact between bodies costs: steps by turns of blocks in a row that touch, as one material, as so
// many Materials, and as so many Bodies:
//     bodies [rounds]
// Prints medians of milliseconds per step, their ratio to the first, and the bytes of each solver. The same
// file is compiled for a device.
#include "on_each_backend.hpp"
#include "timing.hpp"

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>
#include <vector>

using namespace firn;

namespace
{

using bench::Backend;
int const side = bench::on_a_device ? 128 : 64; // particles along each axis of all blocks together
using Block = NeoHookean<Space<3, float>>;

double const h = 0.05;

/// A scene of as many blocks as the model has materials.
template <class Model>
Solver<Backend, Model> row_of()
{
    Solver<Backend, Model> solver(lattice(h), Model{}, {}, {}, bench::backend());
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

template <class SeveralMaterials, class SeveralBodies>
void compare(int rounds)
{
    auto one = row_of<Block>();
    auto materials = row_of<SeveralMaterials>();
    auto bodies = row_of<SeveralBodies>();
    double const dt = 0.5 * one.stable_step(Gravity{}, Obstacle<HalfSpace>{});
    std::vector<double> seconds[3];
    for (int i = 0; i < rounds; ++i) {
        seconds[0].push_back(bench::seconds_per_step(one, dt, Obstacle<HalfSpace>{}));
        seconds[1].push_back(bench::seconds_per_step(materials, dt, Obstacle<HalfSpace>{}));
        seconds[2].push_back(bench::seconds_per_step(bodies, dt, Obstacle<HalfSpace>{}));
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
