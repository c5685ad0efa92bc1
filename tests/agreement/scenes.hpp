// SPDX-License-Identifier: MIT
#pragma once

#include "problems/manufactured.hpp"
#include "support/policies.hpp"

#include <firn/io/checkpoint.hpp>

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

/// A scene by its name whose first half is run by one backend, and the second by another.
struct RestartCase
{
    std::string name;
    void (*write)(std::string const& path);
    Outcome (*go_on)(std::string const& path);
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

/// The model of a block that vibrates, with cells for it.
template <class SceneType>
typename SceneType::Solver empty_block()
{
    using Number = typename SceneType::Number;
    typename SceneType::Model material;
    material.density = 1000;
    if constexpr (requires { material.yield_stress; }) material.yield_stress *= Number(0.3); // it flows
    return typename SceneType::Solver(lattice(1.0 / 16), material);
}

/// A block that is stretched and sheared by its own waves: a smooth deformation.
template <class SceneType>
typename SceneType::Solver block_at_start()
{
    constexpr int d = SceneType::d;
    using Number = typename SceneType::Number;
    auto solver = empty_block<SceneType>();
    double const h = solver.lattice().cell_size;
    Vector<double, d> const low = Vector<double, d>::Constant(0.01);
    auto const points = box_of_points<d>(low, low + Vector<double, d>::Constant(0.5), h);
    solver.add(points, std::pow(h / 2, d));
    std::vector<Vector<Number, d>> v;
    for (auto const& x : points) {
        Vector<Number, d> u;
        for (int a = 0; a < d; ++a) u[a] = Number(0.3 * std::sin(2 * M_PI * (x[a] - 0.01) + a));
        v.push_back(u);
    }
    solver.template upload<Velocity>(v);
    return solver;
}

template <class Solver>
Outcome vibrated(Solver& solver, int steps)
{
    for (int i = 0; i < steps; ++i) solver.step(5e-4);
    return outcome(solver, sizeof(typename Solver::Number) == 4 ? 1e-5 : 1e-12);
}

/// 100 steps of it.
template <class SceneType>
Outcome vibrating_block()
{
    auto solver = block_at_start<SceneType>();
    return vibrated(solver, 100);
}

/// The first half of these steps, into a file.
template <class SceneType>
void write_half(std::string const& path)
{
    auto solver = block_at_start<SceneType>();
    vibrated(solver, 50);
    write_checkpoint(path, solver);
}

/// The other half, from a file.
template <class SceneType>
Outcome go_on(std::string const& path)
{
    auto solver = empty_block<SceneType>();
    read_checkpoint(path, solver);
    return vibrated(solver, 50);
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

/// The scenes, on one backend: every model but heterogeneous ones, every kernel and every transfer at least
/// once, in both dimensions and precisions, but not in all pairs.
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
                     {"block, 2D double, snow, cubic, FLIP",
                      vibrating_block<Scene<Snow<Plane>, CubicBSpline, Flip, Backend>>},
                     {"block, 2D float, neo-Hookean, quadratic, PIC",
                      vibrating_block<Scene<NeoHookean<PlaneFloat>, QuadraticBSpline, Pic, Backend>>},
                     {"block, 3D double, snow, quadratic, APIC",
                      vibrating_block<Scene<Snow<Solid>, QuadraticBSpline, Apic, Backend>>},
                     {"block, 3D float, fixed corotated, cubic, MLS",
                      vibrating_block<Scene<FixedCorotated<SolidFloat>, CubicBSpline, Mls, Backend>>},
                     {"block, 3D float, fixed corotated, quadratic, FLIP",
                      vibrating_block<Scene<FixedCorotated<SolidFloat>, QuadraticBSpline, Flip, Backend>>},
                     {"block, 3D double, von Mises, quadratic, MLS",
                      vibrating_block<Scene<VonMises<Solid>, QuadraticBSpline, Mls, Backend>>},
                     {"block, 2D double, sand, quadratic, TPIC",
                      vibrating_block<Scene<Sand<Plane>, QuadraticBSpline, Tpic, Backend>>},
                     {"block, 2D double, Cam-Clay, quadratic, MLS",
                      vibrating_block<Scene<CamClay<Plane>, QuadraticBSpline, Mls, Backend>>},
                     {"block, 2D double, Herschel-Bulkley, quadratic, ASFLIP",
                      vibrating_block<Scene<HerschelBulkley<Plane>, QuadraticBSpline, Asflip, Backend>>},
                     {"block, 2D double, neo-Hookean, cubic, XPIC",
                      vibrating_block<Scene<NeoHookean<Plane>, CubicBSpline, Xpic, Backend>>},
                     {"block, 2D double, neo-Hookean, linear, FLIP",
                      vibrating_block<Scene<NeoHookean<Plane>, Linear, Flip, Backend>>},
                     {"block, 2D float, Hencky, cubic, MLS",
                      vibrating_block<Scene<Hencky<PlaneFloat>, CubicBSpline, Mls, Backend>>},
                     {"block, 3D double, Hencky, quadratic, TPIC",
                      vibrating_block<Scene<Hencky<Solid>, QuadraticBSpline, Tpic, Backend>>},
                     {"block, 2D double, split neo-Hookean, quadratic, APIC",
                      vibrating_block<Scene<SplitNeoHookean<Plane>, QuadraticBSpline, Apic, Backend>>},
                     {"block, 3D float, split neo-Hookean, quadratic, ASFLIP",
                      vibrating_block<Scene<SplitNeoHookean<SolidFloat>, QuadraticBSpline, Asflip, Backend>>},
                     {"block, 2D double, hardening von Mises, cubic, MLS",
                      vibrating_block<Scene<HardeningVonMises<Plane>, CubicBSpline, Mls, Backend>>},
                     {"block, 3D float, hardening von Mises, quadratic, FLIP",
                      vibrating_block<Scene<HardeningVonMises<SolidFloat>, QuadraticBSpline, Flip, Backend>>},
                     {"block, 3D float, fluid, quadratic, MLS",
                      vibrating_block<Scene<Fluid<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                     {"splash, 3D float, snow, quadratic, MLS",
                      splash<Scene<Snow<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
                 });
#endif
    return cases;
}

/// Scenes of which a file is written half way, on one backend.
template <class Backend>
std::vector<RestartCase> restart_cases()
{
    using namespace detail;
    using Elastic = Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls, Backend>;
    std::vector<RestartCase> cases{
        {"block, 2D double, fixed corotated, quadratic, MLS", write_half<Elastic>, go_on<Elastic>}};
#if !defined(FIRN_TESTS_FEW_COMBINATIONS)
    using Plastic = Scene<Snow<Plane>, CubicBSpline, Flip, Backend>;
    using Rounded = Scene<FixedCorotated<SolidFloat>, QuadraticBSpline, Flip, Backend>;
    cases.insert(cases.end(), {{"block, 2D double, snow, cubic, FLIP", write_half<Plastic>, go_on<Plastic>},
                               {"block, 3D float, fixed corotated, quadratic, FLIP", write_half<Rounded>,
                                go_on<Rounded>}});
#endif
    return cases;
}

std::vector<AgreementCase> openmp_cases(); ///< openmp.cpp
std::vector<AgreementCase> cuda_cases();   ///< cuda.cu
std::vector<RestartCase> openmp_restarts();
std::vector<RestartCase> cuda_restarts();

} // namespace firn::test
