// SPDX-License-Identifier: MIT
// A snowball falls on the edge of a wedge, which splits it: half of it goes to each side, and wedge and floor
// receive the momentum that the snow loses. `snowball_on_wedge [--backend cuda] [folder]` writes frames as
// well.
#include "frames.hpp"

#include <firn/sampling/points.hpp>

using namespace firn;
using namespace firn::examples;

/// The solid that is sampled: an inside-test of one's own in place of a mesh.
struct Ball
{
    Eigen::Vector3d centre; ///< [m]
    double radius;          ///< [m]

    template <class Loop>
    std::vector<bool> contains(std::span<Eigen::Vector3d const> points, Loop const&) const
    {
        std::vector<bool> inside;
        for (auto const& x : points) inside.push_back((x - centre).norm() < radius);
        return inside;
    }
    double volume() const { return 4.0 / 3 * 3.14159265358979 * radius * radius * radius; } ///< [m^3]
    Eigen::AlignedBox3d bounding_box() const
    {
        Eigen::Vector3d const half = Eigen::Vector3d::Constant(radius);
        return {centre - half, centre + half};
    }
};

int main(int argc, char** argv)
try {
    using Room = Space<3, double>;
    auto frames = frames_of(argc, argv);
    double const h = 0.025, radius = 0.25, speed = 5, edge = 0.5; // [m], [m/s], height of the edge [m]
    auto snow = materials::fresh_snow<Room>();
    snow.smallest_plastic_ratio = 0.75; // its wave is then half as fast as at 0.6, and steps twice as long
    // no node on the edge itself, which would belong to one side alone
    Solver<Backend, Snow<Room>> solver(lattice(h, {h / 2, 0, 0}), snow);
    // Points are at random places in their cells, so only the law of large numbers makes one half like the
    // other.
    Ball const ball{{0, edge + radius + 0.02, 0}, radius};
    auto const sample = lattice_points(ball, Spacing{h / 2}, /*jitter*/ 0.5, /*seed*/ 1);
    solver.add(sample.points, sample.volume_per_point, {0, -speed, 0});

    Gravity const gravity;
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.6)};
    // A box that stands on one of its edges, half in the floor.
    double const half = edge / std::sqrt(2.0);
    Obstacle<Box> const wedge{.shape = {{half, half, 0.45}},
                              .contact = Contact::coulomb(0.2),
                              .motion = {.orientation = Eigen::Quaterniond(Eigen::AngleAxisd(
                                             3.14159265358979 / 4, Eigen::Vector3d::UnitZ()))},
                              .on_particles = true};
    if (frames)
        frames->draw({.cell_size = h,
                      .spacing = h / 2,
                      .camera = Camera{{0.95, 1.1, 2.3}, {0.05, 0.32, 0}},
                      .obstacles = {drawn(floor), drawn(wedge)}});

    auto const masses = solver.masses();
    double mass = 0;
    for (double m : masses) mass += m;
    Eigen::Vector3d const start = mass * Eigen::Vector3d(0, -speed, 0);
    Eigen::Vector3d given = Eigen::Vector3d::Zero(); // by gravity, wedge and floor [N s]
    AdvanceReport total;
    std::printf("time [s]  left  right of the edge  momentum left, right [kg m/s]  of the snow down  wedge "
                "and floor got  off by"
                "  particles %zu\n",
                solver.size());
    for (int i = 0; i <= 28; ++i) {
        if (frames) frames->write(solver);
        if (i % 4 == 0) {
            auto const x = solver.positions(), v = solver.download<Velocity>();
            double right = 0;
            Eigen::Vector3d momentum[2]{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
            for (std::size_t k = 0; k < x.size(); ++k) {
                right += (x[k].x() > 0) * masses[k] / mass;
                momentum[x[k].x() > 0] += masses[k] * v[k];
            }
            auto const& now = total.reactions;
            Eigen::Vector3d const got =
                now.empty() ? Eigen::Vector3d(0, 0, 0) : Eigen::Vector3d(now[0].impulse + now[1].impulse);
            std::printf("%8.3f  %3.1f%%  %5.1f%%  %8.1f %8.1f %8.1f %8.1f %8.1f %10.1e\n", solver.time(),
                        100 * (1 - right), 100 * right, momentum[0].x(), momentum[1].x(),
                        -momentum[0].y() - momentum[1].y(), -got.y(), got.x(),
                        (momentum[0] + momentum[1] - start - given).norm());
        }
        double const frame = 1.0 / 48;
        auto const report = solver.advance(frame, gravity, floor, wedge);
        total.merge(report);
        given += mass * report.time_of_forces * gravity.acceleration - report.reactions[0].impulse -
                 report.reactions[1].impulse;
    }
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
