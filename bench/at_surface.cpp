// SPDX-License-Identifier: MIT
// What contact at the surface costs beside contact on nodes: steps by turns of a block on a floor, and of a
// bar between three walls, where a large part of the cells touches one of them.
//     at_surface [rounds]
// Prints medians of milliseconds per step, and their ratio. The same file is compiled for a device.
#include "block.hpp"
#include "timing.hpp"

#include <firn/effects/obstacles.hpp>

#include <chrono>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;

namespace
{

using bench::h, bench::side;
constexpr std::size_t steps_of_call = 40;

void compare(char const* name, int x, int y, int z, std::vector<Obstacle<AnyShape<>>> const& walls,
             int rounds)
{
    auto by_nodes = bench::block(x, y, z), by_points = bench::block(x, y, z);
    Obstacles<> const on_nodes{walls};
    Obstacles<AnyShape<>, ActsOn::surface> const at_surface{walls};
    double const dt = 0.5 * by_nodes.stable_step(Gravity{}, on_nodes);
    auto const seconds_of = [&](auto& solver, auto const& obstacles) {
        auto const start = std::chrono::steady_clock::now();
        solver.steps(steps_of_call, dt, Gravity{}, obstacles);
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() /
               steps_of_call;
    };
    std::vector<double> seconds[2];
    for (int i = 0; i < rounds + 1; ++i) {
        double const of[]{seconds_of(by_nodes, on_nodes), seconds_of(by_points, at_surface)};
        for (int k = 0; k < 2 && i > 0; ++k) seconds[k].push_back(of[k]); // the first warms up
    }
    double const nodes = bench::median(seconds[0]), points = bench::median(seconds[1]);
    std::printf("%s %9.0f particles: on nodes %.3f ms, at the surface %.3f ms: %.3f\n", name,
                double(by_nodes.size()), 1e3 * nodes, 1e3 * points, points / nodes);
}

} // namespace

int main(int argc, char** argv)
{
    int const rounds = argc > 1 ? std::atoi(argv[1]) : 9;
    Obstacle<AnyShape<>> const floor{.shape = HalfSpace{}};
    auto const wall = [](double towards, double z) {
        return Obstacle<AnyShape<>>{.shape = HalfSpace{{0, 0, towards}}, .motion = {.position = {0, 0, z}}};
    };
    compare("a floor    ", side, side, side, {floor}, rounds);
    int const narrow = 24; // a third of its cells lie at a wall
    compare("three walls", side * side * side / (narrow * narrow) / 2, narrow, narrow,
            {floor, wall(1, 0), wall(-1, narrow * h / 2)}, rounds);
}
