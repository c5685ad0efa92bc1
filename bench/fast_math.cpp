// SPDX-License-Identifier: MIT
// What flags such as -ffast-math and nvcc's --use_fast_math cost in accuracy and save in time: to be compiled
// with them and without, for either backend, and run by turns: fast_math [THREADS [RUNS]]. One value a line.
#include "problems/manufactured.hpp"
#include "problems/snow_block.hpp"
#include "timing.hpp"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <random>
#include <vector>

namespace
{

using namespace firn;
using Backend = test::TestedBackend;

#if defined(__CUDACC__)
Backend backend_with(int) { return {}; }
#else
Backend backend_with(int threads) { return {.threads = threads}; }
#endif

/// Of the processor, or with a device, for which the host waits, of the clock.
double seconds()
{
#if defined(__CUDACC__)
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
#else
    return bench::processor_seconds();
#endif
}

/// A number that differs where one bit of any position does (FNV-1a).
template <class Solver>
std::uint64_t fingerprint(Solver const& solver)
{
    std::uint64_t hash = 14695981039346656037u;
    for (auto const& x : solver.positions())
        for (int a = 0; a < int(x.size()); ++a)
            hash = (hash ^ std::bit_cast<std::uint64_t>(x[a])) * 1099511628211u;
    return hash;
}

constexpr int d = 3;

/// The stress that a model answers to deformation gradients F - I, for as many as a lane holds.
template <class Model>
struct StressOf
{
    using Real = test::TestedLane<float>;
    static constexpr std::size_t width = std::size_t(lane_width<Real>);

    Model model;
    float const* gradients; ///< components of a group of lanes one behind another
    float* stresses;

    FIRN_HOST_DEVICE void operator()(std::size_t group) const
    {
        auto particle = Record<Real, d, typename Model::State>::at_rest();
        std::size_t const first = group * d * d * width;
        for (int c = 0; c < d * d; ++c)
            particle[DisplacementGradient{}](c / d, c % d) =
                LaneTraits<Real>::load(gradients + first + std::size_t(c) * width);
        Matrix<Real, d> const still = zeros<Matrix<Real, d>>();
        auto const response = model.template respond<Real>(particle, still, Real(0));
        for (int c = 0; c < d * d; ++c)
            LaneTraits<Real>::store(response.kirchhoff_stress(c / d, c % d),
                                    stresses + first + std::size_t(c) * width);
    }
};

/// The largest error of the stress in single precision, of its norm, at random strains up to `largest`,
/// beside double precision on the host; and the mean one.
template <template <class> class ModelOf>
void measure_stress(char const* name, float largest, Backend const& backend)
{
    using Stress = StressOf<ModelOf<Space<d, float>>>;
    constexpr std::size_t groups = 4096, count = groups * d * d * Stress::width;
    std::vector<float> gradients(count), stresses(count);
    std::mt19937 random(1);
    std::uniform_real_distribution<float> strain(-largest, largest);
    for (float& H : gradients) H = strain(random);
    typename Backend::template Array<float> from(backend), to(backend);
    from.resize(count);
    to.resize(count);
    from.upload(0, gradients);
    backend.for_each(groups, Stress{{}, from.data(), to.data()});
    to.download(0, stresses);

    using Exact = ModelOf<Space<d, double>>;
    Exact const exact{};
    double worst = 0, sum = 0;
    for (std::size_t i = 0; i < groups * Stress::width; ++i) {
        auto particle = Record<double, d, typename Exact::State>::at_rest();
        Matrix<double, d> found;
        for (int c = 0; c < d * d; ++c) {
            std::size_t const place =
                (i / Stress::width * d * d + std::size_t(c)) * Stress::width + i % Stress::width;
            particle[DisplacementGradient{}](c / d, c % d) = double(gradients[place]);
            found(c / d, c % d) = double(stresses[place]);
        }
        Matrix<double, d> const still = Matrix<double, d>::Zero();
        Matrix<double, d> const tau = exact.template respond<double>(particle, still, 0.0).kirchhoff_stress;
        double const error = (found - tau).norm() / tau.norm();
        worst = std::max(worst, error);
        sum += error;
    }
    std::printf("stress of %s, strains up to %g: error at most %.3g, in the mean %.3g\n", name, largest,
                worst, sum / double(groups * Stress::width));
}

/// Goes through a problem some times, and tells the median of the seconds of its steps.
template <class Make, class Tell>
void measure_steps(char const* name, int runs, Make const& make, Tell const& tell)
{
    std::vector<double> spent;
    for (int run = 0; run < runs; ++run) {
        auto problem = make();
        double taken = 0;
        for (int piece = 0; piece < problem.pieces; ++piece) {
            double const before = seconds();
            problem.advance(piece);
            taken += seconds() - before;
            problem.observe(piece);
        }
        spent.push_back(taken);
        if (run == 0) tell(problem);
    }
    std::sort(spent.begin(), spent.end());
    std::printf("%s: %.4f s\n", name, spent[spent.size() / 2]);
}

} // namespace

int main(int argc, char** argv)
{
    int const threads = argc > 1 ? std::atoi(argv[1]) : 1, runs = argc > 2 ? std::atoi(argv[2]) : 1;
    Backend const backend = backend_with(threads);

    for (float largest : {0.2f, 1e-5f}) {
        measure_stress<Hencky>("Hencky", largest, backend);
        measure_stress<FixedCorotated>("fixed corotated", largest, backend);
        measure_stress<NeoHookean>("neo-Hookean", largest, backend);
    }

    using Waves = test::ManufacturedSolution<test::Scene<NeoHookean<test::PlaneFloat>, CubicBSpline, Mls>>;
    for (int cells : {32, 128})
        measure_steps(
            "waves", runs, [&] { return Waves(cells, 2, {}, {}, backend); },
            [&](Waves const& waves) {
                std::printf("waves in %d cells: error %.5g, bits %016llx\n", cells, waves.error(),
                            static_cast<unsigned long long>(fingerprint(waves.solver)));
            });

    using Block = test::SnowBlock<test::Scene<Snow<test::PlaneFloat>, QuadraticBSpline, Mls>>;
    measure_steps(
        "block", runs, [&] { return Block(64, 2, {}, {}, backend); },
        [&](Block const& block) {
            std::printf(
                "block of snow: error %.5g of its height, %.3g of its momentum, energy left %.6g, bits "
                "%016llx\n",
                block.error(), block.momentum_error(), block.kinetic_energy(),
                static_cast<unsigned long long>(fingerprint(block.solver)));
        });
    return 0; // in one unit with other benches the compiler asks for it
}
