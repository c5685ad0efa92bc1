// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/effects/reflecting_wall.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace firn::test
{

/// Smooth walls at the ends of a bar along x, solids that stop the nodes inside them, or solids that act at
/// their surface.
enum class Ends
{
    mirrored,
    stopped,
    at_surface
};

/// The largest error of displacements during a period of the first mode of a bar of length 1 between walls,
/// over its amplitude: u = v0 / omega sin(pi x) sin(omega t), omega = pi c, while it is small.
///
/// In the plane, two cells high between smooth walls, so that there are corners. Solids that act at their
/// surface are on all sides, and lie so many cells from nodes along both axes.
template <class SceneType>
double error_of_standing_wave(int cells, Ends ends, double offset = 0)
{
    double const h = 1.0 / cells, c = 10, speed = 1e-4, omega = M_PI * c; // [m], [m/s]
    typename SceneType::Model bar;
    bar.elasticity = lame<double>(100, 0);
    bar.density = 1;
    typename SceneType::Solver solver(lattice(h), bar);
    double const low = offset * h;
    auto const points = box_of_points<2>({low, low}, {low + 1, low + 2 * h}, h);
    solver.add(points, h * h / 4);
    auto const along = [&](std::size_t i) { return M_PI * (points[i].x() - low); };
    std::vector<Vector<double, 2>> velocities;
    std::vector<Matrix<double, 2>> gradients(points.size(), Matrix<double, 2>::Zero());
    for (std::size_t i = 0; i < points.size(); ++i) {
        velocities.emplace_back(speed * std::sin(along(i)), 0);
        gradients[i](0, 0) = speed * M_PI * std::cos(along(i));
    }
    solver.template upload<Velocity>(velocities);
    solver.template upload<AffineVelocity>(gradients);

    ReflectingWall const below{.axis = 1}, above{.axis = 1, .node = 2, .side = -1};
    Obstacles<AnyShape<>, ActsOn::surface> around;
    auto const add = [&](Eigen::Vector3d const& normal, Eigen::Vector3d const& at) {
        around.list.push_back(
            {.shape = HalfSpace{normal}, .contact = Contact::bound_slip(), .motion = {.position = at}});
    };
    add({1, 0, 0}, {low, 0, 0});
    add({-1, 0, 0}, {low + 1, 0, 0});
    add({0, 1, 0}, {0, low, 0});
    add({0, -1, 0}, {0, low + 2 * h, 0});
    double worst = 0;
    int const steps = 10 * cells, pieces = 20; // of 0.2 h / c each
    for (int piece = 1; piece <= pieces; ++piece) {
        auto const of_piece = std::size_t(steps / pieces);
        double const dt = 0.2 * h / c;
        if (ends == Ends::at_surface)
            solver.steps(of_piece, dt, around);
        else if (ends == Ends::mirrored)
            solver.steps(of_piece, dt, below, above, ReflectingWall{.axis = 0},
                         ReflectingWall{.axis = 0, .node = cells, .side = -1});
        else
            solver.steps(of_piece, dt, below, above,
                         Obstacle<HalfSpace>{.shape = {{1, 0, 0}}, .contact = Contact::bound_slip()},
                         Obstacle<HalfSpace>{.shape = {{-1, 0, 0}},
                                             .contact = Contact::bound_slip(),
                                             .motion = {.position = {1, 0, 0}}});
        auto const now = solver.positions();
        double square = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            double const exact = speed / omega * std::sin(along(i)) * std::sin(omega * solver.time());
            square += std::pow(now[i].x() - points[i].x() - exact, 2) / double(points.size());
        }
        worst = std::max(worst, std::sqrt(square) * omega / speed);
    }
    return worst;
}

} // namespace firn::test
