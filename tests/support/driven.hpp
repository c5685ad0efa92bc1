// SPDX-License-Identifier: MIT
#pragma once

#include "support/dust.hpp"
#include "support/policies.hpp"

// Dust that is driven at obstacles, to see whether any gets in or through.
namespace firn::test
{

/// How far particles got, and in what steps.
struct Driven
{
    double deepest = 0; ///< inside the shape, or across the middle of a shell, at any time [cells]
    double last = 0;    ///< the deepest at the end [cells]
    double mean = 0;    ///< distance from the surface at the end [cells]
    double longest = 0; ///< step, at the speed of the particles [cells]
    std::uint64_t steps = 0;
};

inline constexpr double cell = 0.05, speed = 3; // [m], [m/s]

/// A motion to and fro along a diagonal by steps of `frame` [s], and turning; its surface is up to twice as
/// fast as the particles, so that it is what bounds the step.
struct Swing
{
    double reach = 0;              ///< [m]
    Eigen::Vector3d turn{0, 0, 0}; ///< [rad/s]

    Motion during(double time, double frame) const
    {
        auto const place = [&](double t) -> Eigen::Vector3d {
            double const along = reach * std::sin(1.6 * speed / std::max(reach, 1e-9) * t);
            return Eigen::Vector3d(0.6, 0.8, 0) * along;
        };
        Motion motion = Motion{.angular_velocity = turn, .time = 0}.at(time);
        motion.position = place(time);
        motion.velocity = (place(time + frame) - motion.position) / frame;
        return motion;
    }
};

/// Drives `count` particles at a surface around the origin for so many steps: every few steps all of them get
/// the speed again, along the normal to the surface and a little beside it.
///
/// `surface(time, x)` is its signed distance and normal, `advance(solver, frame)` goes on by a while [s].
template <class Number, int d, class Surface, class Advance>
Driven drive_at(int count, int steps, bool from_both_sides, Surface const& surface, Advance const& advance)
{
    Solver<TestedBackend, Dust<Space<d, Number>>, QuadraticBSpline, Mls> solver(lattice(cell));
    std::mt19937 random(6);
    std::uniform_real_distribution<double> unit(-1, 1);
    std::vector<Vector<double, d>> points;
    std::vector<double> sides;
    while (int(points.size()) < count) {
        Vector<double, d> x;
        for (int a = 0; a < d; ++a) x[a] = unit(random);
        double const distance = surface(0, x).first;
        bool const there = from_both_sides ? std::abs(distance) > 0.05 * cell : distance > 0.5 * cell;
        if (!there || std::abs(distance) > 0.5) continue;
        points.push_back(x);
        sides.push_back(distance < 0 ? -1 : 1);
    }
    solver.add(points, std::pow(2.0, d) / count);

    Driven driven;
    std::vector<Vector<Number, d>> velocities(points.size());
    auto const look = [&] {
        points = solver.positions();
        driven.last = driven.mean = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            double const distance = sides[i] * surface(solver.time(), points[i]).first / cell;
            driven.last = std::max(driven.last, -distance);
            driven.mean += distance / double(points.size());
        }
        driven.deepest = std::max(driven.deepest, driven.last);
    };
    for (; driven.steps < std::uint64_t(steps); look()) {
        for (std::size_t i = 0; i < points.size(); ++i) {
            Vector<double, d> towards = -sides[i] * surface(solver.time(), points[i]).second;
            for (int a = 0; a < d; ++a) towards[a] += 0.3 * unit(random);
            velocities[i] = (towards.normalized() * speed).template cast<Number>();
        }
        solver.template upload<Velocity>(velocities);
        auto const report = advance(solver, 3 * 0.3 * cell / speed);
        driven.steps += report.substeps;
        driven.longest = std::max(driven.longest, report.largest_dt * speed / cell);
    }
    return driven;
}

/// Drives particles at an obstacle: the shape, or a shell of it, on the backend.
template <class Number, int d, class ShapeType, class ObstacleShape>
Driven drive(int count, int steps, ShapeType const& shape, Obstacle<ObstacleShape> obstacle,
             Swing const& swing)
{
    auto const plain = firn::detail::plain(shape); // on the host
    // signed distance of the solid, or from the middle of a shell, and normal in world axes
    auto const surface = [&](double time, Vector<double, d> const& x) {
        Motion const now = obstacle.motion.at(time);
        Eigen::Vector3d full = Eigen::Vector3d::Zero();
        full.head<d>() = x;
        full = now.orientation.conjugate() * (full - now.position);
        auto const here =
            surface_of<Number, d>(plain, Vector<Number, d>(full.head<d>().template cast<Number>()));
        full.setZero();
        full.head<d>() = here.normal.template cast<double>();
        return std::pair(double(here.distance), Vector<double, d>((now.orientation * full).head<d>()));
    };
    obstacle.motion = swing.during(0, 3 * 0.3 * cell / speed);
    return drive_at<Number, d>(count, steps, is_two_sided<ObstacleShape>, surface,
                               [&](auto& solver, double frame) {
                                   obstacle.motion = swing.during(solver.time(), frame);
                                   return solver.advance(frame, obstacle);
                               });
}

} // namespace firn::test
