// SPDX-License-Identifier: MIT
#pragma once

#include "problems/manufactured.hpp"
#include "support/policies.hpp"

#include <string>
#include <vector>

// Scenes that every backend runs, and what is compared of them. Numbers cross from one backend's file to the
// other's, no types of the library's.
namespace firn::test
{

/// What a scene came to: the coordinates of its points, by id, in cells; or what is told of it as a whole.
struct Outcome
{
    std::vector<double> x;
    double tolerance;  ///< of the root mean square distance between two backends' points [cells]
    int per_point = 1; ///< numbers that belong together: the dimension
};

/// A scene by its name, run on one backend.
struct AgreementCase
{
    std::string name;
    Outcome (*run)();
};

namespace detail
{
template <class Solver>
Outcome outcome(Solver const& solver, double tolerance)
{
    Outcome result{{}, tolerance, Solver::d};
    for (auto const& x : solver.positions())
        for (int a = 0; a < Solver::d; ++a) result.x.push_back(x[a] / solver.lattice().cell_size);
    return result;
}

/// A disk, or a cylinder, that rotates as a rigid body, 100 steps (case 7.3 of the validation suite).
template <class SceneType>
Outcome rotating_disk()
{
    constexpr int d = SceneType::d;
    using Number = typename SceneType::Number;
    double const h = 1.0 / 32;
    typename SceneType::Model material;
    material.density = 1;
    material.elasticity = lame<Number>(25, 0.3);
    typename SceneType::Solver solver(lattice(h), material);
    Vector<double, d> centre = Vector<double, d>::Constant(0.017);
    auto const points = ball_of_points<d>(centre, 0.25, h);
    solver.add(points, std::pow(h / 2, d));
    std::vector<Vector<Number, d>> v;
    for (auto const& x : points) {
        Vector<Number, d> u = Vector<Number, d>::Zero();
        u[0] = Number(centre[1] - x[1]);
        u[1] = Number(x[0] - centre[0]);
        v.push_back(u);
    }
    solver.template upload<Velocity>(v);
    double const c = std::sqrt(material.elasticity.p_wave_modulus());
    for (int i = 0; i < 100; ++i) solver.step(0.4 * h / c);
    return outcome(solver, SceneType::is_float ? 1e-5 : 1e-12);
}

/// Waves that are forced on a square, or a cube, between walls, 100 steps (case 7.5 of the validation suite).
template <class SceneType>
Outcome standing_waves()
{
    ManufacturedSolution<SceneType> waves(16);
    for (int piece = 0; piece < waves.pieces; ++piece) waves.advance(piece, 100 / waves.pieces);
    return outcome(waves.solver, SceneType::is_float ? 1e-5 : 1e-12);
}

/// Tells where points are as a whole: along each axis their centre, their extent (a standard deviation) and
/// the way of their mean speed in a hundredth of a second.
template <int d, class Velocities>
void statistics(std::vector<Vector<double, d>> const& x, Velocities const& v, double h, Outcome& result)
{
    Vector<double, d> mean = Vector<double, d>::Zero(), square = mean, speed = mean;
    for (std::size_t i = 0; i < x.size(); ++i) {
        Vector<double, d> const place = x[i] / h;
        mean += place / double(x.size());
        square += place.cwiseAbs2() / double(x.size());
        speed += v[i].template cast<double>().cwiseAbs() / double(x.size());
    }
    for (int a = 0; a < d; ++a) {
        result.x.push_back(mean[a]);
        result.x.push_back(std::sqrt(square[a] - mean[a] * mean[a]));
        result.x.push_back(0.01 * speed[a] / h);
    }
}

/// A ball of snow that splashes on a floor. Every rounding grows there: what is compared are statistics, and
/// what the floor received.
template <class SceneType>
Outcome splash()
{
    constexpr int d = SceneType::d;
    double const h = 0.02;
    typename SceneType::Solver solver(lattice(h), materials::fresh_snow<typename SceneType::Space>());
    Vector<double, d> centre = Vector<double, d>::Constant(0.013), velocity = Vector<double, d>::Zero();
    centre[1] = 0.17;
    velocity[1] = -6;
    solver.add(ball_of_points<d>(centre, 0.15, h), std::pow(h / 2, d), velocity);
    auto const report =
        solver.advance(0.06, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::coulomb(0.3)});

    double mass = 0;
    for (double m : solver.masses()) mass += m;
    Outcome result{{0.01 * report.reactions[0].impulse[1] / mass / h}, 1e-3}; // as a way, too
    statistics<d>(solver.positions(), solver.template download<Velocity>(), h, result);
    return result;
}
} // namespace detail

/// The scenes, on one backend: bodies that turn, waves between walls, and snow that splashes.
template <class Backend>
std::vector<AgreementCase> agreement_cases()
{
    using namespace detail;
    std::vector<AgreementCase> cases{
        {"disk, 2D double, fixed corotated, quadratic, MLS",
         rotating_disk<Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls, Backend>>},
        {"standing waves, 2D double, neo-Hookean, quadratic, MLS",
         standing_waves<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls, Backend>>},
        {"splash, 3D float, snow, cubic, FLIP",
         splash<Scene<Snow<SolidFloat>, CubicBSpline, Flip, Backend>>}};
#if !defined(FIRN_TESTS_FEW_COMBINATIONS)
    cases.insert(cases.end(),
                 {
                     {"disk, 2D float, fixed corotated, cubic, APIC",
                      rotating_disk<Scene<FixedCorotated<PlaneFloat>, CubicBSpline, Apic, Backend>>},
                     {"disk, 3D float, neo-Hookean, quadratic, MLS",
                      rotating_disk<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                     {"disk, 3D double, neo-Hookean, cubic, PIC",
                      rotating_disk<Scene<NeoHookean<Solid>, CubicBSpline, Pic, Backend>>},
                     {"disk, 3D double, neo-Hookean, quadratic, FLIP",
                      rotating_disk<Scene<NeoHookean<Solid>, QuadraticBSpline, Flip, Backend>>},
                     {"standing waves, 2D float, neo-Hookean, cubic, APIC",
                      standing_waves<Scene<NeoHookean<PlaneFloat>, CubicBSpline, Apic, Backend>>},
                     {"standing waves, 3D float, neo-Hookean, quadratic, MLS",
                      standing_waves<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                     {"standing waves, 3D double, neo-Hookean, cubic, APIC",
                      standing_waves<Scene<NeoHookean<Solid>, CubicBSpline, Apic, Backend>>},
                     {"standing waves, 3D float, neo-Hookean, linear, FLIP",
                      standing_waves<Scene<NeoHookean<SolidFloat>, Linear, Flip, Backend>>},
                     {"splash, 3D float, snow, quadratic, MLS",
                      splash<Scene<Snow<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                 });
#endif
    return cases;
}

std::vector<AgreementCase> openmp_cases(); ///< openmp.cpp
std::vector<AgreementCase> cuda_cases();   ///< cuda.cu

} // namespace firn::test
