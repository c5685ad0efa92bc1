// SPDX-License-Identifier: MIT
// A slope of moist sand stands under its weight, dries, and slides. An implicit solver finds the state of
// rest in one call, settle(), for which explicit steps would have to damp the ground for seconds. An explicit
// one goes on from its snapshot: first with the cohesion, when nothing may move, and then without it. Behind
// the slope the ground is pressed sideways by K0 = nu / (1 - nu) of its weight, as ground is that has no room
// there; and what has slid is no steeper than the angle of friction. The example fails if one of these is not
// so. `settled_slope [folder]` writes frames as well.
#include "frames.hpp"

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Plane = Space<2, double>;
    using Soil = Sand<Plane>;
    auto frames = frames_of(argc, argv);
    double const h = 0.05, width = 7, height = 1, base = 0.25, toe = 1,
                 degree = 3.14159265358979 / 180; // [m]
    double const poisson = 0.3, friction = 30 * degree;
    Soil moist;
    moist.elasticity = lame(4e6, poisson);
    moist.cone = friction_cone(2, friction);
    moist.cohesion = 5e3; // [Pa]

    std::vector<Eigen::Vector2d> points;
    for (auto const& x : block<2>({width, height}, h))
        if (x.y() < base || x.y() < base + x.x() - toe) points.push_back(x); // a slope of 45 degrees
    Obstacle<HalfSpace> const ground{.contact = Contact::sticky()};
    ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = int(std::lround(width / h)), .side = -1};

    Solver<Backend, Soil, QuadraticBSpline, Mls, Implicit> resting(lattice(h), moist);
    resting.add(points, h * h / 4);
    auto const rest = resting.settle(Gravity{}, ground, left, right);
    double const weight = resting.totals().mass * 9.81, borne = -rest.reactions[0].impulse.y();
    double across = 0, down = 0; // beside the right wall
    auto const stress = resting.download<Stress>();
    for (std::size_t i = 0; i < points.size(); ++i)
        if (points[i].x() > width - 0.3) {
            across += stress[i](0, 0);
            down += stress[i](1, 1);
        }
    double const k0 = poisson / (1 - poisson);
    std::printf("%zu particles are at rest after %d passes: the ground bears %.4f of the weight, and K0 is "
                "%.4f (nu / (1 - "
                "nu): %.4f)\n",
                points.size(), int(rest.solve.passes), borne / weight, across / down, k0);

    auto const settled = resting.positions();
    auto const largest_way = [&](auto const& solver) {
        double way = 0;
        auto const x = solver.positions();
        for (std::size_t i = 0; i < x.size(); ++i) way = std::max(way, (x[i] - settled[i]).norm());
        return way;
    };
    auto state = resting.snapshot();
    Solver<Backend, Soil, QuadraticBSpline, Mls> standing(lattice(h), moist);
    standing.restore(state);
    auto const stood = standing.advance(0.2, Gravity{}, ground, left, right);
    double const moved = largest_way(standing);
    std::printf("moist: in 0.2 s and %d explicit steps nothing moves by more than %.1g mm\n",
                int(stood.substeps), 1e3 * moved);

    Soil dry = moist;
    dry.cohesion = 0;
    state.forget_parameters(); // those of the sand, which has dried
    Solver<Backend, Soil, QuadraticBSpline, Mls> sliding(lattice(h), dry);
    sliding.restore(state);
    std::printf("dry:\ntime [s]  largest way [m]  slope [degrees]\n");
    double slope = 0;
    for (int i = 0; i < 6; ++i) {
        if (frames) frames->write(sliding);
        sliding.advance(0.25, Gravity{}, ground, left, right);
        std::vector<double> surface(std::size_t(width / (2 * h)) + 1, 0.0); // by columns of two cells
        for (auto const& x : sliding.positions()) {
            auto& top = surface[std::size_t(std::clamp(x.x() / (2 * h), 0.0, double(surface.size() - 1)))];
            top = std::max(top, x.y());
        }
        slope = 0; // the steepest of a metre
        for (std::size_t k = 0; k + 10 < surface.size(); ++k)
            slope = std::max(slope, std::atan2(surface[k + 10] - surface[k], 20 * h) / degree);
        std::printf("%8.2f  %15.3f  %15.1f\n", sliding.time(), largest_way(sliding), slope);
    }
    if (frames) {
        frames->write(sliding);
        frames->draw({.dimensions = 2, .cell_size = h, .spacing = h / 2, .obstacles = {drawn(ground)}});
    }
    if (!(std::abs(borne / weight - 1) < 1e-3 && std::abs(across / down - k0) < 0.01 * k0 && moved < 1e-3 &&
          largest_way(sliding) > 0.3 && slope < friction / degree))
        throw Error{"the slope did not rest, stand or slide as it should", "settled_slope", "See the table."};
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
