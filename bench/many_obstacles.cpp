// SPDX-License-Identifier: MIT
// What obstacles cost that are far from most nodes: steps by turns with a floor and a ball as two arguments,
// with both as one, with 198 crates beside them, and with all of these acting on particles, too:
//     many_obstacles [rounds]
// Prints medians of milliseconds per step, and their ratio to the first, as figures that results.py reads.
// The same file is compiled for a device.
#include "block.hpp"
#include "timing.hpp"

#include <firn/effects/obstacles.hpp>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;
using bench::h, bench::side;

int main(int argc, char** argv)
{
    int const rounds = argc > 1 ? std::atoi(argv[1]) : 15;
    double const width = side * h / 2;
    Obstacle<HalfSpace> const ground{.contact = Contact::coulomb(0.3)};
    Obstacle<Sphere> const ball{
        .shape = {0.2}, .motion = {.position = {width / 2, 0.1, width / 2}, .angular_velocity = {0, 3, 0}}};
    Obstacles<> both{
        {{.shape = ground.shape, .contact = ground.contact}, {.shape = ball.shape, .motion = ball.motion}}};
    Obstacles<> all = both;
    for (int i = 0; i < 198; ++i)
        all.list.push_back(
            {.shape = Box{{0.8 * h, 0.8 * h, 0.8 * h}},
             .motion = {.position = {width * (i % 14 + 0.5) / 14, h, width * (i / 14 + 0.5) / 15},
                        .angular_velocity = {0, 1, 0}}});
    Obstacles<AnyShape<>, ActsOn::particles> hard{all.list};
    for (auto& obstacle : hard.list) obstacle.on_particles = true;
    auto const block = [] { return bench::block(side, side / 2, side); };
    auto apart = block(), together = block(), crowded = block(), pushed = block();
    double const dt = 0.5 * apart.stable_step(Gravity{}, ground, ball);
    std::vector<double> seconds[4];
    for (int i = 0; i < rounds; ++i) {
        seconds[0].push_back(bench::seconds_per_step(apart, dt, ground, ball));
        seconds[1].push_back(bench::seconds_per_step(together, dt, both));
        seconds[2].push_back(bench::seconds_per_step(crowded, dt, all));
        seconds[3].push_back(bench::seconds_per_step(pushed, dt, hard));
    }
    char const* const names[]{"two_arguments", "list_of_2", "list_of_200", "list_of_200_on_particles"};
    double const first = bench::median(seconds[0]);
    for (int i = 0; i < 4; ++i) {
        auto const [least, longest] = std::minmax_element(seconds[i].begin(), seconds[i].end());
        double const middle = bench::median(seconds[i]), spread = (*longest - *least) / 2 / middle;
        std::printf("figure obstacles/step/%s %.5g ms %.3f\n", names[i], 1e3 * middle, spread);
        if (i > 0) std::printf("figure obstacles/step/%s_over_two %.4f x\n", names[i], middle / first);
    }
}
