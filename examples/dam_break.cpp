// SPDX-License-Identifier: MIT
// A column of water collapses: its front is compared with the experiment of Martin & Moyce 1952 ("An
// experimental study of the collapse of liquid columns on a rigid horizontal plane", Phil. Trans. A 244),
// base 2.25 in, twice as high. `dam_break [--backend cuda] [folder]` writes frames as well.
#include "frames.hpp"

#include <firn/effects/obstacles.hpp>

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Plane = Space<2, double>;
    auto frames = frames_of(argc, argv);
    double const L0 = 0.05715, H = 2 * L0, g = 9.81, h = L0 / 16; // [m]
    // time t sqrt(2 g / L0) and front x / L0, as measured
    double const measured[][2]{{.832, 1.217},  {1.219, 1.474}, {1.997, 2.292},
                               {2.547, 2.995}, {3.345, 4.134}, {4.034, 4.944}};
    auto solver = recommended_solver<Backend>(lattice(h), materials::water<Plane>(std::sqrt(2 * g * H)));
    solver.add(block<2>({L0, H}, h), h * h / 4);
    Obstacles<HalfSpace, ActsOn::surface_and_particles> walls; // the water keeps its volume between these
    walls.list.push_back({.contact = Contact::slip(), .on_particles = true});
    walls.list.push_back({.shape = {{1, 0, 0}}, .contact = Contact::slip(), .on_particles = true});
    std::vector<Mark> marks;
    std::printf("time [sqrt(L0/2g)]  front [L0]  measured  particles %zu\n", solver.size());
    for (auto const& [time, place] : measured) {
        double const end = time * std::sqrt(L0 / (2 * g)), begin = solver.time();
        for (int i = 1; i <= 8; ++i) {
            if (frames) frames->write(solver);
            solver.advance(begin + (end - begin) * i / 8 - solver.time(), Gravity{{0, -g, 0}}, walls);
        }
        if (frames) marks.push_back({"front by Martin and Moyce 1952", 0, place * L0, frames->count()});
        std::printf("%18.3f  %10.3f  %8.3f\n", time, front(solver.positions(), 0.995) / L0, place);
    }
    if (!frames) return 0;
    frames->write(solver);
    frames->draw({.dimensions = 2,
                  .cell_size = h,
                  .spacing = h / 2,
                  .obstacles = {drawn(walls.list[0]), drawn(walls.list[1])},
                  .marks = marks});
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
