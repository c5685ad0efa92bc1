// SPDX-License-Identifier: MIT
// An effect of one's own, rising_wind.hpp: a wind, its drag growing with height, carries along drops of water
// that are at rest, one above the other. At the height y a drop has the velocity U (1 - exp(-k y t)). The
// error is of second order in the cell, since nodes around a drop are at other heights; the example fails if
// it is larger. `own_effect [--backend cuda] [folder]` writes frames as well.
#include "frames.hpp"
#include "rising_wind.hpp"

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Plane = Space<2, double>;
    auto frames = frames_of(argc, argv);
    RisingWind const wind;
    double const duration = 1; // [s]
    int const drops = 10;
    bool good = true;

    std::printf(
        "cell [m]  steps  slowest drop [m/s]  fastest drop [m/s]  largest error of any velocity [m/s]\n");
    for (double h : {0.1, 0.05, 0.025}) {
        Solver<Backend, Fluid<Plane>> solver(lattice(h), materials::water<Plane>());
        std::vector<Eigen::Vector2d> start;
        for (int i = 1; i <= drops; ++i) start.emplace_back(0.013, 0.5 * i); // too far apart to share nodes
        solver.add(start, h * h / 4);
        double for_forces = 0; // how long the wind has acted on velocities [s]
        std::uint64_t steps = 0;
        for (int i = 0; i < 10; ++i) {
            if (frames && h == 0.025) frames->write(solver);
            auto const report = solver.advance(duration / 10, wind);
            for_forces += report.time_of_forces;
            steps += report.substeps;
        }
        auto const v = solver.download<Velocity>();
        double error = 0;
        for (int i = 0; i < drops; ++i) {
            double const exact =
                wind.speed * -std::expm1(-wind.rate * start[std::size_t(i)].y() * for_forces);
            error = std::max(error, (v[std::size_t(i)] - Eigen::Vector2d(exact, 0)).norm());
        }
        std::printf("%8.3f  %5d  %18.4f  %18.4f  %35.6f\n", h, int(steps), v.front().x(), v.back().x(),
                    error);
        good = good && error <= 0.05 * h * h * wind.speed;
        if (!frames || h != 0.025) continue;
        frames->write(solver);
        frames->draw({.dimensions = 2, .cell_size = h, .spacing = 4 * h});
    }
    if (!good) throw Error{"velocities are off by more than the cell allows", "own_effect", "See the table."};
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
