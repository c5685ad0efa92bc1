// SPDX-License-Identifier: MIT
// How many steps a frame takes when it is split into calls: a block falls on the ground in frames of 1/24 s,
// by one call each, and by more of them with the last step cut and not:
//     calls_per_frame [frames]
// Prints steps over those of one call. The same file is compiled for a device.
#include "on_each_backend.hpp"

#include <firn/budget.hpp>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

using namespace firn;

namespace
{

using bench::Backend;
using Solid = Space<3, float>;
constexpr double frame = 1.0 / 24; // [s]

/// The steps of some frames of so many calls each.
template <class Model>
std::uint64_t steps_of(Model const& material, int frames, int calls, bool cut_last_step)
{
    double const h = 0.05;
    Solver<Backend, Model> solver(lattice(h), material, {}, {}, bench::backend());
    std::vector<Eigen::Vector3d> points;
    for (int i = 0; i < 8 * 8 * 8; ++i)
        points.push_back(h / 2 * Eigen::Vector3d(i % 8 + 0.5, i / 8 % 8 + 1.5, i / 64 + 0.5));
    solver.add(points, h * h * h / 8);
    Budget const budget{.cut_last_step = cut_last_step};
    std::uint64_t steps = 0;
    double owed = 0;
    for (int i = 0; i < frames * calls; ++i) {
        auto const report = solver.advance(frame / calls + owed, budget, Gravity{},
                                           Obstacle<HalfSpace>{.contact = Contact::coulomb(0.3)});
        owed = report.left;
        steps += report.substeps;
    }
    return steps;
}

template <class Model>
void compare(char const* name, Model const& material, int frames)
{
    auto const one = double(steps_of(material, frames, 1, true));
    std::printf("%-26s %7.1f steps a frame\n", name, one / frames);
    for (int const calls : {1, 4, 16, 64})
        std::printf("%26d calls %6.3f cut %6.3f not cut\n", calls,
                    double(steps_of(material, frames, calls, true)) / one,
                    double(steps_of(material, frames, calls, false)) / one);
}

} // namespace

int main(int argc, char** argv)
{
    int const frames = argc > 1 ? std::atoi(argv[1]) : 12;
    compare("water up to 1.5 m/s", materials::water<Solid>(1.5), frames);
    compare("jelly", materials::jelly<Solid>(), frames);
    compare("fresh snow", materials::fresh_snow<Solid>(), frames);
    compare("dry sand", materials::dry_sand<Solid>(), frames);
}
