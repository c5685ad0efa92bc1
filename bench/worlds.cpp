// SPDX-License-Identifier: MIT
// What many worlds cost beside one scene of as many particles: steps of both by turns, and the time in which
// worlds are reset.
//     worlds [rounds [worlds [side [steps of a call [obstacles of each world]]]]]
// Each world is a block of side^3 particles on the ground, jittered, and balls that touch a side of it; the
// one scene is a block of as many particles, with neither a gap nor a border between, and as many balls along
// its side. In a third scene, of one world, as many small blocks lie apart, each with its balls: it says what
// borders cost. Prints medians of milliseconds per step. The same file is compiled for a device.
#include "on_each_backend.hpp"
#include "timing.hpp"

#include <firn/worlds.hpp>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

using namespace firn;

namespace
{

using Single = Solver<bench::Backend, NeoHookean<Space<3, float>>>;
double const h = 0.05;

/// A block on the ground, of particles beside the points of a lattice, eight in each cell.
std::vector<Eigen::Vector3d> block(int x, int y, int z)
{
    std::mt19937 random(1);
    std::uniform_real_distribution<double> beside(-0.1, 0.1);
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < x; ++i)
        for (int j = 0; j < y; ++j)
            for (int k = 0; k < z; ++k)
                points.push_back(h / 2 *
                                 Eigen::Vector3d(i + 0.5 + beside(random), j + 0.5 + beside(random),
                                                 k + 0.5 + beside(random)));
    return points;
}

template <class Work>
double seconds_of(Work const& work)
{
    auto const start = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

} // namespace

int main(int argc, char** argv)
{
    auto const argument = [&](int i, int otherwise) { return argc > i ? std::atoi(argv[i]) : otherwise; };
    int const rounds = argument(1, 5), count = argument(2, bench::on_a_device ? 148 : 12),
              side = argument(3, 22), of_call = argument(4, 20), obstacles = argument(5, 1);
    double const volume = std::pow(h / 2, 3);

    Worlds<Single> worlds(std::uint32_t(count), lattice(h), Single::Model{}, Single::Transfer{},
                          StepControl{}, bench::backend());
    auto const ball = [](double x, double z) {
        return Obstacle<AnyShape<>>{.shape = Sphere{0.1}, .motion = {.position = {x - 0.1, 0.2, z}}};
    };
    for (std::uint32_t w = 0; w < worlds.count(); ++w) {
        worlds.add(w, block(side, side, side), volume);
        for (int i = 0; i < obstacles; ++i) worlds.obstacles(w).push_back(ball(0, 0.2 * (i + 1)));
    }
    auto const start = worlds.save(0);
    Single one(lattice(h), {}, {}, {}, bench::backend());
    int const wide = static_cast<int>(std::lround(std::sqrt(count * double(side) * side)));
    one.add(block(wide, side, wide), volume);
    Obstacles<> beside_one, beside_each;
    for (int i = 0; i < obstacles * count; ++i)
        beside_one.list.push_back(ball(0, (i + 0.5) * wide * h / 2 / (obstacles * count)));

    Single apart(lattice(h), {}, {}, {}, bench::backend());
    int const row = static_cast<int>(std::ceil(std::sqrt(count)));
    for (int w = 0; w < count; ++w) {
        auto points = block(side, side, side);
        double const step = h * 4 * (side / 8 + 2); // whole blocks of the grid
        Eigen::Vector3d const at = step * Eigen::Vector3d(w % row, 0, w / row);
        for (auto& x : points) x += at;
        apart.add(points, volume);
        for (int i = 0; i < obstacles; ++i) beside_each.list.push_back(ball(at.x(), at.z() + 0.2 * (i + 1)));
    }

    Obstacle<HalfSpace> const ground{};
    double const dt = 0.5 * one.stable_step(Gravity{}, ground);
    auto const steps_of = [&](auto& scene, auto const&... balls) {
        return seconds_of([&] { scene.steps(std::size_t(of_call), dt, Gravity{}, ground, balls...); }) /
               of_call;
    };
    std::vector<double> seconds[5];
    for (int i = 0; i < rounds + 1; ++i) {
        double const of[]{steps_of(one, beside_one), steps_of(worlds),
                          seconds_of([&] { worlds.reset(std::uint32_t(i % count), start); }), seconds_of([&] {
                              std::vector<std::uint32_t> tenth;
                              for (int w = 0; w < count; w += 10) tenth.push_back(std::uint32_t(w));
                              worlds.reset(tenth, start);
                          }),
                          steps_of(apart, beside_each)};
        for (int k = 0; k < 5 && i > 0; ++k) seconds[k].push_back(of[k]); // the first warms up
    }
    double const in_one = double(one.size()), in_worlds = double(worlds.solver().size());
    auto const share = [&](int k) {
        return (bench::median(seconds[0]) / in_one) / (bench::median(seconds[k]) / in_worlds);
    };
    std::printf("one scene   %9.0f particles %8.3f ms a step\n", in_one, 1e3 * bench::median(seconds[0]));
    std::printf("blocks apart %8.0f particles %8.3f ms a step: %.3f of the one scene's rate\n", in_worlds,
                1e3 * bench::median(seconds[4]), share(4));
    std::printf("%4d worlds %9.0f particles %8.3f ms a step, %d to a call: %.3f of the one scene's rate\n",
                count, in_worlds, 1e3 * bench::median(seconds[1]), of_call, share(1));
    std::printf("reset of one world %.3f ms, of every tenth %.3f ms\n", 1e3 * bench::median(seconds[2]),
                1e3 * bench::median(seconds[3]));
}
