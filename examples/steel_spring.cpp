// SPDX-License-Identifier: MIT
// A leaf of spring steel is clamped at one end and bent by a force at the other one, in slow motion: it takes
// six seconds, of a second a step. Then it is let go slowly, and springs back. Explicit steps would be
// as long as sound takes through a cell, so there would be millions of them. The deflection is compared with
// Timoshenko's beam in plane strain; the example fails if it is off by more than 1 % of the largest one.
// `steel_spring [folder]` writes frames as well.
#include "frames.hpp"

#include <firn/effects/traction.hpp>
#include <firn/mark_face.hpp>
#include <firn/transfer/loaded_surfaces.hpp>

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Plane = Space<2, double>;
    using Loaded = Carrying<Apic, LoadedSurfaces>;
    auto frames = frames_of(argc, argv);
    double const length = 1, thickness = 0.2, young = 2.1e11, poisson = 0.3, density = 7850; // [m], [Pa]
    int const across = 12, per_cell = 3, steps = 3; // steps of a second each way
    double const h = thickness / across, spacing = h / per_cell;

    Solver<Backend, NeoHookean<Plane>, QuadraticBSpline, Loaded, Implicit> leaf(
        lattice(h), {.density = density, .elasticity = lame(young, poisson)});
    auto points = block<2>({length + 4 * h, thickness}, h, per_cell);
    for (auto& x : points) x -= Eigen::Vector2d(4 * h, thickness / 2); // four cells in the clamp
    leaf.add(points, spacing * spacing);
    mark_face(leaf,
              Inside<Box>{.shape = {{spacing / 2, thickness, 1}},
                          .pose = {.position = {length - spacing / 2, 0, 0}}},
              {thickness, 0});
    Obstacle<HalfSpace> const clamp{.shape = {{1, 0, 0}}, .contact = Contact::sticky()};

    // The beam is bent and sheared, by 5/6 of its area. The force acts in the last layer of particles.
    double const bending = young / (1 - poisson * poisson) * std::pow(thickness, 3) / 12,
                 shearing = 5.0 / 6 * young / (2 * (1 + poisson)) * thickness, at = length - spacing / 2;
    double const per_force =
        std::pow(at, 3) / (3 * bending) + at * at / (2 * bending) * (length - at) + at / shearing; // [m/N]
    double const most = 0.015, force = most / per_force; // [m], [N] per metre of depth

    auto const tip = [&] { // the mean deflection of the end
        auto const x = leaf.positions();
        auto const H = leaf.download<DisplacementGradient>();
        double sum = 0;
        int count = 0;
        for (std::size_t i = 0; i < points.size(); ++i)
            if (points[i].x() > length - spacing) {
                sum += points[i].y() - x[i].y() - H[i](1, 0) * (length - points[i].x());
                ++count;
            }
        return sum / count;
    };
    double const sound = std::sqrt(leaf.model().elasticity.p_wave_modulus() / density);
    double largest = 0;
    std::uint64_t passes = 0;
    std::printf("time [s]  force [MN/m]  deflection [mm]  Timoshenko's [mm]  held by the clamp [MN/m]\n");
    for (int step = 1; step <= 2 * steps; ++step) {
        if (frames) frames->write(leaf);
        double const now = force * (step <= steps ? step : 2 * steps - step) / steps;
        auto const report =
            leaf.steps(1, 1.0, Traction::on({0, -now / thickness, 0}, {1, 0, 0}), clamp).front();
        passes += std::uint64_t(leaf.solved().passes);
        std::printf("%8.0f  %12.4f  %15.4f  %17.4f  %24.4f\n", leaf.time(), 1e-6 * now, 1e3 * tip(),
                    1e3 * now * per_force, -1e-6 * report.reactions[0].impulse.y());
        largest = std::max(largest, std::abs(tip() - now * per_force));
    }
    std::printf(
        "%d steps made %llu passes over %zu particles; explicit steps would be %.1e s long, and %.1e of "
        "them\n",
        2 * steps, static_cast<unsigned long long>(passes), leaf.size(), 0.6 * h / sound,
        leaf.time() / (0.6 * h / sound));
    if (frames) {
        frames->write(leaf);
        frames->draw({.dimensions = 2, .cell_size = h, .spacing = spacing, .obstacles = {drawn(clamp)}});
    }
    if (!(largest <= 0.01 * most))
        throw Error{"the deflection is off by more than 1 %", "steel_spring", "See the table."};
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
