// SPDX-License-Identifier: MIT
// What a pass of an implicit step over the particles costs beside an explicit step, with all that goes with
// it on nodes and coarse grids: a block of rubber on a floor to which it sticks, whose steps let a wave
// through 30 cells.
//     implicit_steps [rounds [particles [threads]]]
// Prints, as figures that results.py reads: medians of milliseconds of an explicit step, of an implicit one,
// and of one more pass of it, by the difference of steps that solve their systems to different shares; the
// ratio; the passes and products of a step, and bytes per particle of both solvers. The same file is compiled
// for a device.
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
    // few products in a step, and many
    auto few = block<Solved>(side, on, {Mls{}, {.forcing = 0.3}}),
         many = block<Solved>(side, on, {Mls{}, {.forcing = 1e-3}});
    double const of_wave = h / std::sqrt(double(by_waves.model().elasticity.p_wave_modulus()) / 1000);
    std::vector<double> step, pass, implicit_step;
    Taken of_few, of_many;
    for (int i = 0; i <= rounds; ++i) {
        Taken const one = steps(by_waves, 20, 0.3 * of_wave);
        of_few = steps(few, 2, wave_cells * of_wave);
        of_many = steps(many, 2, wave_cells * of_wave);
        if (i == 0) continue; // it warms up
        step.push_back(one.seconds);
        implicit_step.push_back(of_few.seconds);
        pass.push_back((of_many.seconds - of_few.seconds) / (of_many.passes - of_few.passes));
    }
    std::size_t const n = by_waves.size();
    tell("explicit_step", n, 1e3 * bench::median(step), "ms");
    tell("step", n, 1e3 * bench::median(implicit_step), "ms");
    tell("pass", n, 1e3 * bench::median(pass), "ms");
    tell("pass_of_step", n, bench::median(pass) / bench::median(step), "x");
    tell("passes", n, of_few.passes, "");
    tell("products", n, of_few.products, "");
    tell("explicit_bytes", n, double(by_waves.memory()) / double(n), "B");
    tell("bytes", n, double(few.memory()) / double(n), "B");
}
