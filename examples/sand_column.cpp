// SPDX-License-Identifier: MIT
// Columns of sand collapse on a rough floor. Their run-out is compared with the fit to experiments of Lube et
// al. 2005 ("Collapses of two-dimensional granular columns", Phys. Rev. E 72, 041301): (L - L0) / L0 = 1.2 a
// for columns up to 1.8 times as high as wide, 1.9 a^(2/3) above (from 2.3 or 2.8 on, by the source).
// `sand_column [--backend cuda] [folder]` writes frames as well.
#include "frames.hpp"

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Plane = Space<2, double>;
    auto const folder = folder_of(argc, argv);
    double const L0 = 0.1, h = L0 / 16; // half width of the column, and the cell [m]
    Obstacle<HalfSpace> const floor{.contact = Contact::sticky()};
    Obstacle<HalfSpace> const middle{.shape = {{1, 0, 0}}, .contact = Contact::slip()};
    std::printf("height/width  run-out  Lube's fit  final height/width  particles\n");
    for (double a : {0.5, 1.0, 2.0, 4.0}) {
        auto sand = materials::dry_sand<Plane>();
        sand.cone = friction_cone(3, 30 * 3.14159265358979 / 180); // in the plane it stands at 27.5 degrees
        Solver<Backend, Sand<Plane>> solver(lattice(h), sand);
        auto const start = block<2>({L0, a * L0}, h);
        solver.add(start, h * h / 4);
        auto const layer = layers(start, L0 / 4);
        std::optional<Frames> frames;
        if (folder) frames.emplace(*folder / ("height_" + std::to_string(a).substr(0, 3)));
        auto const write = [&] {
            if (frames) frames->write(solver, [&](ParticleFrame& frame) { frame.scalar("layer", layer); });
        };
        int const count = 40;
        for (int i = 0; i < count; ++i) {
            write();
            solver.advance(8 * std::sqrt(a * L0 / 9.81) / count, Gravity{}, floor, middle);
        }
        double const lube = a < 1.8 ? 1.2 * a : 1.9 * std::pow(a, 2.0 / 3);
        if (frames) {
            write();
            frames->draw({.dimensions = 2,
                          .cell_size = h,
                          .spacing = h / 2,
                          .obstacles = {drawn(floor), drawn(middle)},
                          .colour_by = "layer",
                          .marks = {{"run-out by Lube's fit", 0, (1 + lube) * L0, -1}},
                          .title = "column of height " + std::to_string(a).substr(0, 3) + " L0"});
        }
        auto const x = solver.positions();
        double height = 0;
        for (auto const& point : x) height = std::max(height, point.y());
        std::printf("%12.1f  %7.2f  %10.2f  %18.2f  %9zu\n", a, front(x, 0.995) / L0 - 1, lube, height / L0,
                    solver.size());
    }
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
