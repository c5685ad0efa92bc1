// SPDX-License-Identifier: MIT
// Snow and sand fall into a basin of water, in the plane: three materials on one grid. Sand sinks, snow
// floats. `snow_sand_water [--backend cuda] [folder]` writes frames as well, with the number of each
// particle's material.
#include "frames.hpp"

using namespace firn;
using namespace firn::examples;

using Plane = Space<2, double>;
using Mixture = Materials<Snow<Plane>, Sand<Plane>, Fluid<Plane>>;
using Scene = Solver<Backend, Mixture, QuadraticBSpline, Apic>;

/// Points of a block with its lowest corner at `corner` [m].
std::vector<Eigen::Vector2d> block_at(Eigen::Vector2d const& corner, Eigen::Vector2d const& size, double h)
{
    auto points = block<2>(size, h);
    for (auto& x : points) x += corner;
    return points;
}

/// The mean height of a material's particles [m].
template <class Model>
double mean_height(Scene const& solver)
{
    double sum = 0;
    for (auto const& x : solver.positions<Model>()) sum += x.y();
    return sum / double(solver.size<Model>());
}

int main(int argc, char** argv)
try {
    auto frames = frames_of(argc, argv);
    double const h = 0.02, width = 1, depth = 0.3; // [m]
    Scene solver(lattice(h),
                 {materials::fresh_snow<Plane>(), materials::dry_sand<Plane>(), materials::water<Plane>(3)});
    solver.add<Fluid<Plane>>(block_at({0, 0}, {width, depth}, h), h * h / 4);
    solver.add<Snow<Plane>>(block_at({0.2, depth + 0.06}, {0.2, 0.16}, h), h * h / 4, {0, -1});
    solver.add<Sand<Plane>>(block_at({0.64, depth + 0.06}, {0.16, 0.16}, h), h * h / 4, {0, -1});

    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.4)};
    Obstacle<HalfSpace> const left{.shape = {{1, 0, 0}}, .contact = Contact::slip()};
    Obstacle<HalfSpace> const right{
        .shape = {{-1, 0, 0}}, .contact = Contact::slip(), .motion = {.position = {width, 0, 0}}};
    if (frames)
        frames->draw({.dimensions = 2,
                      .cell_size = h,
                      .spacing = h / 2,
                      .obstacles = {drawn(floor), drawn(left), drawn(right)},
                      .colour_by = "material",
                      .names = {"snow", "sand", "water"}});
    auto const write = [&] {
        if (!frames) return;
        frames->write(solver, [&](ParticleFrame& frame) {
            std::vector<float> material(solver.size());
            for (auto id : solver.ids<Sand<Plane>>()) material[id] = 1; // ids count all: none was removed
            for (auto id : solver.ids<Fluid<Plane>>()) material[id] = 2;
            frame.scalar("material", material);
        });
    };
    std::printf("time [s]  mean height of snow [m]  of sand  of water  particles %zu, %zu, %zu\n",
                solver.size<Snow<Plane>>(), solver.size<Sand<Plane>>(), solver.size<Fluid<Plane>>());
    for (int i = 0; i <= 10; ++i) {
        std::printf("%8.2f  %23.3f  %7.3f  %8.3f\n", solver.time(), mean_height<Snow<Plane>>(solver),
                    mean_height<Sand<Plane>>(solver), mean_height<Fluid<Plane>>(solver));
        for (int k = 0; i < 10 && k < 5; ++k) {
            write();
            solver.advance(0.04, Gravity{}, floor, left, right);
        }
    }
    write();
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
