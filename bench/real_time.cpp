// SPDX-License-Identifier: MIT
// What holds 60 frames a second here: a cube of 1 m falls beside a ball and on it, in frames of 1/60 s whose
// last step is not cut, with finer and finer cells until a frame takes twice as long as it may:
//     real_time [--frames N] [--threads N]
// Prints medians and the slowest of the frames. The same file is compiled for a device (real_time_cuda).
#include "timing.hpp"

#include <firn/budget.hpp>
#include <firn/firn.hpp>
#if defined(__CUDACC__)
#include <firn/cuda.hpp>
#else
#include <firn/openmp.hpp>
#endif

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace
{

#if defined(__CUDACC__)
using Backend = firn::Cuda;
std::string info() { return firn::cuda_info(); }
Backend backend(int) { return {}; }
#else
using Backend = firn::OpenMP;
std::string info() { return firn::openmp_info(); }
Backend backend(int threads) { return {.threads = threads}; }
#endif

using Space = firn::Space<3, float>;
constexpr double frame = 1.0 / 60; // [s]

/// Frames of one scene.
struct Measured
{
    std::size_t particles = 0;
    double steps = 0;            ///< per frame
    std::vector<double> seconds; ///< of each frame
};

template <class Kernel, class Model>
Measured measure(Model const& material, int cells, int frames, int threads)
{
    double const h = 1.0 / cells;
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 8 * cells * cells * cells; ++i) {
        Eigen::Vector3d const place(i % (2 * cells), i / (2 * cells) % (2 * cells), i / (4 * cells * cells));
        points.push_back(h / 2 * (place + Eigen::Vector3d(0.5, 1.5, 0.5)));
    }
    firn::Solver<Backend, Model, Kernel, firn::Mls> solver(firn::lattice(h), material, {}, {},
                                                           backend(threads));
    solver.add(points, h * h * h / 8);
    firn::Obstacle<firn::HalfSpace> const ground{.contact = firn::Contact::coulomb(0.3)};
    firn::Obstacle<firn::Sphere> const ball{
        .shape = {0.25}, .contact = firn::Contact::coulomb(0.3), .motion = {.position = {1.1, 0.25, 0.5}}};
    Measured found;
    found.particles = solver.size();
    double owed = 0;
    int const before = frames / 2; // it falls; on a device the number of steps that are queued grows
    for (int i = 0; i < before + frames; ++i) {
        auto const start = std::chrono::steady_clock::now();
        auto const report =
            solver.advance(frame + owed, firn::Budget{.cut_last_step = false}, firn::Gravity{}, ground, ball);
        owed = report.left;
        double const took = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
        if (i < before) continue;
        found.seconds.push_back(took);
        found.steps += double(report.substeps) / frames;
    }
    return found;
}

template <class Kernel, class Model>
void grow(char const* name, char const* kernel, Model const& material, int frames, int threads)
{
    for (int const cells : {8, 12, 16, 24, 32, 48, 64, 96, 128}) {
        Measured const found = measure<Kernel>(material, cells, frames, threads);
        double const middle = firn::bench::median(found.seconds);
        double slowest = 0;
        for (double const seconds : found.seconds) slowest = std::max(slowest, seconds);
        std::printf("%-10s %-10s %6d %10zu %8.1f %8.2f %8.2f\n", name, kernel, cells, found.particles,
                    found.steps, 1e3 * middle, 1e3 * slowest);
        std::fflush(stdout);
        if (middle > 2 * frame) break;
    }
}

template <class Model>
void grow(char const* name, Model const& material, int frames, int threads)
{
    grow<firn::QuadraticBSpline>(name, "quadratic", material, frames, threads);
    grow<firn::CubicBSpline>(name, "cubic", material, frames, threads);
}

} // namespace

int main(int argc, char** argv)
{
    int frames = 60, threads = 0;
    try {
        for (int i = 1; i < argc; i += 2) {
            std::string_view const option = argv[i];
            if (i + 1 == argc) throw std::invalid_argument(std::string(option) + " needs a value");
            if (option == "--frames")
                frames = std::stoi(argv[i + 1]);
            else if (option == "--threads")
                threads = std::stoi(argv[i + 1]);
            else
                throw std::invalid_argument("there is no option " + std::string(option));
        }
        if (frames < 1) throw std::invalid_argument("there must be a frame");
    }
    catch (std::exception const& error) {
        std::fprintf(stderr, "real_time: %s\n", error.what());
        return 2;
    }
    std::printf("%s\n", info().c_str());
    std::printf("material   kernel      cells  particles  steps/frame  median [ms]  slowest [ms]\n");
    // sound is ten times as fast as the water is said to flow: half of that, and steps are twice as long
    grow("water", firn::materials::water<Space>(), frames, threads);
    grow("water_1.5", firn::materials::water<Space>(1.5), frames, threads);
    grow("jelly", firn::materials::jelly<Space>(), frames, threads);
    grow("snow", firn::materials::fresh_snow<Space>(), frames, threads);
}
