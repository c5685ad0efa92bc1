// SPDX-License-Identifier: MIT
#pragma once

#include "limits/hard_case.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

// Hard cases of two bodies that have little in common, by explicit steps and by implicit ones.
namespace firn::test::stack
{

inline Obstacle<HalfSpace> half_space(Eigen::Vector3d const& normal, Eigen::Vector3d const& through,
                                      Contact contact)
{
    return {.shape = {normal}, .contact = contact, .motion = {.position = through}};
}

/// The root of the mean squared speed [m/s].
template <class Solver>
double mean_speed(Solver const& solver)
{
    double squares = 0;
    auto const v = solver.template download<Velocity>();
    for (auto const& u : v) squares += double(u.squaredNorm()) / double(v.size());
    return std::sqrt(squares);
}

/// A material of the plane.
inline NeoHookean<Plane> block(double density, double young)
{
    NeoHookean<Plane> model;
    model.density = density;
    model.elasticity = lame<double>(young, 0.3);
    return model;
}

/// Two blocks on one another, of which one is heavier or stiffer by a factor of 1e4.
template <class SceneType>
void pile_up(std::string const& name, NeoHookean<Plane> const& below, NeoHookean<Plane> const& above,
             double duration, double momentum = 1e-10,
             typename SceneType::Solver::Transfer const& transfer = {})
{
    HardCase const H7{"H7"};
    double const h = 0.05;
    typename SceneType::Solver solver(lattice(h), {below, above}, transfer);
    auto const lower = box_of_points<2>({0, 0}, {0.2, 0.2}, h);
    auto upper = lower;
    for (auto& x : upper) x.y() += 0.2;
    solver.template add<Material<0>>(lower, h * h / 4);
    solver.template add<Material<1>>(upper, h * h / 4);
    auto const floor = half_space({0, 1, 0}, {0, 0, 0}, Contact::sticky());
    Totals const start(solver);
    auto const advance = [&](double time, [[maybe_unused]] double damping) {
        if constexpr (SceneType::is_implicit)
            return solver.advance(time, Gravity{}, floor); // which damp
        else
            return solver.advance(time, Gravity{}, floor, Damping{damping});
    };
    auto report = advance(0.5 * duration, 0);
    Vector<double, 2> const expected(-report.reactions[0].impulse.x(),
                                     -report.reactions[0].impulse.y() -
                                         9.81 * report.time_of_forces * start.mass);
    H7.at_most(name + ": error of momentum / impulse of the weight",
               (Totals(solver).momentum - expected).norm() / (9.81 * solver.time() * start.mass), momentum);
    advance(0.5 * duration, 40);
    double top = -1, bottom = 1e9;
    for (auto const& x : solver.template positions<Material<0>>()) top = std::max(top, x.y());
    for (auto const& x : solver.template positions<Material<1>>()) bottom = std::min(bottom, x.y());
    H7.at_most(name + ": particles not finite", double(not_finite(solver)), 0);
    H7.at_most(name + ": overlap [cells]", (top - bottom) / h, 1);
    H7.at_most(name + ": speed in the end [m/s]", mean_speed(solver), 0.01);
}

} // namespace firn::test::stack
