// SPDX-License-Identifier: MIT
// A torus of snow flies against a wall, sticks to it and slides down.
#include "meshes.hpp"
#include "snow_scene.hpp"

using namespace firn;
using namespace firn::examples;

namespace
{

constexpr double wall_at = 0.6; ///< [m]

auto effects_of(double, double)
{
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.6)};
    // snow that has touched the wall does not come off it, but friction lets it slide
    Obstacle<HalfSpace> const wall{.shape = {-Eigen::Vector3d::UnitX()},
                                   .contact = {.friction = 0.5, .separates = false},
                                   .motion = {.position = {wall_at, 0, 0}}};
    return std::tuple{Gravity{}, floor, wall};
}

} // namespace

int main(int argc, char** argv)
try {
    auto const options = command_line(argc, argv, "torus_against_wall",
                                      "A torus of snow flies against a wall, sticks and slides down.");
    auto mesh = options.mesh.empty() ? torus(0.35, 0.12, 96, 48, Eigen::Vector3d::UnitX())
                                     : read(options.mesh, options.scale);
    if (options.mesh.empty())
        for (auto& x : mesh.vertices) x *= options.scale;
    place(mesh, {0, 0.75, 0});
    SnowScene<decltype(&effects_of)> const scene{
        "torus_against_wall",
        std::move(mesh),
        {6, 1, 0},
        {R"("shape": "half_space", "point": [0, 0, 0], "normal": [0, 1, 0])",
         R"("shape": "half_space", "point": [0, 0, 0], "normal": [-1, 0, 0])"},
        {{-2.9, 1.8, 3.2}, {0.2, 0.85, 0}},
        effects_of};
    return run(options, scene);
}
catch (std::exception const& error) {
    return stopped_by(error);
}
