// SPDX-License-Identifier: MIT
// Water leaves a nozzle, falls on a ledge and into a drain, in the plane: particles that come and go. The
// number in between settles. `waterfall [--backend cuda] [folder]` writes frames as well.
#include "frames.hpp"

using namespace firn;
using namespace firn::examples;

using Plane = Space<2, double>;

/// An emitter: layers of points that leave it one behind the other. The next one is due when the last has
/// moved by the distance between points, so that layers neither overlap nor part.
struct Nozzle
{
    std::vector<Eigen::Vector2d> layer; ///< of the points of one layer [m]
    double spacing;                     ///< [m]
    Eigen::Vector2d velocity;           ///< across the layer [m/s]
    double due = 0;                     ///< when the next one leaves [s]

    double period() const { return spacing / velocity.norm(); } ///< [s]

    /// Adds the layer that is due.
    template <class Solver>
    void emit(Solver& solver)
    {
        if (solver.time() < due - 1e-9 * period()) return;
        solver.add(layer, spacing * spacing, velocity);
        due += period();
    }
};

int main(int argc, char** argv)
try {
    auto frames = frames_of(argc, argv);
    double const h = 0.02, spacing = h / 2; // [m]
    Nozzle nozzle{.layer = {}, .spacing = spacing, .velocity = {1.5, 0}};
    for (int i = 0; i < 12; ++i) nozzle.layer.emplace_back(0, 0.8 + (i + 0.5) * spacing);

    // no nodes on its faces or half-way between them: rounding would decide where they belong
    Obstacle<Box> const ledge{
        .shape = {{0.295, 0.05, 1}}, .contact = Contact::slip(), .motion = {.position = {0.6, 0.305, 0}}};
    Inside<HalfSpace> const drain{.shape = {}, .pose = {.position = {0, -0.2, 0}}}; // all below
    Solver<Backend, Fluid<Plane>, QuadraticBSpline, Apic> solver(lattice(h), materials::water<Plane>(5));
    if (frames)
        frames->draw({.dimensions = 2, .cell_size = h, .spacing = spacing, .obstacles = {drawn(ledge)}});
    double const duration = 2, frame = 1.0 / 24;
    std::size_t emitted = 0, drained = 0;
    int count = 0;
    std::printf("time [s]  emitted  drained  between\n");
    while (solver.time() < duration) {
        std::size_t const before = solver.size();
        nozzle.emit(solver);
        emitted += solver.size() - before;
        solver.advance(nozzle.due - solver.time(), Gravity{}, ledge);
        if (solver.time() < count * frame) continue; // the drain need not act after every layer
        drained += solver.remove_if(drain);
        if (frames) frames->write(solver);
        if (count++ % 6 == 0)
            std::printf("%8.2f  %7zu  %7zu  %7zu\n", solver.time(), emitted, drained, solver.size());
    }
    std::printf("%8.2f  %7zu  %7zu  %7zu\n", solver.time(), emitted, drained, solver.size());
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
