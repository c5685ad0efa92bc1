// SPDX-License-Identifier: MIT
// A ball of ice falls into fresh snow, which stops it. After every millisecond the ball receives the reaction
// that the solver reports, so momentum is conserved to rounding. `ball_into_snow [--backend cuda] [folder]`
// writes frames.
#include "frames.hpp"

using namespace firn;
using namespace firn::examples;

int main(int argc, char** argv)
try {
    using Room = Space<3, double>;
    auto frames = frames_of(argc, argv);
    double const h = 0.04, radius = 0.16, dt = 1e-3, size = 1; // [m], [s]
    Solver<Backend, Snow<Room>> solver(lattice(h), materials::fresh_snow<Room>());
    auto points = block<3>({size, 0.4, size}, h);
    for (auto& x : points) x += Eigen::Vector3d(-size / 2, 0.5 * h, -size / 2);
    solver.add(points, h * h * h / 8);
    auto const volume = 4.0 / 3 * 3.14159265358979 * radius * radius * radius;
    RigidBody ball =
        RigidBody::ball(radius, 917 * volume, {.position = {0, 0.64, 0}, .velocity = {0.5, -4, 0}});
    Gravity const gravity;
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.5)};
    std::vector<Motion> poses; // of the ball in the frames

    auto const masses = solver.masses();
    double mass = ball.mass;
    for (double m : masses) mass += m;
    auto const total = [&] {
        Eigen::Vector3d sum = ball.momentum();
        auto const v = solver.download<Velocity>();
        for (std::size_t i = 0; i < v.size(); ++i) sum += masses[i] * v[i];
        return sum;
    };
    Eigen::Vector3d const start = total();
    Eigen::Vector3d given = Eigen::Vector3d::Zero(); // by gravity and the floor [N s]
    std::printf("time [s]  lowest point [m]  speed [m/s]  momentum off by [kg m/s]  of %.0f, particles %zu\n",
                start.norm(), solver.size());
    for (int i = 0; i <= 300; ++i) {
        if (i % 10 == 0 && frames) {
            frames->write(solver);
            poses.push_back(ball.motion);
        }
        if (i % 30 == 0)
            std::printf("%8.3f  %16.3f  %11.3f  %24.1e\n", solver.time(), ball.motion.position.y() - radius,
                        ball.motion.velocity.norm(), (total() - start - given).norm());
        Obstacle<Sphere> const sphere{
            .shape = {radius}, .contact = Contact::coulomb(0.5), .motion = ball.motion, .on_particles = true};
        auto const report = solver.advance(dt, gravity, floor, sphere);
        ball.advance(report.reactions[1], dt, gravity.acceleration);
        given += ((mass - ball.mass) * report.time_of_forces + ball.mass * dt) * gravity.acceleration -
                 report.reactions[0].impulse;
    }
    if (!frames) return 0;
    auto shape = drawn(Obstacle<Sphere>{.shape = {radius}});
    shape.poses = poses;
    frames->draw({.cell_size = h,
                  .spacing = h / 2,
                  .frames_per_second = 100,
                  .camera = Camera{{1.1, 1.5, 2.4}, {0, 0.25, 0}},
                  .obstacles = {drawn(floor), shape}});
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
