// SPDX-License-Identifier: MIT
#include "limits/impact.hpp"
#include "limits/limits.hpp"
#include "limits/stability.hpp"
#include "limits/stack.hpp"

#include <algorithm>
#include <cmath>

using namespace firn;
using namespace firn::test;

// The hard cases that make sense by implicit steps: notes/2026-11-30-hard-cases-by-implicit-steps.md says
// which do not, and why. Steps are far longer than explicit ones may be where nothing else is said.
namespace
{

template <class Model, class Transfer = Mls>
using ByImplicit = Scene<Model, QuadraticBSpline, Transfer, TestedBackend, Implicit>;
using Rubber = ByImplicit<NeoHookean<Plane>>;
using Pair = ByImplicit<Materials<NeoHookean<Plane>, NeoHookean<Plane>>>;
using Point = Vector<double, 2>;

/// No force: steps with gravity and obstacles are compiled for other tests.
Gravity const weightless{{0, 0, 0}};

/// Steps that are solved as exactly as is asked for.
Rubber::Solver::Transfer solved_to(double share) { return {Mls{}, {.share = share}}; }

} // namespace

TEST_CASE("H1, H21: nothing grows in implicit steps of 5 and 50 h / c, nor where these alternate")
{
    HardCase const H1{"H1"}, H21{"H21"};
    namespace of = stability;
    for (double const courant : {5.0, 50.0}) {
        std::string const name = "implicit at " + std::to_string(int(courant)) + " h / c: growth of ";
        for (auto const& [what, points] : {std::pair{"lone particles", of::lone_particles()},
                                           {"scattered particles", of::scattered_particles()},
                                           {"a free block", of::free_block()}})
            H1.at_most(name + what, of::growth<Rubber>(points, courant, 40, {}, false, weightless), 1.01);
    }
    H21.at_most("implicit: growth of scattered particles with steps of 10 and 1 h / c by turns",
                of::alternate<Rubber>(of::scattered_particles(), 1, 40, 10, weightless), 1.01);
}

TEST_CASE("H2, H4: a block hits a wall, and is let go from a hundredth of its volume, in implicit steps")
{
    impact::hit_wall<Rubber>("implicit neo-Hookean", 4, weightless);
    impact::let_go<Rubber>("implicit neo-Hookean", 1, weightless);
}

TEST_CASE("H7: blocks of 1e4 times the mass or stiffness lie on one another in implicit steps")
{
    namespace of = stack;
    Pair::Solver::Transfer const by{Mls{}, {.share = 1e-4}};
    of::pile_up<Pair>("implicit heavy on light", of::block(1, 1e6), of::block(1e4, 1e6), 1, 1e-4, by);
    of::pile_up<Pair>("implicit stiff on soft", of::block(1000, 1e5), of::block(1000, 1e9), 1, 1e-4, by);
}

TEST_CASE("H8, H22: a block drifts, and rings with any number of particles in a cell, in implicit steps")
{
    stability::drift<Rubber>("implicit", 1e-10, 1e-10, 1e-10, 300, 20, weightless);
    HardCase const H22{"H22"};
    double const h = stability::h;
    for (int const per_axis : {1, 2, 3, 8}) {
        Occupancy occupancy;
        auto const points = box_of_points<2>({0, 0}, {8 * h, 8 * h}, h, per_axis);
        auto const [most, strain] =
            stability::ring<Rubber>(points, 64 * h * h / double(points.size()), occupancy, weightless);
        std::string const name = "implicit with " + std::to_string(per_axis * per_axis) + " to a cell: ";
        H22.at_most(name + "most energy in the second half / in the first", most, 1e-3); // damped
        H22.at_most(name + "largest strain", strain, 0.3);
    }
}

// Nodes at the rim of a kernel have 1e-12 of a particle's mass there, and less.
TEST_CASE("H6: a strained particle with no neighbours in one implicit step, wherever it is in its cell")
{
    HardCase const H6{"H6"};
    double const h = 0.0625;
    auto const material = impact::elastic<NeoHookean<Plane>>(1e5, 0.3);
    double const c = wave_speed(material);
    std::vector<double> offsets{-0.5, -0.5 + 0x1p-30, -0.5 + 0x1p-24, -0.5 + 0x1p-19, -0x1p-30, -0.0,
                                0.1,  0x1p-30,        0.5 - 0x1p-24,  0.5 - 0x1p-30};
    std::vector<Point> points;
    for (std::size_t i = 0; i < offsets.size(); ++i)
        for (std::size_t j = 0; j < offsets.size(); ++j)
            points.emplace_back((8 * double(i) + offsets[i]) * h, (8 * double(j) + offsets[j]) * h);
    Rubber::Solver solver(lattice(h), material);
    solver.add(points, 1e-5);
    Matrix<double, 2> H = Matrix<double, 2>::Zero();
    H(0, 0) = -0.1;
    solver.upload<DisplacementGradient>(std::vector<Matrix<double, 2>>(points.size(), H));
    double const dt = 2 * h / c;
    solver.step(dt, weightless);
    H6.at_most("implicit: particles not finite", double(not_finite(solver)), 0);
    H6.at_most("implicit: largest velocity from internal forces / c",
               largest_norm(solver.download<Velocity>()) / c, 1e-6);
    H6.at_most("implicit: largest dt |C|", dt * largest_norm(solver.download<AffineVelocity>()), 1);
}

TEST_CASE("H9: a column that settles stays at rest in 500 long implicit steps")
{
    HardCase const H9{"H9"};
    constexpr double h = 1.0 / 16;
    auto const material = impact::elastic<NeoHookean<Plane>>(1e5, 0.3);
    Rubber::Solver solver(lattice(h), material);
    solver.add(box_of_points<2>({0, 0}, {2 * h, 1}, h), h * h / 4);
    ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = 2, .side = -1}, foot{.axis = 1};
    solver.settle(Gravity{}, left, right, foot);
    auto const before = solver.positions();
    double const dt = 20 * h / wave_speed(material);
    for (int i = 0; i < 500; ++i) solver.step(dt, Gravity{}, left, right, foot);
    auto const after = solver.positions();
    double most = 0;
    for (std::size_t i = 0; i < after.size(); ++i) most = std::max(most, (after[i] - before[i]).norm());
    H9.at_most("implicit: way of a particle / that of the top as it settled", most / 0.0348553, 2e-2);
    H9.at_most("implicit: largest speed / c",
               largest_norm(solver.download<Velocity>()) / wave_speed(material), 1e-6);
}

TEST_CASE("H12: 64 particles at one place are one of 64 times the mass in implicit steps, too")
{
    impact::be_one<Rubber>("implicit: ", 1e-9, solved_to(1e-8));
}

TEST_CASE(
    "H15: a block that falls on a floor in implicit steps lies above it by less than the kernel's reach")
{
    limits::come_to_rest<Rubber>("implicit quadratic", 1.5);
}

TEST_CASE("H18, H23: scenes far away, and speeds and masses beyond reason, in implicit steps")
{
    HardCase const H18{"H18"}, H23{"H23"};
#if defined(FIRN_TESTS_ON_OPENMP) // nvcc would compile single precision for this alone
    for (int distance : {10, 1000})
        H18.at_most("implicit: difference at " + std::to_string(distance) + " m after 100 steps [cells]",
                    limits::drift_apart<ByImplicit<NeoHookean<PlaneFloat>>>(distance, 100, weightless), 1e-4);
#endif
    double const h = 0.125;
    auto const block = [&](double young, double density, double speed, StepControl const& control = {}) {
        Rubber::Solver solver(lattice(h), impact::elastic<NeoHookean<Plane>>(young, 0.3, density), {},
                              control);
        solver.add(box_of_points<2>({0, 0}, {0.25, 0.25}, h), h * h / 4, {speed, 0});
        return solver;
    };
    auto const [fast, time] =
        limits::complaint([&] { block(1e5, 1000, 1e7, {.smallest = 1e-6}).advance(1.0 / 24, weightless); });
    H23.at_least("implicit at 1e7 m/s: errors that name the fastest particle",
                 fast.find("fastest particle 1e+07 m/s") != fast.npos, 1);
    H23.at_most("implicit at 1e7 m/s: time until then [s]", time, 1);
    auto heavy = block(1e35, 1e33, 3), usual = block(1e5, 1e3, 3);
    for (auto* solver : {&heavy, &usual})
        solver->advance(0.05, Gravity{}, Obstacle<HalfSpace>{.motion = {.position = {0, -0.125, 0}}});
    double error = 0;
    auto const a = heavy.positions(), b = usual.positions();
    for (std::size_t i = 0; i < a.size(); ++i) error = std::max(error, (a[i] - b[i]).norm() / h);
    H23.at_most("implicit with 1e30 times the mass and stiffness: difference [cells]", error, 1e-8);
}

TEST_CASE("H24, H25: implicit steps of no particle, one, and thousands in a cell, and from a snapshot")
{
    HardCase const H24{"H24"}, H25{"H25"};
    double const h = 0.1, dt = 1e-2;
    auto const material = impact::elastic<NeoHookean<Plane>>(1e5, 0.3);
    Obstacle<HalfSpace> const floor{};
    Rubber::Solver empty(lattice(h), material), one(lattice(h), material), many(lattice(h), material);
    empty.advance(0.1, Gravity{}, floor);
    H24.at_most("implicit without a particle: time that is missing [s]", std::abs(empty.time() - 0.1), 0);
    one.add(std::vector<Point>{{0.03, 2}}, 1e-4);
    int const steps = 10;
    for (int i = 0; i < steps; ++i) one.step(dt, Gravity{}, floor);
    double const fall = 0.5 * 9.81 * steps * dt * (steps + 1) * dt;
    H24.at_most("implicit with one particle: error of its fall [cells]",
                (one.positions()[0] - Point(0.03, 2 - fall)).norm() / h, 1e-12);
    std::mt19937 random(2);
    std::uniform_real_distribution<double> inside(0.05 * h, 0.95 * h);
    std::vector<Point> points(10000);
    for (auto& x : points) x = {inside(random), inside(random)};
    many.add(points, h * h / double(points.size()));
    for (int i = 0; i < 5; ++i) many.step(dt, Gravity{}, floor);
    H24.at_most("implicit with 1e4 particles in one cell: particles not finite", double(not_finite(many)), 0);

    auto goes_on = impact::with_cluster<Rubber>({}, 0);
    auto restored = Rubber::Solver(lattice(h), material);
    restored.restore(goes_on.snapshot());
    for (auto* const solver : {&goes_on, &restored}) solver->advance(0.1, Gravity{}, floor);
    H25.at_most("implicit: restarts that are not the run that wrote",
                double(!(goes_on.positions() == restored.positions())), 0);
}
