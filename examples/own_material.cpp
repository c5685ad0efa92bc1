// SPDX-License-Identifier: MIT
// A material of one's own, soft_foam.hpp: a column of foam settles under its own weight, in the plane, to the
// heights that follow from its stress. Its sides are free, and it does not bulge: without a volume term,
// compression along it causes no stress across. So the stretch s at the place Y of rest solves k (s - 1 / s)
// = -rho g (L - Y): the first Piola-Kirchhoff stress carries the weight above. `own_material [--backend cuda]
// [folder]` writes frames as well.
#include "frames.hpp"
#include "soft_foam.hpp"

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Plane = Space<2, double>;
    auto frames = frames_of(argc, argv);
    double const L = 1, width = 0.3, g = 9.81; // [m], [m/s^2]
    SoftFoam<Plane> foam;
    foam.stiffness = 1e3;                                        // [Pa]: so soft that it sinks by an eighth
    double const weight = foam.density * g * L / foam.stiffness; // of the column, relative to the stiffness
    // The integral of s = (sqrt(q^2 + 4) - q) / 2 over the weight q above.
    auto const sum = [](double q) { return (std::sqrt(q * q + 4) - q) * q / 4 + std::asinh(q / 2); };
    auto const height = [&](double Y) { return L / weight * (sum(weight) - sum(weight * (1 - Y / L))); };

    std::printf(
        "cell [m]  highest particle [m]  by its stress [m]  largest error of any height [m]  particles\n");
    for (double h : {0.1, 0.05, 0.025}) {
        Solver<Backend, SoftFoam<Plane>, QuadraticBSpline, Apic> solver(lattice(h), foam);
        auto const start = block<2>({width, L}, h);
        solver.add(start, h * h / 4);
        // Gravity grows slowly, over six periods of the column, so that it hardly swings; the heights are
        // means over two more.
        double const period = 4 * L / std::sqrt(2 * foam.stiffness / foam.density);
        int const count = 64;
        std::vector<double> mean(start.size());
        auto const layer = layers(start, L / 10);
        auto const write = [&] {
            if (frames && h == 0.025)
                frames->write(solver, [&](ParticleFrame& frame) { frame.scalar("layer", layer); });
        };
        for (int i = 0; i < count; ++i) {
            write();
            double const share = std::min(1.0, (i + 1) / (0.75 * count));
            double const s = std::sin(1.5707963267948966 * share);
            solver.advance(8 * period / count, Gravity{{0, -g * s * s, 0}}, ReflectingWall{});
            auto const x = solver.positions();
            for (std::size_t k = 0; i >= 3 * count / 4 && k < x.size(); ++k) mean[k] += 4 * x[k].y() / count;
        }
        double error = 0;
        std::size_t top = 0;
        for (std::size_t k = 0; k < start.size(); ++k) {
            error = std::max(error, std::abs(mean[k] - height(start[k].y())));
            if (start[k].y() > start[top].y()) top = k;
        }
        std::printf("%8.3f  %20.4f  %17.4f  %31.4f  %9zu\n", h, mean[top], height(start[top].y()), error,
                    solver.size());
        if (!frames || h != 0.025) continue;
        write();
        frames->draw({.dimensions = 2,
                      .cell_size = h,
                      .spacing = h / 2,
                      .obstacles = {drawn(Obstacle<HalfSpace>{})},
                      .colour_by = "layer",
                      .marks = {{"height by its stress", 1, height(L), frames->count() - 1}}});
    }
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
