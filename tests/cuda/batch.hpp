// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>

#include <tuple>
#include <vector>

// What tests of queued steps share: all that a call tells, the state, and a scene.
namespace firn::test
{

/// The impulses of a report's reactions, component by component.
template <class Report>
std::vector<double> impulses_of(Report const& report)
{
    std::vector<double> impulses;
    for (auto const& reaction : report.reactions)
        for (int a = 0; a < 3; ++a) {
            impulses.push_back(reaction.impulse[a]);
            impulses.push_back(reaction.angular_impulse[a]);
        }
    return impulses;
}

/// Everything that a call of advance tells.
inline auto told(AdvanceReport const& report)
{
    return std::tuple{report.substeps, report.rejected,   report.smallest_dt, report.largest_dt,
                      report.capped,   report.limited_by, impulses_of(report)};
}

/// Everything that a call of step tells.
inline auto told(StepReport const& report)
{
    return std::tuple{report.dt, report.stable_dt, report.beyond_stable, report.capped, impulses_of(report)};
}

template <class Solver>
auto state_of(Solver const& solver)
{
    return std::tuple{solver.time(), solver.positions(), solver.template download<Velocity>(),
                      solver.template download<DisplacementGradient>()};
}

/// A ball thrown at a floor and at a sphere that flies, turns and pushes particles out.
template <class SceneType>
struct Thrown
{
    static constexpr int d = SceneType::d;
    typename SceneType::Solver solver;
    Obstacle<HalfSpace> floor{.contact = Contact::coulomb(0.3)};
    Obstacle<Sphere> sphere{.shape = {0.15},
                            .contact = Contact::coulomb(0.5),
                            .motion = {.position = {0.5, 0.1, 0},
                                       .velocity = {-2, 0.5, 0},
                                       .angular_velocity = {0, 0, 5},
                                       .time = 0},
                            .on_particles = true};

    explicit Thrown(std::size_t batch, double speed, StepControl control = {})
        : solver(lattice(0.05), {}, {}, control, Cuda{.batch = batch})
    {
        Vector<double, d> velocity = Vector<double, d>::Constant(0.3 * speed);
        velocity[1] = -speed;
        Vector<double, d> centre = Vector<double, d>::Constant(0.013);
        centre[1] = 0.4;
        double const radius = 0.01 * sample_of(14, 20);
        solver.add(ball_of_points<d>(centre, radius, 0.05), std::pow(0.025, d), velocity);
    }
};

} // namespace firn::test
