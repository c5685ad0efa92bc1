// SPDX-License-Identifier: MIT
// What an implicit step costs beside an explicit one, and where its time goes: a block of rubber on a floor
// to which it sticks, whose steps let a wave through 30 cells.
//     implicit_steps [rounds [particles [threads]]]
// Prints, as figures that results.py reads: medians of milliseconds of an explicit step, of an implicit one,
// and of one more pass of it, with all that goes with it on nodes and coarse grids, by the difference of
// steps that solve their systems to different shares; the ratio; the passes and products of a step, and bytes
// per particle of both solvers. Then, of steps in which each loop is timed by itself: a product, which is the
// loop over particles alone, and its ratio to an explicit step; and of a step all products, other loops over
// particles, loops over nodes, coarse grids, and the rest, which is the host's. Processors count the time of
// their own, since others may use them, too. The same file is compiled for a device.
#include "on_each_backend.hpp"
#include "timing.hpp"

#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

using namespace firn;

namespace
{

constexpr double h = 0.01, wave_cells = 30; ///< [m]
using Rubber = NeoHookean<Space<3, float>>;

/// Loops of a kind.
enum Loop
{
    of_product,
    of_particles,
    of_nodes,
    of_coarse_grids,
    kinds
};

template <class Phase>
inline constexpr bool is_product = false;
template <class... Of>
inline constexpr bool is_product<ProductOfStress<Of...>> = true;

/// The time that loops take, kind by kind.
class Watch
{
public:
    template <class Work>
    auto take(Loop kind, Work const& work)
    {
        ++counts[kind];
#if defined(__CUDACC__)
        cudaEvent_t begin, end;
        cudaEventCreate(&begin), cudaEventCreate(&end);
        queued_.push_back({kind, begin, end});
        cudaEventRecord(begin);
        struct End
        {
            cudaEvent_t event;
            ~End() { cudaEventRecord(event); }
        } const at_end{end};
        return work();
#else
        struct End
        {
            double& sum;
            double start = bench::processor_seconds();
            ~End() { sum += bench::processor_seconds() - start; }
        } const at_end{seconds[kind]};
        return work();
#endif
    }
    /// Adds up what loops took that have finished.
    void read()
    {
#if defined(__CUDACC__)
        cudaDeviceSynchronize();
        for (auto const& [kind, begin, end] : queued_) {
            float ms = 0;
            cudaEventElapsedTime(&ms, begin, end);
            seconds[kind] += 1e-3 * ms;
            cudaEventDestroy(begin), cudaEventDestroy(end);
        }
        queued_.clear();
#endif
    }

    std::array<double, kinds> seconds{};
    std::array<int, kinds> counts{};

#if defined(__CUDACC__)
private:
    struct Queued
    {
        Loop kind;
        cudaEvent_t begin, end;
    };
    std::vector<Queued> queued_;
#endif
};

/// A backend whose loops are watched.
struct Watched : bench::Backend
{
    std::shared_ptr<Watch> watch = std::make_shared<Watch>();

    template <class Order, class LayerType, class Phase>
    auto for_each_cell(Order& cells, LayerType& layer, Phase const& phase) const
    {
        return watch->take(is_product<Phase> ? of_product : of_particles,
                           [&] { return bench::Backend::for_each_cell(cells, layer, phase); });
    }
    template <class CellOrders, class GridType, class Phase, class... Behind>
    auto for_each_node(CellOrders const& cells, GridType& grid, Phase const& phase,
                       Behind const&... behind) const
    {
        return watch->take(of_nodes,
                           [&] { return bench::Backend::for_each_node(cells, grid, phase, behind...); });
    }
    template <class... Loops>
    void for_each_in_turn(Loops const&... loops) const
    {
        watch->take(of_coarse_grids, [&] { bench::Backend::for_each_in_turn(loops...); });
    }
    template <class Body>
    void for_each(std::size_t count, Body const& body) const
    {
        watch->take(of_coarse_grids, [&] { bench::Backend::for_each(count, body); });
    }
};

template <class Backend, class... By>
using SolverOn = Solver<Backend, Rubber, QuadraticBSpline, Mls, By...>;
using Explicit = SolverOn<bench::Backend>;
using Solved = SolverOn<bench::Backend, Implicit>;
using WatchedSolver = SolverOn<Watched, Implicit>;

std::vector<Vector<double, 3>> cube(int side)
{
    std::vector<Vector<double, 3>> points;
    for (int i = 0; i < 2 * side; ++i)
        for (int j = 0; j < 2 * side; ++j)
            for (int k = 0; k < 2 * side; ++k)
                points.push_back(h * Vector<double, 3>(0.5 * i + 0.25, 0.5 * j + 0.25, 0.5 * k + 0.25));
    return points;
}

template <class Body, class Backend>
Body block(int side, Backend const& on, typename Body::Transfer const& transfer = {})
{
    Body body(lattice(h), {.density = 1000, .elasticity = lame<float>(1e6, 0.3)}, transfer, {}, on);
    body.add(cube(side), h * h * h / 8);
    return body;
}

/// Seconds that passed: on a processor those of its threads.
double seconds([[maybe_unused]] int threads)
{
#if defined(__CUDACC__)
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
#else
    return bench::processor_seconds() / threads;
#endif
}

/// What steps took.
struct Taken
{
    double seconds = 0, passes = 0, products = 0; ///< of a step
};

/// Steps in which gravity acts up and down by turns, so that the block does not come to rest.
template <class Body>
Taken steps(Body& body, int count, double dt, int threads)
{
    Obstacle<HalfSpace> const floor{.contact = Contact::sticky()};
    Taken taken;
    double const start = seconds(threads);
    if constexpr (requires { body.solved(); }) {
        for (int i = 0; i < count; ++i) {
            body.step(dt, Gravity{{0, i % 2 == 0 ? -9.81 : 9.81, 0}}, floor);
            taken.passes += double(body.solved().passes) / count;
            taken.products += double(body.solved().products) / count;
        }
    }
    else
        body.steps(std::size_t(count), dt, Gravity{}, floor);
    taken.seconds = (seconds(threads) - start) / count;
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
    int const threads = argc > 3 ? std::atoi(argv[3]) : 1;
    auto const on = backend_of(threads);
    auto by_waves = block<Explicit>(side, on);
    // few products in a step, and many
    auto few = block<Solved>(side, on, {Mls{}, {.forcing = 0.3}}),
         many = block<Solved>(side, on, {Mls{}, {.forcing = 1e-3}});
    Watched const watched{on};
    auto timed = block<WatchedSolver>(side, watched);
    double const of_wave = h / std::sqrt(double(by_waves.model().elasticity.p_wave_modulus()) / 1000);
    std::vector<double> step, pass, implicit_step, product_alone;
    Taken of_few, of_many;
    std::array<double, kinds + 1> of_step{}; // and the rest
    auto const watch = [&] {                 // a step whose loops are timed
        Watch& its = *watched.watch;
        its.read();
        its.seconds = {}, its.counts = {};
        double const all = steps(timed, 2, wave_cells * of_wave, threads).seconds;
        its.read();
        for (auto& sum : its.seconds) sum /= bench::on_a_device ? 1 : threads;
        product_alone.push_back(its.seconds[of_product] / its.counts[of_product]);
        for (std::size_t kind = 0; kind < kinds; ++kind) of_step[kind] = its.seconds[kind] / 2;
        of_step[kinds] = all - std::accumulate(of_step.begin(), of_step.begin() + kinds, 0.0);
    };
    for (int i = 0; i <= rounds; ++i) {
        Taken const one = steps(by_waves, 20, 0.3 * of_wave, threads);
        of_few = steps(few, 2, wave_cells * of_wave, threads);
        of_many = steps(many, 2, wave_cells * of_wave, threads);
        watch();
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
    tell("product", n, 1e3 * bench::median(product_alone), "ms");
    tell("product_of_step", n, bench::median(product_alone) / bench::median(step), "x");
    tell("passes", n, of_few.passes, "");
    tell("products", n, of_few.products, "");
    tell("explicit_bytes", n, double(by_waves.memory()) / double(n), "B");
    tell("bytes", n, double(few.memory()) / double(n), "B");
    constexpr char const* names[] = {"all_products", "other_passes", "nodes", "coarse_grids", "rest"};
    for (std::size_t kind = 0; kind <= kinds; ++kind) tell(names[kind], n, 1e3 * of_step[kind], "ms");
}
