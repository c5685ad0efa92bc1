// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"
#include "support/tangent.hpp"

#include <cmath>

using namespace firn;
using namespace firn::test;

namespace
{

using Rubber = NeoHookean<Plane>;
template <class Transfer, class Model = Rubber, class By = Implicit>
using ImplicitSolver = Solver<TestedBackend, Model, QuadraticBSpline, Transfer, By>;

/// A column of height 1 m that stands between slippery walls: its material, and its particles.
template <class Solver>
struct Column
{
    Column(int cells, Implicit const& by = {})
        : solver(lattice(1.0 / cells), material(), {typename Solver::Transfer::Explicit{}, by}),
          points(box_of_points<2>({0, 0}, {2.0 / cells, 1}, 1.0 / cells))
    {
        solver.add(points, 2.0 / cells / double(points.size()));
    }
    static typename Solver::Model material()
    {
        typename Solver::Model of;
        of.density = 1000;
        of.elasticity = lame<typename Solver::Number>(1e5, 0.3);
        return of;
    }
    RestReport settle()
    {
        return solver.settle(Gravity{}, ReflectingWall{.axis = 0},
                             ReflectingWall{.axis = 0, .node = 2, .side = -1}, ReflectingWall{.axis = 1});
    }
    /// The root mean square error of the first Piola-Kirchhoff stress, which is that of the weight above,
    /// over the stress at the foot.
    double error() const
    {
        auto const H = solver.template download<DisplacementGradient>();
        double squares = 0;
        for (std::size_t i = 0; i < points.size(); ++i) {
            auto state = Record<double, 2, Rubber::State>::at_rest();
            state[DisplacementGradient{}] = H[i].template cast<double>();
            auto const P = first_piola(Rubber{.elasticity = lame<double>(1e5, 0.3)}, state);
            double const error = P(1, 1) / (1000 * 9.81) + 1 - points[i].y();
            squares += error * error;
        }
        return std::sqrt(squares / double(points.size()));
    }
    /// How far the top has sunk [m].
    double sunk() const
    {
        auto const x = solver.positions();
        auto const H = solver.template download<DisplacementGradient>();
        std::size_t const top = points.size() - 1;
        return points[top].y() - x[top].y() - double(H[top](1, 1)) * (1 - points[top].y());
    }

    Solver solver;
    std::vector<Eigen::Vector2d> points;
};

/// The displacement of the middle of the free end of a beam of length 1 m and thickness 0.1 m that is clamped
/// at the other one, per weight times L^3 over its flexural rigidity; 16 particles per cell, of which so many
/// lie across it. Or what is left of that when the beam has lost its weight.
template <class Transfer>
Eigen::Vector2d hanging(double load, RestReport& report, bool relieved = false, int cells = 6)
{
    constexpr double thickness = 0.1, young = 1e6, density = 679.6,
                     rigidity = young * thickness * thickness * thickness / 12;
    double const h = thickness / cells;
    ImplicitSolver<Transfer> beam(lattice(h), {.density = density, .elasticity = lame<double>(young, 0)});
    auto const points = box_of_points<2>({-4 * h, -thickness / 2}, {1, thickness / 2}, h, 4);
    beam.add(points, h * h / 16);
    Obstacle<HalfSpace> const clamp{.shape = {{1, 0, 0}}, .contact = Contact::sticky()};
    report = beam.settle(Gravity{{0, -load * rigidity / (density * thickness), 0}}, clamp);
    if (relieved) report = beam.settle(Gravity{{0, 0, 0}}, clamp);
    auto const x = beam.positions();
    auto const H = beam.template download<DisplacementGradient>();
    Eigen::Vector2d sum(0, 0);
    int count = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        if (std::abs(points[i].y()) < 0.3 * h && points[i].x() > 1 - 0.3 * h) {
            sum += x[i] - points[i] + H[i].col(0) * (1 - points[i].x());
            ++count;
        }
    return sum / count;
}

/// A bar of length 1 m that swings lengthwise in its first mode, with a free end, in steps in which a wave
/// goes so many cells.
template <class By>
struct SwingingBar
{
    static constexpr int wide = 2;  ///< [cells]
    static constexpr double c = 10; ///< [m/s]

    explicit SwingingBar(double cells_of_wave, double share = 1e-3, int cells = 32, double error = 0)
        : h(1.0 / cells), dt(cells_of_wave * h / c),
          bar(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0)}, {Flip{1}, by(share, error)}),
          points(box_of_points<2>({0, 0}, {1, wide * h}, h))
    {
        bar.add(points, h * h / 4);
        auto v = bar.template download<Velocity>();
        for (std::size_t i = 0; i < v.size(); ++i) v[i].x() = 1e-3 * std::sin(M_PI / 2 * points[i].x());
        bar.template upload<Velocity>(v);
    }
    void step(std::size_t steps)
    {
        bar.steps(steps, dt, ReflectingWall{.axis = 0}, ReflectingWall{.axis = 1},
                  ReflectingWall{.axis = 1, .node = wide, .side = -1});
    }
    AdvanceReport advance(double duration)
    {
        return bar.advance(duration, ReflectingWall{.axis = 0}, ReflectingWall{.axis = 1},
                           ReflectingWall{.axis = 1, .node = wide, .side = -1});
    }
    static By by(double share, double error)
    {
        By by;
        by.share = share;
        by.error = error;
        return by;
    }
    double energy() const { return bar.energy().kinetic + bar.energy().elastic; }
    /// By how much its phase turns in a step.
    double turn() const { return M_PI / 2 * c * dt; }

    double h, dt; ///< [m], [s]
    ImplicitSolver<Flip, Rubber, By> bar;
    std::vector<Eigen::Vector2d> points;
};

template <class Backend>
concept HasThreads = requires(Backend backend)
{
    backend.threads;
};
template <class Backend>
Backend on_threads([[maybe_unused]] int threads)
{
    Backend backend;
    if constexpr (HasThreads<Backend>) backend.threads = threads;
    return backend;
}

} // namespace

TEST_CASE("a product with the tangent is the derivative of stress, symmetric, and turns with the frame")
{
    check_product(NeoHookean<Plane>{.elasticity = lame<double>(1e5, 0.3)});
    check_product(NeoHookean<Solid>{.elasticity = lame<double>(1e5, 0.4)});
    check_product(SplitNeoHookean<Plane>{.elasticity = lame<double>(1e5, 0.3)});
    check_product(SplitNeoHookean<Solid>{.elasticity = lame<double>(1e5, 0.4)});
    check_product(FixedCorotated<Plane>{.elasticity = lame<double>(1e5, 0.3)});
    check_product(FixedCorotated<Solid>{.elasticity = lame<double>(1e5, 0.3)});
    Hencky<Plane> in_the_plane;
    in_the_plane.elasticity = lame<double>(1e5, 0.3);
    check_product(in_the_plane);
    Hencky<Solid> in_space;
    in_space.elasticity = lame<double>(1e5, 0.3);
    check_product(in_space);
}

// 0.034855 m is the integral of the stretches that the weight above causes.
TEST_CASE("an implicit column stands as equilibrium has it, and its walls bear the weight")
{
    Column<ImplicitSolver<Mls>> column(32);
    std::size_t const bytes = column.solver.memory();
    auto const report = column.settle();
    CHECK(column.solver.memory() >=
          bytes + column.points.size() * TrialFields<Rubber>::components(2) * sizeof(double));
    CHECK(column.sunk() == Approx(0.0348553).epsilon(1e-3));
    CHECK(column.error() <= 3.0e-3); // it falls with the cell size
    CHECK(report.load_steps == 1);
    CHECK(report.solve.passes <= 40);
    CHECK(report.solve.converged);
    CHECK(report.solve.residual <= report.solve.tolerance);
    CHECK(report.reactions[2].impulse.y() == Approx(-9810.0 * 2 / 32).epsilon(1e-3));
    CHECK(report.reactions[0].impulse.x() == Approx(-report.reactions[1].impulse.x()));
    CHECK(column.solver.time() == 0);
    for (auto const& v : column.solver.download<Velocity>()) CHECK(v.norm() == 0);
    // it is at rest for steps, too, of any length
    auto const before = column.solver.positions();
    column.solver.step(1, Gravity{}, ReflectingWall{.axis = 0},
                       ReflectingWall{.axis = 0, .node = 2, .side = -1}, ReflectingWall{.axis = 1});
    auto const after = column.solver.positions();
    for (std::size_t i = 0; i < after.size(); ++i) CHECK((after[i] - before[i]).norm() < 2e-3 * 0.0348553);

    Column<ImplicitSolver<Apic>> finer(64);
    CHECK(finer.settle().solve.passes <= 50);
    CHECK(finer.sunk() == Approx(0.0348553).epsilon(1e-3));
    CHECK(finer.error() <= 4e-4);
    Column<ImplicitSolver<Mls>> fine(64);
    fine.settle();
    CHECK(fine.error() <= 1.5e-3);

    Column<ImplicitSolver<Apic, NeoHookean<PlaneFloat>>> in_float(32);
    in_float.settle();
    CHECK(in_float.sunk() == Approx(0.0348553).epsilon(2e-3));
}

// The law of the column gives its stretches in closed form: P = M (F - 1), and P = M ln F / F.
TEST_CASE("implicit columns of other laws stand as equilibrium has it")
{
    Column<ImplicitSolver<Mls, FixedCorotated<Plane>>> corotated(32);
    CHECK(corotated.settle().solve.passes <= 40);
    CHECK(corotated.sunk() ==
          Approx(1000 * 9.81 / (2 * lame<double>(1e5, 0.3).p_wave_modulus())).epsilon(1e-3));
    Column<ImplicitSolver<Mls, Hencky<Plane>>> hencky(32);
    CHECK(hencky.settle().solve.passes <= 40);
    CHECK(hencky.sunk() == Approx(0.0340137).epsilon(1e-3));
    // to first order, since strains are 7 per cent at the foot
    Column<ImplicitSolver<Apic, SplitNeoHookean<Plane>>> split(32);
    split.settle();
    CHECK(split.sunk() == Approx(1000 * 9.81 / (2 * lame<double>(1e5, 0.3).p_wave_modulus())).epsilon(0.06));
}

// With shear and stretch (Reissner's beam) its end sinks by 0.12446 m, and by 0.12448 m as finite elements
// have it (quadratic ones, 40 along the beam and 4 across it). Nodes on the clamp are held, which lets it
// turn by as much as if it were a quarter of a cell longer: see
// tests/notes/2026-11-22-beams-that-hang-too-far.md. The other numbers are those of elastic_bodies.cpp, of
// finite elements.
TEST_CASE("an implicit cantilever hangs as a beam does, and its clamp bears its weight")
{
    RestReport report;
    CHECK(hanging<Apic>(1, report).y() == Approx(-0.12448).epsilon(0.02));
    double const weight = 1e6 / 12 * 1e-3 * (1 + 4 * 0.1 / 6);
    CHECK(report.reactions[0].impulse.y() == Approx(-weight).epsilon(1e-4));
    CHECK(report.load_steps == 1);
    CHECK(hanging<Apic>(1, report, false, 8).y() == Approx(-0.12448).epsilon(0.015));
    CHECK(hanging<Mls>(1, report).y() == Approx(-0.12448).epsilon(0.015));
    CHECK(hanging<Mls>(1, report, true).norm() <= 2e-3 * 0.12448); // it is straight again
}

// All transfers but MLS have the kernel's gradient, and so the same forces at rest.
TEMPLATE_TEST_CASE("an implicit cantilever hangs down by two thirds of its length, and is straight again", "",
                   Apic, Mls)
{
    RestReport report;
    auto const tip = hanging<TestType>(8, report);
    CHECK(tip.y() == Approx(-0.64899).epsilon(0.015));
    CHECK(tip.x() == Approx(-0.27845).epsilon(0.02)); // it goes with the square of that
    CHECK(report.load_steps == 1);
    CHECK(report.solve.passes <= 1000);
    CHECK(hanging<TestType>(8, report, true).norm() <= 2e-3 * 0.64899);
}

TEST_CASE("transfers that have the kernel's gradient come to the same state of rest")
{
    RestReport report;
    auto const apic = hanging<Apic>(1, report, false, 2);
    CHECK((hanging<Flip>(1, report, false, 2) - apic).norm() <= 1e-8);
    CHECK((hanging<Pic>(1, report, false, 2) - apic).norm() <= 1e-8);
    CHECK((hanging<Mls>(1, report, false, 2) - apic).norm() > 1e-4);
}

TEST_CASE("an implicit bar loses its energy as backward Euler does, and by the midpoint rule keeps it")
{
    for (double const cells_of_wave : {1.0, 3.0}) {
        CAPTURE(cells_of_wave);
        SwingingBar<Implicit> bar(cells_of_wave);
        double const begin = bar.energy();
        auto const steps = static_cast<std::size_t>(std::lround(10 * 2 * M_PI / bar.turn()));
        bar.step(steps);
        CHECK(std::abs(bar.energy() / begin - std::pow(1 + bar.turn() * bar.turn(), -double(steps))) <= 1e-3);
    }
    // What particles take over is a change dv of nodes, of which they lose what lumping the mass makes of it:
    // dv (M_lumped - M) dv / 2, (k h)^2 / 4 of its energy (Love & Sulsky 2006). dv = turn v / (1 + turn^2 /
    // 4).
    for (double const cells_of_wave : {3.0, 10.0}) {
        CAPTURE(cells_of_wave);
        SwingingBar<ImplicitMidpoint> bar(cells_of_wave);
        double const begin = bar.energy(), lumped = std::pow(M_PI / 2 * bar.h, 2) / 4;
        auto const steps = static_cast<std::size_t>(std::lround(10 * 2 * M_PI / bar.turn()));
        bar.step(steps);
        double const turn2 = bar.turn() * bar.turn(),
                     kept = std::pow(1 - lumped / 2 * turn2 / (1 + turn2 / 4), double(steps));
        CHECK(kept > 0.99);
        CHECK(std::abs(bar.energy() / begin - kept) <=
              2e-4 + lumped); // as kinetic energy is that of particles
    }
    for (double const cells_of_wave : {3.0, 10.0}) { // the loss falls with the third power of the cell size
        CAPTURE(cells_of_wave);
        SwingingBar<ImplicitMidpoint> bar(cells_of_wave, 1e-3, 128);
        double const begin = bar.energy();
        bar.step(static_cast<std::size_t>(std::lround(10 * 2 * M_PI / bar.turn())));
        CHECK(std::abs(bar.energy() / begin - 1) <= 2e-4);
    }
}

// At the same time, in steps in which a wave goes 4, 2 and 1 cells: errors of first order halve, those of
// second order are quartered.
TEMPLATE_TEST_CASE(
    "the error of implicit steps is of first order in their length, of the midpoint rule of second", "",
    Implicit, ImplicitMidpoint)
{
    auto const swung = [](int halvings) {
        SwingingBar<TestType> bar(4.0 / (1 << halvings), 1e-6);
        bar.step(std::size_t(6) << halvings); // 0.94 of a quarter of the period
        return bar.bar.positions().back().x() - bar.points.back().x();
    };
    double const coarse = swung(0), middle = swung(1), fine = swung(2);
    CHECK((coarse - middle) / (middle - fine) ==
          Approx(std::is_same_v<TestType, Implicit> ? 2 : 4).epsilon(0.15));
}

// It is dt^2 / 2 times the acceleration: of free fall all of the step's error, and of a swinging bar a
// quarter in half as long a step.
TEST_CASE("a step of backward Euler knows the error of its positions, to second order in its length")
{
    Implicit by;
    by.error = 1e-9; // a step of given length is taken all the same
    ImplicitSolver<Mls> block(lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
                              {Mls{}, by});
    block.add(box_of_points<2>({0, 0}, {0.5, 0.5}, 0.1), 0.1 * 0.1 / 4);
    double const before = block.positions()[0].y(), dt = 0.02;
    for (int i = 1; i <= 2; ++i) {
        block.step(dt, Gravity{});
        double const falls = 9.81 * (i * dt) * (i * dt) / 2;
        CHECK(before - block.positions()[0].y() - falls == Approx(i * block.solved().error));
    }
    auto const error_of = [](double cells_of_wave) {
        SwingingBar<Implicit> bar(cells_of_wave, 1e-6, 32, 1);
        bar.step(static_cast<std::size_t>(std::lround(32 / cells_of_wave))); // to a quarter of its period
        return bar.bar.solved().error;
    };
    double const coarse = error_of(4), middle = error_of(2), fine = error_of(1);
    CHECK(coarse / middle == Approx(4).epsilon(0.1));
    CHECK(middle / fine == Approx(4).epsilon(0.05));
}

// The error of a step goes with the square of its length and there are as many steps more, so a quarter of it
// takes twice the steps and halves the error of the whole time: 0.94 of a quarter of a period.
TEST_CASE(
    "advance takes implicit steps as long as their error allows, says so, and repeats what is beyond it")
{
    double const time = 0.94 * 0.1;
    auto const swung = [&](double error, std::uint64_t& steps) {
        SwingingBar<Implicit> bar(1, 1e-6, 32, error);
        auto const report = bar.advance(time);
        steps = report.substeps;
        CHECK(report.rejected > 0); // motion alone allows one step for all
        auto const by = [&](StepLimit limit) { return report.limited_by[std::size_t(limit)]; };
        CHECK(by(StepLimit::accuracy) >= steps / 3); // else they may grow no faster, after they were shorter
        CHECK(by(StepLimit::accuracy) + by(StepLimit::growth) + by(StepLimit::duration) + report.rejected >=
              steps);
        CHECK(bar.bar.solved().error <= 2 * error);
        return bar.bar.positions().back().x() - bar.points.back().x();
    };
    std::uint64_t some = 0, many = 0;
    double const turn = M_PI / 2 * 10, exact = 1e-3 / turn * std::sin(turn * time); // 10 m/s
    double const middle = swung(1e-7, some) - exact, fine = swung(2.5e-8, many) - exact;
    CHECK(double(many) / double(some) == Approx(2).epsilon(0.1));
    CHECK(middle / fine == Approx(2).epsilon(0.1));
}

// Waves go through 100 cells in the step: without coarse grids it takes as many products as there are cells
// across, and with them about 20 for each linear system, of a body of any size and of a soft one with a part
// in it that is a thousand times as stiff.
TEST_CASE("coarse grids keep the products of an implicit step as few in finer cells and beside stiff parts")
{
    auto const products = [](int cells, double stiff, bool coarse) {
        double const h = 1.0 / cells;
        Implicit by;
        by.coarse = coarse;
        Rubber const soft{.density = 1000, .elasticity = lame<double>(1e5, 0.3)};
        ImplicitSolver<Mls, Materials<Rubber, Rubber>> body(
            lattice(h), {soft, {.density = 1000, .elasticity = lame<double>(1e5 * stiff, 0.3)}}, {Mls{}, by});
        std::vector<Eigen::Vector2d> around, inside;
        for (auto const& x : box_of_points<2>({0.3 * h, 0.3 * h}, {1 + 0.3 * h, 1 + 0.3 * h}, h))
            ((x - Eigen::Vector2d(0.5, 0.5)).norm() < 0.2 ? inside : around).push_back(x);
        body.add<Material<0>>(around, h * h / 4);
        body.add<Material<1>>(inside, h * h / 4);
        body.step((stiff > 1 ? 10 : 100) * h / std::sqrt(soft.elasticity.p_wave_modulus() / 1000),
                  Gravity{{0, -0.1, 0}},
                  Obstacle<HalfSpace>{.contact = Contact::sticky(), .motion = {.position = {0, 0.8 * h, 0}}});
        return double(body.solved().products) / body.solved().newton;
    };
    double const finer = products(64, 1, true);
    CHECK(products(32, 1, true) <= 25);
    CHECK(finer <= 25);
    CHECK(products(64, 1, false) >= 2 * finer);
    CHECK(products(32, 1000, true) <= 25);
    CHECK(products(32, 1000, false) >= 1.5 * products(32, 1000, true));
}

#if !defined(__CUDACC__) || defined(FIRN_TESTS_ALL) // minutes of nvcc, for iterations that are as many
// Each of 8 particles: as many products in cells of half the width, in steps ten times as long, and some more
// where a ball inside is 1000 times as stiff.
TEST_CASE(
    "in space, too, products of an implicit step are as few in finer cells, longer steps and stiff parts")
{
    using Body = Heterogeneous<NeoHookean<Solid>>;
    auto const products = [](int cells, double cells_of_wave, double stiff, bool coarse) {
        double const h = 1.0 / cells;
        Body model;
        model.elasticity = lame<double>(1e5, 0.3);
        ImplicitSolver<Mls, Body> body(lattice(h), model, {Mls{}, {.coarse = coarse}});
        Eigen::Vector3d const low = Eigen::Vector3d::Constant(0.3 * h);
        body.add(box_of_points<3>(low, low + Eigen::Vector3d::Ones(), h), h * h * h / 8);
        auto stiffness = body.download<Stiffness>();
        auto const x = body.positions();
        for (std::size_t i = 0; i < x.size(); ++i)
            if ((x[i] - Eigen::Vector3d::Constant(0.5)).norm() < 0.25) stiffness[i] = stiff;
        body.upload<Stiffness>(stiffness);
        body.step(cells_of_wave * h / std::sqrt(model.elasticity.p_wave_modulus() / model.density),
                  Gravity{{0, -0.1, 0}},
                  Obstacle<HalfSpace>{.contact = Contact::sticky(), .motion = {.position = {0, 0.8 * h, 0}}});
        return double(body.solved().products) / body.solved().newton;
    };
    for (int const cells : {12, 24})
        for (double const cells_of_wave : {10.0, 100.0}) {
            CAPTURE(cells, cells_of_wave);
            CHECK(products(cells, cells_of_wave, 1, true) <= 10);
        }
    CHECK(products(24, 100, 1, false) >= 25);
    double const coarser = products(12, 10, 1000, true), finer = products(24, 10, 1000, true);
    CHECK(coarser <= 32);
    CHECK(finer <= coarser);
    CHECK(products(12, 30, 1000, true) <= 45);
    CHECK(products(12, 10, 1000, false) >= 1.5 * coarser);
}
#endif

// Their cells are listed then, while those of a compact scene are marked in a box around it.
TEST_CASE("coarse grids lie under bodies that are far from each other, too")
{
    auto const products = [](double cells_apart) {
        constexpr double h = 0.05;
        ImplicitSolver<Mls> bodies(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
        for (double const x : {0.3 * h, (cells_apart + 0.3) * h})
            bodies.add(box_of_points<2>({x, 0.3 * h}, {1 + x, 1 + 0.3 * h}, h), h * h / 4);
        bodies.step(
            100 * h / std::sqrt(bodies.model().elasticity.p_wave_modulus() / 1000), Gravity{{0, -0.1, 0}},
            Obstacle<HalfSpace>{.contact = Contact::sticky(), .motion = {.position = {0, 0.8 * h, 0}}});
        return double(bodies.solved().products) / bodies.solved().newton;
    };
    CHECK(products(40) <= 25);
    CHECK(products(100000) <= 25);
}

TEST_CASE("a stiff body falls freely in an implicit step a thousand times too long for explicit ones")
{
    constexpr double h = 0.1, stiff = 1e10;
    using Body = NeoHookean<Solid>;
    ImplicitSolver<Mls, Body> body(lattice(h), {.density = 1000, .elasticity = lame<double>(stiff, 0.3)});
    auto const points = box_of_points<3>({0, 0, 0}, {0.4, 0.4, 0.4}, h);
    body.add(points, h * h * h / 8, {1, 0, 0});
    double const c = std::sqrt(body.model().elasticity.p_wave_modulus() / 1000), dt = 1000 * h / c;
    double const before = body.totals().momentum.y();
    for (int i = 0; i < 3; ++i) {
        body.step(dt, Gravity{});
        CHECK(body.solved().newton <= 1);
        CHECK(body.solved().products <= 2);
    }
    double const mass = body.totals().mass;
    CHECK(body.totals().momentum.y() - before == Approx(-mass * 9.81 * 3 * dt));
    CHECK(body.totals().momentum.x() == Approx(mass));
}

// Outside forces alone would shear it by 10 m over a cell in the step. In a step as long it hangs as at rest.
TEST_CASE("an implicit step in which gravity would shear a stiff beam without bounds starts from where it is")
{
    constexpr double h = 0.05;
    Obstacle<HalfSpace> const clamp{.shape = {{1, 0, 0}}, .contact = Contact::sticky()};
    auto const points = box_of_points<2>({-2 * h, 0}, {10 * h, 4 * h}, h, 3);
    auto const hangs = [&](auto const& load) {
        ImplicitSolver<Apic> beam(lattice(h), {.density = 7850, .elasticity = lame<double>(2e11, 0.3)},
                                  {Apic{}, {.share = 1e-3}});
        beam.add(points, h * h / 9);
        load(beam);
        return beam.positions().back().y() - points.back().y();
    };
    double const at_rest = hangs([&](auto& beam) { beam.settle(Gravity{}, clamp); });
    CHECK(at_rest < 0);
    CHECK(hangs([&](auto& beam) { beam.step(1, Gravity{}, clamp); }) == Approx(at_rest).epsilon(0.01));
}

TEST_CASE("a search tells the host of each iteration that has ended, and of its own end")
{
    SearchState search;
    std::uint32_t number = 7; // of a search before
    auto const iterate = [&](double curvature, double rz) {
        ChooseLength{&search, &number}({curvature});
        int const before = SearchProgress{number}.products();
        ChooseDirection{&search, {}, &number}({rz});
        return before;
    };
    auto const told = [&] { return SearchProgress{number}; };
    auto const begin = [&](double rz) { BeginSearch{&search, 0.1, {}, &number}({rz}); };
    begin(1);
    CHECK(told().products() == 0);
    CHECK(!told().has_ended());
    CHECK(iterate(2, 0.5) == 0); // the product is there, but not all of the iteration
    CHECK(told().products() == 1);
    CHECK(!told().has_ended());
    iterate(2, 0.009); // of which a tenth is squared
    CHECK(told().products() == 2);
    CHECK(told().has_ended());
    iterate(2, 0.005); // queued in vain
    CHECK(told().products() == 2);
    begin(1);
    CHECK(!told().has_ended());
    iterate(2, 0.5);
    iterate(-1, 0.4); // the energy does not rise along it
    CHECK(told().has_ended());
    begin(0);
    CHECK(told().has_ended());
}

TEST_CASE("what settle displaces lies in the order of cells, and tells where no scene can be")
{
    using Set = Fields<Velocity, DisplacementGradient>;
    constexpr int columns = Set::components(2);
    constexpr double h = 0.1;
    double const nothing = std::numeric_limits<double>::quiet_NaN();
    // of two particles in row 1 and 0; velocities become 0, and gradients are found
    double offset[2]{0.4, -0.2}, to_offset[2][2]{}, values[2]{1, 2}, to_values[columns][2]{};
    std::uint32_t id[2]{1, 0}, to_id[2]{};
    double way[2]{0.03, 0.02}, gradient[2]{7, 8}, modulus[2]{3, 4}, found[2]{};
    Coordinates<2> cells[2];
    TableView<double const, 2, Set> from{{offset, offset}, {}, id};
    TableView<double, 2, Set> to{{to_offset[0], to_offset[1]}, {}, to_id};
    firn::detail::NewValues<double, columns> becomes;
    using Is = decltype(becomes)::Is;
    for (int c = 0; c < columns; ++c) {
        from.component[std::size_t(c)] = values;
        to.component[std::size_t(c)] = to_values[c];
        becomes.is[std::size_t(c)] = c < 2 ? Is::nothing : c == 2 ? Is::found : Is::kept;
        becomes.by_row[std::size_t(c)] = gradient;
    }
    firn::detail::DisplaceParticle<double, 2, Set> const displace{from, to,  becomes, {way, way}, modulus,
                                                                  h,    100, cells,   found};
    auto const tells = [&] { // of the first particle, which lies last in the order of cells
        displace(0, {5, -5}, 1);
        return found[1];
    };
    CHECK(tells() == 4);
    CHECK((cells[1] == Coordinates<2>{6, -4})); // 0.4 + 0.2 cells
    CHECK(to_offset[0][1] == Approx(-0.4));
    CHECK(to_id[1] == 1);
    CHECK(to_values[0][1] == 0);
    CHECK(to_values[2][1] == 8);
    CHECK(to_values[3][1] == 1);
    modulus[1] = nothing;
    CHECK(tells() == std::numeric_limits<double>::infinity());
    way[1] = 95.6 * h;
    CHECK(tells() < 0);
    way[1] = nothing;
    CHECK(tells() < 0);
    way[1] = 0;
    CHECK(tells() > 0);
    gradient[1] = nothing;
    CHECK(tells() < 0);
}

TEST_CASE("implicit steps have the same bits in every run, and on any number of threads")
{
    auto const run = [](auto const& backend) {
        constexpr double h = 0.1;
        ImplicitSolver<Mls> block(lattice(h), {.density = 1000, .elasticity = lame<double>(1e6, 0.3)}, {}, {},
                                  backend);
        auto const points = box_of_points<2>({0, 0}, {3, 2}, h);
        block.add(points, h * h / 4);
        auto const report = block.advance(0.02, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()});
        CHECK(report.substeps < 10); // explicit ones would be 30
        return block.positions();
    };
    auto const once = run(TestedBackend{});
    CHECK(run(TestedBackend{}) == once);
    if constexpr (HasThreads<TestedBackend>)
        for (int const threads : {1, 2, 3}) CHECK(run(on_threads<TestedBackend>(threads)) == once);
}

// No wave bounds implicit steps, but the first explicit one has to be as short as the stiffer material asks.
TEST_CASE("an explicit solver goes on from an implicit one's state in steps that its stiffest material bears")
{
    using Two = Materials<Rubber, Rubber>;
    Rubber const soft{.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
        stiff{.density = 1000, .elasticity = lame<double>(1e8, 0.3)};
    ImplicitSolver<Mls, Two> stepped(lattice(0.1), {soft, stiff});
    stepped.add<Material<0>>(box_of_points<2>({0, 0}, {0.5, 0.2}, 0.1), 0.1 * 0.1 / 4);
    stepped.add<Material<1>>(box_of_points<2>({0, 0.2}, {0.5, 0.4}, 0.1), 0.1 * 0.1 / 4);
    stepped.step(0.01, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()});
    ImplicitSolver<Mls, Two, SymplecticEuler> going_on(lattice(0.1), {soft, stiff});
    going_on.restore(stepped.snapshot());
    double const wave = std::sqrt(stiff.elasticity.p_wave_modulus() / 1000);
    CHECK(going_on.bounds().wave_speed >= wave);
    CHECK(going_on.stable_step() <= 0.1 / wave);
}

TEST_CASE("what implicit steps do not know is refused, and a step that is not solved leaves the state")
{
    Gravity const gravity;
    auto const rubber = [](Implicit const& by = {}) {
        ImplicitSolver<Mls> block(lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
                                  {Mls{}, by});
        block.add(box_of_points<2>({0, 0}, {0.5, 0.5}, 0.1), 0.1 * 0.1 / 4);
        return block;
    };
    auto block = rubber();
    auto const before = block.positions();
    CHECK_FALSE(refused([&] { block.settle(gravity); }).what_is_wrong().empty()); // nothing holds it
    CHECK(refused([&] {
              block.settle(gravity, Obstacle<HalfSpace>{.contact = Contact::sticky(),
                                                        .motion = {.velocity = {1, 0, 0}}});
          })
              .what_is_wrong()
              .find("moves") != std::string::npos);
    CHECK(block.positions() == before);
    CHECK(block.time() == 0);
    block.step(1e-3, gravity, Obstacle<HalfSpace>{.contact = Contact::sticky()});

    auto hasty = rubber({.tolerance = 1e-12, .newton = 1}); // too few linear systems for such a residual
    auto const at_first = hasty.positions();
    try {
        hasty.step(0.01, gravity, Obstacle<HalfSpace>{.contact = Contact::sticky()});
        FAIL("it converged");
    }
    catch (StepError const& unsolved) {
        CHECK(unsolved.failure().cause == FailureCause::unsolved);
        CHECK(std::string(unsolved.remedy()).find("linear systems the residual was") != std::string::npos);
    }
    CHECK_FALSE(hasty.solved().converged);
    CHECK(hasty.positions() == at_first);
    for (auto const& v : hasty.download<Velocity>()) CHECK(v.norm() < 1e-12);
    hasty.step(1e-9, Gravity{{0, 0, 0}});
    CHECK(hasty.time() == 1e-9);

    refused([&] { rubber({.share = 0}); });
    refused([&] { rubber({.tolerance = -1}); });
    refused([&] { rubber({.forcing = 1}); });
    refused([&] { rubber({.newton = 0}); });
    refused([&] { rubber({.linear = 0}); });
    refused([&] { rubber({.error = -1}); });
    CHECK(
        refused([&] { SwingingBar<ImplicitMidpoint>(1, 1e-3, 32, 1e-6); }).remedy().find("choose Implicit") !=
        std::string::npos);
}

// A block that falls on a floor: in steps that motion alone bounds it takes 4.4 linear systems on the mean.
TEST_CASE(
    "advance takes shorter implicit steps after one with many linear systems, says so, and lets them grow")
{
    constexpr double h = 0.1;
    Obstacle<HalfSpace> const floor{.contact = Contact::slip()};
    struct Ran
    {
        AdvanceReport report;
        double systems; ///< in a step, on the mean
    };
    auto const run = [&](int target) {
        Implicit by;
        by.share = 1e-5;
        by.target = target;
        ImplicitSolver<Mls> block(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
                                  {Mls{}, by});
        block.add(box_of_points<2>({0, 0.3}, {0.8, 1.1}, h), h * h / 4, {0, -4});
        auto const report = block.advance(0.3, Gravity{}, floor);
        return Ran{report, double(block.solved().newton) / double(report.substeps)};
    };
    auto const by = [](Ran const& of, StepLimit limit) {
        return of.report.limited_by[static_cast<std::size_t>(limit)];
    };
    Ran const any = run(0), few = run(3), many = run(1000);
    CAPTURE(any.report.substeps, any.systems, few.report.substeps, few.systems, few.report.rejected,
            by(few, StepLimit::convergence), by(few, StepLimit::growth), any.report.smallest_dt,
            few.report.smallest_dt, few.report.largest_dt, any.report.largest_dt);
    CHECK(by(any, StepLimit::convergence) == 0);
    CHECK(many.report.substeps == any.report.substeps);
    CHECK(any.systems > 3.3);
    CHECK(few.systems < any.systems - 0.2);
    CHECK(by(few, StepLimit::convergence) > 5);
    CHECK(few.report.smallest_dt < 0.8 * any.report.smallest_dt);
    CHECK(by(few, StepLimit::growth) > 5); // after steps of fewer systems
    CHECK(std::string(describe(StepLimit::convergence)) == "convergence");
    CHECK(std::string(describe(StepLimit::duration)) == "duration");
    CHECK(refused([] {
              ImplicitSolver<Mls>(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
                                  {Mls{}, Implicit{.target = -1}});
          })
              .remedy()
              .find("0 for any") != std::string::npos);
}

// Ten products for each system leave a part of the residual, which the step is taken with all the same; what
// is left of it after a system is the smaller the more systems there are. The block falls on a floor which it
// meets with 4 m/s, so that it is squeezed by a third.
TEST_CASE("implicit steps of a fixed number of products are taken whatever is left, and their cost is known")
{
    Obstacle<HalfSpace> const floor{.contact = Contact::sticky(), .motion = {.position = {0, -0.05, 0}}};
    auto const run = [&](auto const& backend, Implicit const& by, int systems, int products, int steps) {
        constexpr double h = 0.1;
        ImplicitSolver<Mls> block(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
                                  {Mls{}, by}, {}, backend);
        block.add(box_of_points<2>({0, 0}, {1.6, 1.2}, h), h * h / 4, {0, -4});
        int unsolved = 0;
        for (int i = 0; i < steps; ++i) {
            block.step(0.01, Gravity{}, floor);
            auto const& solved = block.solved();
            unsolved += solved.converged ? 0 : 1;
            CHECK(is_finite(solved.residual));
            if (!by.fixed) continue;
            CHECK(solved.newton == systems);
            CHECK(solved.products == systems * products);
            CHECK(solved.passes <= systems * (products + 4) + 3);
            CHECK(solved.passes >= systems * (products + 1) + 1);
            CHECK(solved.converged == (solved.residual <= solved.tolerance));
        }
        if (by.fixed && products < 10) CHECK(unsolved > 0);
        return block.positions();
    };
    auto const apart = [](auto const& one, auto const& other) {
        double squares = 0;
        for (std::size_t i = 0; i < one.size(); ++i) squares += (one[i] - other[i]).squaredNorm();
        return std::sqrt(squares / double(one.size()));
    };
    constexpr int steps = 30;
    auto const fixed = [&](int systems, int products, auto const& backend) {
        return run(backend, {.newton = systems, .linear = products, .fixed = true}, systems, products, steps);
    };
    auto const solved = run(TestedBackend{}, {.share = 1e-4}, 0, 0, steps),
               rough = fixed(1, 5, TestedBackend{}), near = fixed(2, 20, TestedBackend{});
    for (auto const& x : rough) REQUIRE(x.allFinite());
    CHECK(apart(rough, solved) <= 0.02);
    CHECK(apart(near, solved) <= 1e-3);
    if constexpr (HasThreads<TestedBackend>)
        for (int const threads : {1, 3}) CHECK(fixed(1, 5, on_threads<TestedBackend>(threads)) == rough);
}

TEST_CASE("a fixed number of iterations is refused where it is no bound, and takes no step without a state")
{
    auto const block = [](Implicit const& by) {
        ImplicitSolver<Mls> of(lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)},
                               {Mls{}, by});
        of.add(box_of_points<2>({0, 0}, {0.5, 0.5}, 0.1), 0.1 * 0.1 / 4);
        return of;
    };
    CHECK(refused([&] { block({.fixed = true}); }).remedy().find(".newton = 1") != std::string::npos);
    refused([&] { block({.newton = 1, .linear = 10, .error = 1e-3, .fixed = true}); });
    auto hasty = block({.newton = 1, .linear = 10, .fixed = true});
    CHECK(refused([&] { hasty.settle(Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()}); })
              .remedy()
              .find("restore its snapshot") != std::string::npos);
    // at rest without a load nothing is left to solve
    hasty.step(0.01);
    CHECK(hasty.solved().products == 0);
    CHECK(hasty.solved().converged);
    // two halves are driven through each other: in one direction by what they hold, so no share of it will do
    auto const before = hasty.positions();
    Obstacle<HalfSpace> const left{.shape = {{1, 0, 0}},
                                   .contact = Contact::sticky(),
                                   .motion = {.position = {0.22, 0, 0}, .velocity = {100, 0, 0}}},
        right{.shape = {{-1, 0, 0}},
              .contact = Contact::sticky(),
              .motion = {.position = {0.28, 0, 0}, .velocity = {-100, 0, 0}}};
    CHECK_THROWS_AS(hasty.step(0.1, left, right), StepError);
    CHECK(hasty.positions() == before);
}

// An explicit scene holds nothing of it.
static_assert(std::is_same_v<SteppedBy<Mls, SymplecticEuler>, Mls>);
static_assert(values_of_solve<Mls, QuadraticBSpline, 3> == 0);
static_assert(values_of_solve<SteppedBy<Mls, Implicit>, QuadraticBSpline, 3> == 35);
static_assert(values_of_solve<SteppedBy<Mls, Implicit>, QuadraticBSpline, 2> == 23);
static_assert(values_of_solve<SteppedBy<Flip, SymplecticEuler>, QuadraticBSpline, 3> == 0);
static_assert(values_of_solve<SteppedBy<Flip, ImplicitMidpoint>, QuadraticBSpline, 3> == 35);
static_assert(std::is_same_v<SolveMemoryFor<TestedBackend, void, Mls>, NoSolveMemory>);
static_assert(std::is_empty_v<NoSolveMemory>);
