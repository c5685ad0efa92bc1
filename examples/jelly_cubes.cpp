// SPDX-License-Identifier: MIT
// Cubes of jelly fall on one another and come to rest on a smooth floor. Their volume is then known: 3 K (V -
// V0) = -m g y with y the height of their centre of mass, whatever the shape of their pile. By Clausius'
// virial theorem the sum of weights times heights is three times that of pressures times volumes, and Hooke's
// law gives the change of volume (strains here are some per cent). `jelly_cubes [--backend cuda] [folder]`
// writes frames as well.
#include "frames.hpp"

using namespace firn;
using namespace firn::examples;

using Room = Space<3, double>;
using Jelly = NeoHookean<Room>;

/// Sums and means over all particles of a body of jelly.
struct Totals
{
    double height = 0;                                  ///< of the centre of mass [m]
    double kinetic = 0, elastic = 0;                    ///< energy [J]
    double volume = 0;                                  ///< relative to that at rest, less 1
    Eigen::Vector3d momentum = Eigen::Vector3d::Zero(); ///< [kg m/s]

    template <class Solver>
    Totals(Solver const& solver, double volume_per_point)
    {
        auto const& jelly = solver.model();
        auto const x = solver.positions(), v = solver.template download<Velocity>();
        auto const H = solver.template download<DisplacementGradient>();
        double const mass = jelly.density * volume_per_point, count = double(x.size());
        for (std::size_t i = 0; i < x.size(); ++i) {
            Eigen::Matrix3d const F = Eigen::Matrix3d::Identity() + H[i];
            double const J = F.determinant(), log_J = std::log(J);
            height += x[i].y() / count;
            volume += (J - 1) / count;
            momentum += mass * v[i];
            kinetic += 0.5 * mass * v[i].squaredNorm();
            elastic += volume_per_point * (0.5 * jelly.elasticity.mu * (F.squaredNorm() - 3 - 2 * log_J) +
                                           0.5 * jelly.elasticity.lambda * log_J * log_J);
        }
    }
};

int main(int argc, char** argv)
try {
    auto frames = frames_of(argc, argv);
    double const h = 0.04, edge = 0.4, g = 9.81, volume_per_point = h * h * h / 8; // [m], [m/s^2], [m^3]
    Solver<Backend, Jelly, QuadraticBSpline, Pic> solver(lattice(h), materials::jelly<Room>());
    struct Cube
    {
        Eigen::Vector3d centre, axis; ///< [m], and the axis of its rotation
        double angle;                 ///< [rad]
    };
    for (auto const& cube : {Cube{{0, 0.26, 0}, {0, 1, 0}, 0.3}, Cube{{0.08, 0.8, 0.04}, {1, 1, 0.4}, 0.5},
                             Cube{{-0.02, 1.42, -0.02}, {0.2, 0.4, 1}, 0.6}}) {
        auto points = block<3>(Eigen::Vector3d::Constant(edge), h);
        Eigen::Matrix3d const turn = Eigen::AngleAxisd(cube.angle, cube.axis.normalized()).toRotationMatrix();
        for (auto& x : points) x = cube.centre + turn * (x - Eigen::Vector3d::Constant(edge / 2));
        solver.add(points, volume_per_point);
    }
    Obstacle<HalfSpace> const floor{.contact = Contact::slip()};
    if (frames)
        frames->draw({.cell_size = h,
                      .spacing = h / 2,
                      .camera = Camera{{1.0, 1.15, 2.7}, {0, 0.58, 0}},
                      .obstacles = {drawn(floor)},
                      .colour_by = "body"});
    std::vector<float> body(solver.size());
    for (std::size_t i = 0; i < body.size(); ++i) body[i] = float(3 * i / body.size());

    double const mass = materials::jelly<Room>().density * volume_per_point * double(solver.size());
    auto const& moduli = solver.model().elasticity;
    double const bulk = moduli.lambda + 2 * moduli.mu / 3;
    Eigen::Vector3d given = Eigen::Vector3d::Zero();                     // by gravity and the floor [N s]
    int const frame_rate = 24, frame_count = 96, last = 24;              // the last second is for the means
    double force = 0, mean_force = 0, mean_volume = 0, mean_at_rest = 0; // relative to weight and volume
    std::printf("time [s]  centre [m]  kinetic energy [J]  elastic   total  force on the floor/weight  "
                "volume off by  at rest  momentum off by [kg m/s]  particles %zu\n",
                solver.size());
    for (int i = 0; i <= frame_count; ++i) {
        Totals const now(solver, volume_per_point);
        double const at_rest = -mass * g * now.height / (3 * bulk * volume_per_point * double(solver.size()));
        if (i % 6 == 0)
            std::printf("%8.3f  %10.3f  %18.1f  %7.1f  %6.1f  %25.2f  %12.2f%%  %6.2f%%  %24.1e\n",
                        solver.time(), now.height, now.kinetic, now.elastic,
                        now.kinetic + now.elastic + mass * g * now.height, force, 100 * now.volume,
                        100 * at_rest, (now.momentum - given).norm());
        if (i > frame_count - last) {
            mean_force += force / last;
            mean_volume += now.volume / last;
            mean_at_rest += at_rest / last;
        }
        if (frames) frames->write(solver, [&](ParticleFrame& frame) { frame.scalar("body", body); });
        if (i == frame_count) break;
        auto const report = solver.advance(1.0 / frame_rate, Gravity{{0, -g, 0}}, floor);
        Eigen::Vector3d const on_floor = report.reactions[0].impulse;
        force = -on_floor.y() / (mass * g * report.time_of_forces);
        given += Eigen::Vector3d(0, -mass * g * report.time_of_forces, 0) - on_floor;
    }
    std::printf("the last second's means                                      %25.2f  %12.2f%%  %6.2f%%\n",
                mean_force, 100 * mean_volume, 100 * mean_at_rest);
}
catch (std::exception const& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
}
