// SPDX-License-Identifier: MIT
// A head of snow falls on a ball that rolls to and fro under it.
#include "meshes.hpp"
#include "snow_scene.hpp"

using namespace firn;
using namespace firn::examples;

namespace
{

constexpr double radius = 0.35, swing = 0.35, pace = 2.2; ///< of the ball: [m], [m], [rad/s]

/// The ball's motion during a frame: the chord of its swing, rolling on the floor.
Motion ball_motion(double time, double frame)
{
    auto const pose = [](double t) {
        double const x = swing * std::sin(pace * t);
        return Motion{.position = {x, radius, 0},
                      .orientation =
                          Eigen::Quaterniond(Eigen::AngleAxisd(-x / radius, Eigen::Vector3d::UnitZ()))};
    };
    return Motion::between(pose(time), pose(time + frame), frame);
}

auto effects_of(double time, double frame)
{
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.6)};
    Obstacle<Sphere> const ball{
        .shape = {radius}, .contact = Contact::coulomb(0.6), .motion = ball_motion(time, frame)};
    return std::tuple{Gravity{}, floor, ball};
}

} // namespace

int main(int argc, char** argv)
try {
    auto const options =
        command_line(argc, argv, "snow_on_moving_ball", "A head of snow falls on a moving ball.");
    auto mesh = options.mesh.empty() ? head() : read(options.mesh, options.scale);
    if (options.mesh.empty())
        for (auto& x : mesh.vertices)
            x *= 0.77 * options.scale; // 100 000 particles are then 8 per cell of 1/100 of 2 m
    place(mesh, {0, 2 * radius + 0.15, 0});
    SnowScene<decltype(&effects_of)> const scene{
        "snow_on_moving_ball",
        std::move(mesh),
        Eigen::Vector3d::Zero(),
        {R"("shape": "half_space", "point": [0, 0, 0], "normal": [0, 1, 0])",
         R"("shape": "sphere", "radius": )" + std::to_string(radius)},
        {{1.5, 1.5, 4.2}, {0, 0.65, 0}},
        effects_of};
    return run(options, scene);
}
catch (std::exception const& error) {
    return stopped_by(error);
}
