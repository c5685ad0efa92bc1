// SPDX-License-Identifier: MIT
// What contact at the surface costs beside contact on nodes: steps by turns of a block on a floor, and of a
// bar between three walls, where a large part of the cells touches one of them.
//     at_surface [rounds]
// Prints medians of milliseconds per step, and their ratio, as figures that results.py reads. The same file
// is compiled for a device.
#include "block.hpp"
#include "timing.hpp"

#include <firn/effects/obstacles.hpp>

#include <algorithm>
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
    char const* const rules[]{"on_nodes", "at_surface"};
    for (int k = 0; k < 2; ++k) {
        auto const [least, most] = std::minmax_element(seconds[k].begin(), seconds[k].end());
        double const median = bench::median(seconds[k]);
        std::printf("figure contact/%s/%zu/%s %.5g ms %.3f\n", name, by_nodes.size(), rules[k], 1e3 * median,
                    (*most - *least) / 2 / median);
    }
    std::printf("figure contact/%s/%zu/ratio %.4g x\n", name, by_nodes.size(),
                bench::median(seconds[1]) / bench::median(seconds[0]));
}

} // namespace

int main(int argc, char** argv)
{
    int const rounds = argc > 1 ? std::atoi(argv[1]) : 9;
    Obstacle<AnyShape<>> const floor{.shape = HalfSpace{}};
    auto const wall = [](double towards, double z) {
        return Obstacle<AnyShape<>>{.shape = HalfSpace{{0, 0, towards}},
                                    .motion = {.position = {0, 0, z}, .time = 0}};
    };
    compare("floor", side, side, side, {floor}, rounds);
    if (bench::on_a_device) compare("floor", 2 * side, 2 * side, 2 * side, {floor}, rounds);
    int const narrow = 24; // a third of its cells lie at a wall
    int const length = side * side * side / (narrow * narrow) / 2;
    std::vector<Obstacle<AnyShape<>>> walls{floor, wall(1, 0), wall(-1, narrow * h / 2)};
    compare("three_walls", length, narrow, narrow, walls, rounds);
    for (auto& each : walls) each.motion.velocity = {1, 0, 1}, each.motion.time = 0;
    compare("moving_walls", length, narrow, narrow, walls, rounds);
}
