// SPDX-License-Identifier: MIT
// What it gives that a fluid keeps its volume, and what it costs: see KeepsVolume.
//     liquids [seconds] [rounds]
// Prints, in the plane, the level and the speed of still water over so many seconds (10), in a tank whose
// walls lie on nodes, half a cell off, or tilted against the cells; then of water that is shaken by half of
// gravity for five seconds and left alone for as long. The level is the mean height over the right one less
// what the water's kinetic energy could raise it by. Then, in space, medians of milliseconds per step by
// turns (9 rounds).
#include "block.hpp"
#include "tank.hpp"
#include "timing.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/models/fluids/keeps_volume.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;

namespace
{

template <class Model, class Kernel, class Transfer>
void still(char const* name, double seconds)
{
    struct Place
    {
        double degrees;
        Eigen::Vector2d offset = bench::TankSetting{}.offset; ///< [cells]
    };
    for (auto const& [degrees, offset] :
         {Place{0, {0, 0}}, Place{0, {0.5, 0.5}}, Place{.degrees = 17}, Place{.degrees = 30}}) {
        bench::Tank<Model, Kernel, Transfer> tank({.degrees = degrees, .offset = offset});
        std::printf("still  %-24s %2.0f degrees, %.2f cells off", name, degrees, offset.x());
        for (int i = 1; i <= 4; ++i) {
            tank.advance(seconds / 4);
            std::printf("%s %4.1f s: level %+.2f %%, %.4f m/s", i > 1 ? "," : ":", i * seconds / 4,
                        tank.level(), tank.speed());
        }
        std::printf("\n");
    }
}

template <class Model, class Kernel, class Transfer>
void sloshed(char const* name, double seconds)
{
    bench::Tank<Model, Kernel, Transfer> tank({.depth = 0.25, .fastest = 4});
    double const of_call = 0.02, shaken = 5;
    double time = 0;
    for (; time < shaken; time += of_call)
        tank.advance(of_call, 0.5 * std::sin(2 * M_PI * tank.frequency() * time));
    std::printf("shaken %-24s", name);
    int const means = 4;
    for (int i = 0; i < means; ++i) { // of all phases of the waves
        double level = 0, speed = 0;
        int const count = 50;
        for (int k = 0; k < count; ++k) {
            tank.advance(seconds / (means * count));
            level += tank.level() / count;
            speed += tank.speed() / count;
        }
        std::printf("%s %4.1f to %4.1f s after: level %+.2f %%, %.3f m/s", i > 0 ? "," : ":",
                    i * seconds / means, (i + 1) * seconds / means, level, speed);
    }
    std::printf("\n");
}

void cost(int rounds)
{
    auto const water = materials::water<Space<3, float>>();
    using bench::side;
    auto plain = bench::block(side, side, side, water);
    auto kept = bench::block<KeepsVolume<Fluid<Space<3, float>>>>(side, side, side, water);
    Obstacles<AnyShape<>, ActsOn::surface> floor;
    floor.list.push_back({.shape = HalfSpace{}});
    double const dt =
        0.8 * plain.stable_step(Gravity{}, floor); // it stays stable while the water falls apart
    constexpr std::size_t steps = 80;              // some four corrections
    auto const seconds_of = [&](auto& solver) {
        auto const start = std::chrono::steady_clock::now();
        solver.steps(steps, dt, Gravity{}, floor);
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() /
               double(steps);
    };
    std::vector<double> seconds[2];
    for (int i = 0; i < rounds + 1; ++i) {
        double const of[]{seconds_of(plain), seconds_of(kept)};
        for (int k = 0; k < 2 && i > 0; ++k) seconds[k].push_back(of[k]); // the first warms up
    }
    double const without = bench::median(seconds[0]), with = bench::median(seconds[1]);
    std::printf("cost   %.0f particles on a floor: %.3f ms a step, %.3f ms keeping the volume: %.3f\n",
                double(plain.size()), 1e3 * without, 1e3 * with, with / without);
}

} // namespace

int main(int argc, char** argv)
{
    double const seconds = argc > 1 ? std::atof(argv[1]) : 10;
    int const rounds = argc > 2 ? std::atoi(argv[2]) : 9;
    using Water = Fluid<bench::Plane>;
    if (seconds > 0) {
        still<Water, QuadraticBSpline, Mls>("Fluid, quadratic MLS", seconds);
        still<KeepsVolume<Water>, QuadraticBSpline, Mls>("kept, quadratic MLS", seconds);
        sloshed<Water, QuadraticBSpline, Mls>("Fluid, quadratic MLS", seconds);
        sloshed<KeepsVolume<Water>, QuadraticBSpline, Mls>("kept, quadratic MLS", seconds);
        sloshed<KeepsVolume<Water>, QuadraticBSpline, Apic>("kept, quadratic APIC", seconds);
        sloshed<KeepsVolume<Water>, QuadraticBSpline, Flip>("kept, quadratic FLIP", seconds);
        sloshed<KeepsVolume<Water>, CubicBSpline, Mls>("kept, cubic MLS", seconds);
        sloshed<KeepsVolume<Water>, CubicBSpline, Apic>("kept, cubic APIC", seconds);
        sloshed<KeepsVolume<Water>, CubicBSpline, Flip>("kept, cubic FLIP", seconds);
    }
    if (rounds > 0) cost(rounds);
}
