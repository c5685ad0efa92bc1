// SPDX-License-Identifier: MIT
// What a pass of an implicit step over the particles costs beside an explicit step: a block of rubber on a
// floor to which it sticks, whose steps let a wave through 30 cells.
//     implicit_steps [rounds [particles [threads]]]
// Prints, as figures that results.py reads: medians of milliseconds of an explicit step, and of one more pass
// of an implicit one, with coarse grids and without, by the difference of steps that solve their systems to
// different shares; their ratios; the passes and products of a step, and bytes per particle of both solvers.
// The same file is compiled for a device.
#include "on_each_backend.hpp"
#include "timing.hpp"

#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;

namespace
{

constexpr double h = 0.01, wave_cells = 30; ///< [m]
using Rubber = NeoHookean<Space<3, float>>;
using Explicit = Solver<bench::Backend, Rubber, QuadraticBSpline, Mls>;
using Solved = Solver<bench::Backend, Rubber, QuadraticBSpline, Mls, Implicit>;

std::vector<Vector<double, 3>> cube(int side)
{
    std::vector<Vector<double, 3>> points;
    for (int i = 0; i < 2 * side; ++i)
        for (int j = 0; j < 2 * side; ++j)
            for (int k = 0; k < 2 * side; ++k)
                points.push_back(h * Vector<double, 3>(0.5 * i + 0.25, 0.5 * j + 0.25, 0.5 * k + 0.25));
    return points;
}

template <class Body>
Body block(int side, bench::Backend const& on, typename Body::Transfer const& transfer = {})
{
    Body body(lattice(h), {.density = 1000, .elasticity = lame<float>(1e6, 0.3)}, transfer, {}, on);
    body.add(cube(side), h * h * h / 8);
    return body;
}

/// What steps took.
struct Taken
{
    double seconds = 0, passes = 0, products = 0; ///< of a step
};

/// Steps in which gravity acts up and down by turns, so that the block does not come to rest.
template <class Body>
Taken steps(Body& body, int count, double dt)
{
    Obstacle<HalfSpace> const floor{.contact = Contact::sticky()};
    Taken taken;
    auto const start = std::chrono::steady_clock::now();
    if constexpr (requires { body.solved(); }) {
        for (int i = 0; i < count; ++i) {
            body.step(dt, Gravity{{0, i % 2 == 0 ? -9.81 : 9.81, 0}}, floor);
            taken.passes += double(body.solved().passes) / count;
            taken.products += double(body.solved().products) / count;
        }
    }
    else
        body.steps(std::size_t(count), dt, Gravity{}, floor);
    taken.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() / count;
    return taken;
}

/// On a processor so many threads.
bench::Backend backend_of([[maybe_unused]] int threads)
{
#if defined(__CUDACC__)
    return bench::backend();
#else
    return {.threads = threads};
#endif
}

void tell(char const* what, std::size_t particles, double value, char const* unit)
{
    std::printf("figure implicit/%s/%zu %.4g %s\n", what, particles, value, unit);
}

} // namespace

int main(int argc, char** argv)
{
    int const rounds = argc > 1 ? std::atoi(argv[1]) : 5;
    int const side = static_cast<int>(std::lround(std::cbrt((argc > 2 ? std::atof(argv[2]) : 1e6) / 8)));
    auto const on = backend_of(argc > 3 ? std::atoi(argv[3]) : 1);
    auto by_waves = block<Explicit>(side, on);
    // few products in a step and many, with coarse grids and without
    std::vector<Solved> blocks;
    for (bool const coarse : {true, false})
        for (double const forcing : {0.3, 1e-3})
            blocks.push_back(block<Solved>(side, on, {Mls{}, {.forcing = forcing, .coarse = coarse}}));
    double const of_wave = h / std::sqrt(double(by_waves.model().elasticity.p_wave_modulus()) / 1000);
    std::vector<double> step, pass, pass_alone, implicit_step;
    Taken of[4];
    for (int i = 0; i <= rounds; ++i) {
        Taken const one = steps(by_waves, 20, 0.3 * of_wave);
        for (std::size_t k = 0; k < 4; ++k) of[k] = steps(blocks[k], 2, wave_cells * of_wave);
        if (i == 0) continue; // it warms up
        step.push_back(one.seconds);
        implicit_step.push_back(of[0].seconds);
        pass.push_back((of[1].seconds - of[0].seconds) / (of[1].passes - of[0].passes));
        pass_alone.push_back((of[3].seconds - of[2].seconds) / (of[3].passes - of[2].passes));
    }
    std::size_t const n = by_waves.size();
    tell("explicit_step", n, 1e3 * bench::median(step), "ms");
    tell("step", n, 1e3 * bench::median(implicit_step), "ms");
    tell("pass", n, 1e3 * bench::median(pass), "ms");
    tell("pass_without_coarse", n, 1e3 * bench::median(pass_alone), "ms");
    tell("pass_of_step", n, bench::median(pass) / bench::median(step), "x");
    tell("pass_without_coarse_of_step", n, bench::median(pass_alone) / bench::median(step), "x");
    tell("passes", n, of[0].passes, "");
    tell("products", n, of[0].products, "");
    tell("explicit_bytes", n, double(by_waves.memory()) / double(n), "B");
    tell("bytes", n, double(blocks[0].memory()) / double(n), "B");
}
