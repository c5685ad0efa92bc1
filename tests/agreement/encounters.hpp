// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

// Scenes of bodies that meet something: walls that mirror, shells, terrain, a body that they push, one
// another.
namespace firn::test
{
namespace detail
{

/// A body that meets something: a block of jelly that flies down and aside, by a cell and a half in
/// 100 steps. Slow enough to stay smooth.
template <class SceneType>
struct Jelly
{
    static constexpr int d = SceneType::d;
    using Solver = typename SceneType::Solver;
    using Number = typename SceneType::Number;
    static constexpr double h = 1.0 / 16, dt = 5e-4;
    static constexpr int steps = 100;
    static constexpr double rounding = SceneType::is_float ? 1e-5 : 1e-12;

    static Vector<double, d> velocity()
    {
        Vector<double, d> v = Vector<double, d>::Constant(-0.4);
        v[1] = -2;
        return v;
    }

    /// Points whose lowest corner is that many cells over and beside the origin.
    static std::vector<Vector<double, d>> points(double above, double beside)
    {
        Vector<double, d> low = Vector<double, d>::Constant(beside * h);
        low[1] = above * h;
        return box_of_points<d>(low, low + Vector<double, d>::Constant(4 * h), h);
    }

    /// So low that kernels reach over a surface near the origin, and particles get there.
    static Solver falling(double beside)
    {
        typename SceneType::Model model;
        model.density = 1000;
        Solver solver(lattice(h), model);
        solver.add(points(0.1, beside), std::pow(h / 2, d), velocity());
        return solver;
    }
};

/// What reactions in all amount to: the way of the body's mean speed from them in a hundredth of a second
/// [cells], to be compared as a coordinate is.
template <class Solver>
struct Received
{
    Eigen::Vector3d impulse = Eigen::Vector3d::Zero();
    void add(StepReport const& report)
    {
        for (auto const& reaction : report.reactions) impulse += reaction.impulse;
    }
    void tell(Solver const& solver, Outcome& result) const
    {
        double mass = 0;
        for (double m : solver.masses()) mass += m;
        for (int a = 0; a < Solver::d; ++a)
            result.x.push_back(0.01 * impulse[a] / mass / solver.lattice().cell_size);
    }
};

/// A body that meets obstacles, which stay or move as told.
template <class SceneType, class... Effects>
Outcome meets(double beside, Effects const&... effects)
{
    using Body = Jelly<SceneType>;
    auto solver = Body::falling(beside);
    Received<typename SceneType::Solver> received;
    for (int i = 0; i < Body::steps; ++i) received.add(solver.step(Body::dt, Gravity{}, effects...));
    auto result = outcome(solver, Body::rounding);
    received.tell(solver, result);
    return result;
}

/// Two walls of nodes, and the corner between them.
template <class SceneType>
Outcome corner()
{
    return meets<SceneType>(0.1, ReflectingWall{.axis = 1}, ReflectingWall{.axis = 0});
}

/// A shell that rises between nodes, and rubs.
template <class SceneType>
Outcome on_shell()
{
    double const h = Jelly<SceneType>::h;
    return meets<SceneType>(
        0.0, Obstacle<Shell<HalfSpace>>{
                 .shape = {HalfSpace{}, 0.1 * h},
                 .contact = Contact::coulomb(0.4),
                 .motion = {.position = {0, -0.3 * h, 0}, .velocity = {0.1, 0.5, 0}, .time = 0}});
}

/// Hills of half a cell, four cells long.
template <class SceneType>
Outcome on_hills()
{
    constexpr int d = SceneType::d, count = 24;
    using Number = typename SceneType::Number;
    using Terrain = HeightField<Number, d>;
    double const h = Jelly<SceneType>::h;
    std::array<Number, d - 1> origin;
    std::array<int, d - 1> counts;
    origin.fill(Number(-6 * h));
    counts.fill(count);
    std::vector<Number> heights;
    for (int k = 0; k < (d == 3 ? count : 1); ++k)
        for (int i = 0; i < count; ++i)
            heights.push_back(
                Number(-0.4 * h + 0.25 * h * (std::sin(M_PI / 4 * i + 0.6) + std::cos(M_PI / 4 * k))));
    Terrain const hills(origin, Number(h / 2), counts, heights);
    auto const there = hills.on(typename SceneType::Backend{});
    return meets<SceneType>(0.0, Obstacle{.shape = there, .contact = Contact::coulomb(0.3)});
}

/// A ball that falls on a body, stops it in part, and is stopped and turned by it.
template <class SceneType>
Outcome under_a_ball()
{
    using Body = Jelly<SceneType>;
    double const h = Body::h, radius = 1.6 * h;
    typename SceneType::Model model;
    model.density = 1000;
    typename SceneType::Solver solver(lattice(h), model);
    solver.add(Body::points(0.5, 0), std::pow(h / 2, Body::d));
    double const middle = 2 * h;
    RigidBody ball = RigidBody::ball(
        radius, 4,
        {.position = {middle + 0.2 * h, 4.7 * h + radius, middle}, .velocity = {0.3, -2, 0}, .time = 0});
    ball.motion.angular_velocity = {0, 0, 3};
    Gravity const gravity;
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.5)};
    Received<typename SceneType::Solver> received;
    for (int i = 0; i < Body::steps; ++i) {
        Obstacle<Sphere> const sphere{
            .shape = {radius}, .contact = Contact::coulomb(0.5), .motion = ball.motion, .on_particles = true};
        auto const report = solver.step(Body::dt, gravity, floor, sphere);
        received.add(report);
        ball.advance(report.reactions[1], Body::dt, gravity.acceleration);
    }
    auto result = outcome(solver, Body::rounding);
    received.tell(solver, result);
    for (int a = 0; a < 3; ++a) result.x.push_back(ball.motion.position[a] / h);
    return result;
}

/// Two bodies of two materials that meet beside their middles.
template <class SceneType>
Outcome collision()
{
    using Body = Jelly<SceneType>;
    constexpr int d = Body::d;
    double const h = Body::h, volume = std::pow(h / 2, d);
    typename SceneType::Solver solver(lattice(h));
    auto above = Body::points(0.5, 0), below = above;
    for (auto& x : below) x[0] += 0.7 * h, x[1] -= 4.8 * h;
    solver.template add<Material<0>>(above, volume, Body::velocity());
    solver.template add<Material<1>>(below, volume);
    for (int i = 0; i < Body::steps; ++i) solver.step(Body::dt, Gravity{});
    return outcome(solver, Body::rounding);
}

/// Snow, sand and water thrown on a floor and on one another: what is compared are statistics, as of
/// splash().
template <class SceneType>
Outcome splash_of_three()
{
    constexpr int d = SceneType::d;
    double const h = 0.02;
    typename SceneType::Solver solver(lattice(h));
    Vector<double, d> centre = Vector<double, d>::Constant(0.013), velocity = Vector<double, d>::Zero();
    velocity[1] = -4;
    double const volume = std::pow(h / 2, d);
    auto const thrown = [&](double x, double y) {
        centre[0] = x, centre[1] = y;
        return ball_of_points<d>(centre, 0.08, h);
    };
    solver.template add<Material<0>>(thrown(0.013, 0.09), volume, velocity);
    solver.template add<Material<1>>(thrown(0.113, 0.23), volume, velocity);
    solver.template add<Material<2>>(thrown(-0.057, 0.24), volume, velocity);
    auto const report =
        solver.advance(0.05, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::coulomb(0.3)});
    Outcome result{{}, 1e-3};
    auto const each = [&](auto material) {
        statistics<d>(solver.template positions<decltype(material)>(),
                      solver.template download<Velocity, decltype(material)>(), h, result);
    };
    each(Material<0>{});
    each(Material<1>{});
    each(Material<2>{});
    double mass = 0;
    for (double m : solver.masses()) mass += m;
    result.x.push_back(0.01 * report.reactions[0].impulse[1] / mass / h);
    return result;
}

} // namespace detail

/// The scenes, on one backend.
template <class Backend>
std::vector<AgreementCase> encounter_cases()
{
    using namespace detail;
    using Three = Materials<Snow<SolidFloat>, Sand<SolidFloat>, Fluid<SolidFloat>>;
    std::vector<AgreementCase> cases{{"corner of walls, 2D double, neo-Hookean, quadratic, MLS",
                                      corner<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls, Backend>>},
                                     {"three materials, 3D float, snow, sand and fluid, quadratic, MLS",
                                      splash_of_three<Scene<Three, QuadraticBSpline, Mls, Backend>>}};
#if !defined(FIRN_TESTS_FEW_COMBINATIONS)
    using FloatPair = Materials<NeoHookean<SolidFloat>, Fluid<SolidFloat>>;
    using DoublePair = Materials<FixedCorotated<Plane>, Sand<Plane>>;
    using Bodies = firn::Bodies<NeoHookean<SolidFloat>, NeoHookean<SolidFloat>, Fluid<SolidFloat>>;
    cases.insert(cases.end(),
                 {
                     {"corner of walls, 3D float, neo-Hookean, cubic, FLIP",
                      corner<Scene<NeoHookean<SolidFloat>, CubicBSpline, Flip, Backend>>},
                     {"shell, 2D double, neo-Hookean, cubic, FLIP",
                      on_shell<Scene<NeoHookean<Plane>, CubicBSpline, Flip, Backend>>},
                     {"shell, 3D float, neo-Hookean, quadratic, MLS",
                      on_shell<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                     {"hills, 2D float, neo-Hookean, quadratic, APIC",
                      on_hills<Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Apic, Backend>>},
                     {"hills, 3D double, fixed corotated, quadratic, MLS",
                      on_hills<Scene<FixedCorotated<Solid>, QuadraticBSpline, Mls, Backend>>},
                     {"ball that is pushed, 3D float, neo-Hookean, quadratic, MLS",
                      under_a_ball<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                     {"ball that is pushed, 3D float, neo-Hookean, quadratic, ASFLIP",
                      under_a_ball<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Asflip, Backend>>},
                     {"ball that is pushed, 3D double, snow, quadratic, APIC",
                      under_a_ball<Scene<Snow<Solid>, QuadraticBSpline, Apic, Backend>>},
                     {"two materials, 2D double, fixed corotated and sand, cubic, APIC",
                      collision<Scene<DoublePair, CubicBSpline, Apic, Backend>>},
                     {"bodies, 3D float, neo-Hookean, quadratic, FLIP",
                      collision<Scene<Bodies, QuadraticBSpline, Flip, Backend>>},
                     {"two materials, 3D float, neo-Hookean and fluid, quadratic, MLS",
                      collision<Scene<FloatPair, QuadraticBSpline, Mls, Backend>>},
                 });
#endif
    return cases;
}

std::vector<AgreementCase> openmp_encounters(); ///< openmp_encounters.cpp
std::vector<AgreementCase> cuda_encounters();   ///< cuda_encounters.cu

} // namespace firn::test
