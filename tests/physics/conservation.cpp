// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <firn/effects/shapes/signed_distance_grid.hpp>

#include <algorithm>
#include <cfenv>
#include <thread>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

/// Random points in a box: what a lattice would hide.
template <int d>
std::vector<Vector<double, d>> random_points(int count, double side, unsigned seed = 4)
{
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> inside(0, side);
    std::vector<Vector<double, d>> points(count);
    for (auto& x : points)
        for (int a = 0; a < d; ++a) x[a] = inside(random);
    return points;
}

/// A splash: a body of random particles thrown on a floor and a moving ball; `go(effects...)` runs the steps.
template <class Solver, class Go>
auto splash(Solver& solver, int count, Go const& go)
{
    constexpr int d = Solver::d;
    Vector<double, d> velocity = Vector<double, d>::Zero();
    velocity[1] = -4;
    solver.add(random_points<d>(count, 0.2), std::pow(0.2, d) / count, velocity);
    Obstacle<HalfSpace> const floor{.motion = {.position = {0, -0.01, 0}}};
    Obstacle<Sphere> const ball{.shape = {0.08},
                                .contact = Contact::coulomb(0.5),
                                .motion = {.position = {0.1, -0.03, 0.1},
                                           .velocity = {0.5, 0, 0},
                                           .angular_velocity = {0, 0, 3},
                                           .time = 0}};
    return go(Gravity{}, floor, ball);
}
template <class Solver>
AdvanceReport splash(Solver& solver, int steps, double dt, int count = Solver::d == 3 ? 4000 : 800)
{
    return splash(solver, count, [&](auto const&... effects) {
        AdvanceReport total;
        for (int i = 0; i < steps; ++i) total.add(solver.step(dt, effects...), StepLimit::duration);
        return total;
    });
}

} // namespace

using Cases = Combinations<
    Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>,
    More<Scene<Snow<Plane>, QuadraticBSpline, Pic>, Scene<Snow<Solid>, CubicBSpline, Flip>,
         Scene<NeoHookean<Plane>, CubicBSpline, Apic>, Scene<FixedCorotated<Solid>, QuadraticBSpline, Mls>,
         Scene<Snow<SolidFloat>, CubicBSpline, Mls>>,
    Scene<Snow<SolidFloat>, CubicBSpline, Flip>>;

TEMPLATE_LIST_TEST_CASE("mass stays, and momentum changes by the impulses of gravity and obstacles", "",
                        Cases)
{
    constexpr int d = TestType::d;
    typename TestType::Solver solver(lattice(0.025));
    double const dt = 5e-5;
    int const steps = 200;
    auto const report = splash(solver, steps, dt);
    Totals const end(solver);
    double const mass = std::pow(0.2, d) * double(solver.model().density);
    CHECK(std::abs(end.mass / mass - 1) <= (TestType::is_float ? 1e-6 : 1e-13));

    Vector<double, d> expected = Vector<double, d>::Zero();
    expected[1] = -4 * mass - 9.81 * steps * dt * mass;
    for (auto const& reaction : report.reactions) expected -= reaction.impulse.template head<d>();
    CHECK((end.momentum - expected).norm() <= (TestType::is_float ? 1e-5 : 1e-12) * 4 * mass);
    CHECK(report.reactions[0].impulse.y() < 0); // the floor is pressed down
    CHECK(report.lost == 0);
}

TEST_CASE("the tent goes wrong at a step that a spline takes: no step is safe for it at a free surface")
{
    Scene<NeoHookean<Plane>, Linear, Apic>::Solver tent(lattice(0.025));
    CHECK_THROWS_AS(splash(tent, 200, 5e-5), Error);
    Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>::Solver spline(lattice(0.025));
    CHECK_NOTHROW(splash(spline, 200, 5e-5));
}

#if defined(FIRN_TESTS_ON_OPENMP)

namespace
{

/// The fall of a splash on one thread, and on others.
void compare_threads(int count, int steps)
{
    using Solver = Scene<Snow<SolidFloat>, CubicBSpline, Flip>::Solver;
    auto const run = [&](int threads) {
        Solver solver(lattice(0.007), {}, {}, {}, OpenMP{.threads = threads});
        splash(solver, steps, 3e-5, count);
        return std::tuple{solver.positions(), solver.download<Velocity>(),
                          solver.download<DisplacementGradient>()};
    };
    auto const one = run(1);
    for (int threads : {1, 2, 3, std::max(5, static_cast<int>(std::thread::hardware_concurrency()))})
        CHECK((run(threads) == one)); // not to be printed
}

} // namespace

// Each thread has dozens of blocks of cells, and particles go from one to another.
TEST_CASE("a splash gives the same bits with any number of threads, and every time")
{
#if defined(__SANITIZE_ADDRESS__)
    compare_threads(10000, 20); // thirty times as slow
#else
    compare_threads(20000, 50);
#endif
}

TEST_CASE("so does a splash of 100 000 particles", "[.full]") { compare_threads(100000, 100); }

TEST_CASE("packs of lanes take a scene to the same place as one lane at a time")
{
    auto const end = [](auto lanes) {
        typename Scene<Snow<Solid>, QuadraticBSpline, Mls, BasicOpenMP<decltype(lanes)>>::Solver solver(
            lattice(0.025));
        splash(solver, 100, 5e-5);
        return solver.positions();
    };
    auto const singles = end(openmp::ScalarLanes{});
    auto const check = [&](auto lanes) {
        auto const packs = end(lanes);
        double worst = 0;
        for (std::size_t i = 0; i < packs.size(); ++i)
            worst = std::max(worst, (packs[i] - singles[i]).norm());
        CHECK(worst <= 1e-12);
    };
    check(openmp::NativeLanes{});
#if defined(FIRN_HAS_XSIMD) && defined(FIRN_TESTS_ALL)
    check(PacksOf<16>{});
#endif
}

TEST_CASE("particles that are few in many rows of cells get to the same place in packs as one at a time")
{
    auto const end = [](auto number, auto lanes) {
        using Number = decltype(number);
        using Model = NeoHookean<Space<2, Number>>;
        typename Scene<Model, QuadraticBSpline, Flip, BasicOpenMP<decltype(lanes)>>::Solver solver(
            lattice(0.025));
        auto const points = random_points<2>(400, 1.0); // one in every fourth cell
        solver.add(points, 1e-4);
        std::vector<Vector<Number, 2>> velocities;
        for (auto const& x : points) // they cross a cell or two
            velocities.push_back(
                {Number(10 * std::sin(60 * x[0] + 50 * x[1])), Number(8 * std::cos(70 * x[0]))});
        solver.template upload<Velocity>(velocities);
        solver.steps(50, 1e-4, Gravity{}, ReflectingWall{.axis = 0, .node = -4},
                     ReflectingWall{.axis = 1, .node = -4});
        return solver.positions();
    };
    auto const check = [&](auto number, double tolerance) {
        auto const singles = end(number, openmp::ScalarLanes{}), packs = end(number, openmp::NativeLanes{});
        double worst = 0;
        for (std::size_t i = 0; i < packs.size(); ++i)
            worst = std::max(worst, (packs[i] - singles[i]).norm());
        CHECK(worst <= tolerance);
    };
    check(1.0, 1e-13);
#if defined(FIRN_TESTS_ALL)
    check(1.0f, 1e-5);
#endif
}

TEST_CASE(
    "lanes behind the last particle of a row of cells compute nothing that a host with traps would mind")
{
    using Solver = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;
    for (int crowd : {40, 41, 45}) { // in one cell, with one particle in each of twelve others
        CAPTURE(crowd);
        std::vector<Eigen::Vector3d> points;
        for (int cell = 0; cell < 13; ++cell)
            for (int i = 0; i < (cell == 3 ? crowd : 1); ++i)
                points.emplace_back(0.03, 0.03, 0.1 * cell + 0.01 + 1e-4 * i);
        Solver solver(lattice(0.1), {}, {}, {}, OpenMP{1});
        solver.add(points, 1e-5);
        solver.upload<AffineVelocity>(std::vector<Eigen::Matrix3f>(
            points.size(), Eigen::Matrix3f::Identity())); // or L / 0 bounds steps
        for (int i = 0; i < 3; ++i) {
            // what scratch may be made of next: no numbers, and such as overflow when they are multiplied
            for (auto& used : std::vector<std::vector<float>>(64, std::vector<float>(4096, -3e38f)))
                used.back() = 1e38f;
            std::feclearexcept(FE_ALL_EXCEPT);
            solver.step(1e-4);
            CHECK(std::fetestexcept(FE_INVALID | FE_OVERFLOW) == 0);
        }
    }
}

#elif defined(__CUDACC__)

TEST_CASE("a splash of 100 000 particles gives the same bits every time, however many steps are queued")
{
    using Solver = Scene<Snow<SolidFloat>, CubicBSpline, Flip>::Solver;
    auto const run = [&](std::size_t batch) {
        Solver solver(lattice(0.007), {}, {}, {}, Cuda{.batch = batch});
        splash(solver, 100000, [&](auto const&... effects) { return solver.steps(200, 3e-5, effects...); });
        return std::tuple{solver.positions(), solver.download<Velocity>(),
                          solver.download<DisplacementGradient>()};
    };
    auto const once = run(64);
    for (std::size_t batch : {64, 5, 1}) CHECK((run(batch) == once)); // not to be printed
}

#endif

TEST_CASE("the reaction of a resting body is its weight, and its moment that of the weight")
{
    using Solver = Scene<NeoHookean<Solid>, QuadraticBSpline, Pic>::Solver;
    Solver solver(lattice(0.05));
    solver.add(box_of_points<3>({0.5, 0.025, 0}, {0.7, 0.225, 0.2}, 0.05), std::pow(0.025, 3));
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.5)};
    solver.advance(0.3, Gravity{}, floor);
    double const duration = 0.1, weight = 0.008 * 1000 * 9.81;
    auto const report = solver.advance(duration, Gravity{}, floor);
    Eigen::Vector3d const force = report.reactions[0].impulse / duration,
                          moment = report.reactions[0].angular_impulse / duration;
    CHECK(force.y() == Approx(-weight).epsilon(0.01));
    CHECK(std::abs(force.x()) <= 0.01 * weight);
    CHECK(moment.z() == Approx(-0.6 * weight).epsilon(0.01)); // r x F with r = (0.6, 0, 0.1)
    CHECK(moment.x() == Approx(0.1 * weight).epsilon(0.01));
}

TEST_CASE("what a wall receives of a body that rests on it is its weight, and its moment that of the weight")
{
    int const axis = GENERATE(0, 1, 2);
    CAPTURE(axis);
    using Solver = Scene<NeoHookean<Solid>, QuadraticBSpline, Pic>::Solver;
    Solver solver(lattice(0.05));
    Eigen::Vector3d low(0.5, 0.3, 0.1), weight = Eigen::Vector3d::Zero();
    low[axis] = 0;
    solver.add(box_of_points<3>(low, low + Eigen::Vector3d::Constant(0.2), 0.05), std::pow(0.025, 3));
    weight[axis] = -0.008 * 1000 * 9.81;
    Gravity const gravity{weight / 8};
    ReflectingWall const floor{.axis = axis};
    solver.advance(0.3, gravity, floor);
    double const duration = 0.1;
    auto const received = solver.advance(duration, gravity, floor).reactions[0];
    Eigen::Vector3d const middle = low + Eigen::Vector3d::Constant(0.1);
    CHECK((received.impulse / duration - weight).norm() <= 0.01 * weight.norm());
    CHECK((received.angular_impulse / duration - middle.cross(weight)).norm() <= 0.01 * weight.norm() * 0.5);
}

TEST_CASE("particle contact keeps particles out of an obstacle, and pushes out those inside")
{
    using Solver = Scene<Snow<Solid>, QuadraticBSpline, Mls>::Solver;
    Obstacle<Sphere> ball{.shape = {0.1},
                          .contact = Contact::slip(),
                          .motion = {.position = {0.1, -0.05, 0.1}},
                          .on_particles = true};
    Solver solver(lattice(0.025));
    solver.add(random_points<3>(3000, 0.2), 0.008 / 3000, {0, -3, 0}); // some of them inside the ball
    solver.advance(0.02, Gravity{}, ball);
    double deepest = 0;
    for (auto const& x : solver.positions())
        deepest = std::max(deepest, 0.1 - (x - ball.motion.position).norm());
    CHECK(deepest <= 0.002);
}

TEST_CASE("a ball given by signed distances on a grid acts as the ball itself, also while it moves and turns")
{
    using Solver = Scene<Snow<Solid>, QuadraticBSpline, Mls>::Solver;
    double const spacing = 0.01;
    Eigen::Vector3i const nodes = Eigen::Vector3i::Constant(25);
    Eigen::Vector3d const corner = Eigen::Vector3d::Constant(-0.12);
    std::vector<double> distances;
    for (int k = 0; k < 25; ++k)
        for (int j = 0; j < 25; ++j)
            for (int i = 0; i < 25; ++i)
                distances.push_back((corner + spacing * Eigen::Vector3d(i, j, k)).norm() - 0.08);
    Motion const motion{
        .position = {0.1, -0.06, 0.1}, .velocity = {0.2, 0, 0.1}, .angular_velocity = {0, 2, 1}, .time = 0};
    Obstacle<Sphere> const ball{.shape = {0.08}, .contact = Contact::coulomb(0.4), .motion = motion};
    SignedDistanceGrid<double, 3> const values(corner, spacing, nodes, distances);
    Obstacle<SignedDistanceGridOn<TestedBackend, double, 3>> const grid{
        .shape = values.on(TestedBackend{}), .contact = Contact::coulomb(0.4), .motion = motion};
    auto const run = [](auto const& obstacle) {
        Solver solver(lattice(0.025));
        solver.add(random_points<3>(3000, 0.2), 0.008 / 3000, {0, -3, 0});
        AdvanceReport total;
        for (int i = 0; i < 150; ++i) total.add(solver.step(1e-4, Gravity{}, obstacle), StepLimit::duration);
        return total.reactions[0];
    };
    auto const exact = run(ball), sampled = run(grid);
    CHECK(exact.impulse.norm() > 0.1);
    CHECK((sampled.impulse - exact.impulse).norm() <= 0.02 * exact.impulse.norm());
    CHECK((sampled.angular_impulse - exact.angular_impulse).norm() <= 0.02 * 0.08 * exact.impulse.norm());
#if !defined(__CUDACC__) // there it is refused at compile time
    auto const direct = run(
        Obstacle<SignedDistanceGrid<double, 3>>{.shape = values, .contact = grid.contact, .motion = motion});
    CHECK(direct.impulse == sampled.impulse);
#endif
}

TEST_CASE("a particle may be anywhere: blocks of the grid are born under it and die behind it")
{
    using Solver = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;
    Solver solver(lattice(0.05));
    std::vector<Eigen::Vector3d> points;
    for (double x : {-900.0, -3.0, 0.0, 2.5, 777.0})
        for (double y : {-50.0, 0.1, 60.0}) points.emplace_back(x, y, -x / 3);
    solver.add(points, 1e-4, {20, 0, 0});
    solver.step(5e-4);
    auto const early = solver.memory();
    for (int i = 1; i < 400; ++i) solver.step(5e-4);
    auto const x = solver.positions();
    for (std::size_t i = 0; i < points.size(); ++i)
        CHECK((x[i] - points[i] - Eigen::Vector3d(4, 0, 0)).norm() <= 2e-5 * 4);
    CHECK(solver.memory() <= 2 * early);
}

TEST_CASE("particles added while a scene runs join it")
{
    using Solver = Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>::Solver;
    Solver solver(lattice(0.05));
    auto const block = box_of_points<2>({0, 0}, {0.2, 0.2}, 0.05);
    CHECK(solver.add(block, 0.025 * 0.025, {1, 0}) == 0);
    for (int i = 0; i < 50; ++i) solver.step(1e-3);
    auto above = block;
    for (auto& x : above) x += Eigen::Vector2d(0, 0.5);
    CHECK(solver.add(above, 2 * 0.025 * 0.025, {-1, 0}) == block.size());
    for (int i = 0; i < 50; ++i) solver.step(1e-3);
    auto const x = solver.positions();
    auto const m = solver.masses();
    for (std::size_t i = 0; i < block.size(); ++i) {
        CHECK((x[i] - block[i] - Eigen::Vector2d(0.1, 0)).norm() <= 1e-12);
        CHECK((x[block.size() + i] - above[i] + Eigen::Vector2d(0.05, 0)).norm() <= 1e-12);
        CHECK(m[i] == Approx(0.625));
        CHECK(m[block.size() + i] == Approx(1.25));
    }
}

TEST_CASE("particles may be added at any time and in any place: none of them is displaced")
{
    using Solver = Scene<NeoHookean<Solid>, QuadraticBSpline, Mls>::Solver;
    NeoHookean<Solid> soft; // so that steps of a tenth of a cell are stable
    soft.elasticity = lame(10, 0.3);
    Solver solver(lattice(0.02), soft);
    std::mt19937 random(12);
    std::uniform_real_distribution<double> unit(0, 1);
    std::vector<Eigen::Vector3d> start;
    std::vector<double> added;
    for (int round = 0; round < 20; ++round) {
        std::vector<Eigen::Vector3d> more(100);
        for (auto& x : more) x = {unit(random) - 0.9 * solver.time(), unit(random), unit(random)};
        start.insert(start.end(), more.begin(), more.end());
        added.insert(added.end(), more.size(), solver.time());
        solver.add(more, 1e-6, {1, 0.5, 0});
        for (int i = 0; i < 3; ++i)
            solver.step(2e-3); // as one body without forces: stress free, one velocity
    }
    auto const x = solver.positions();
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i)
        worst = std::max(worst,
                         (x[i] - start[i] - (solver.time() - added[i]) * Eigen::Vector3d(1, 0.5, 0)).norm());
    CHECK(worst <= 1e-12);
}

TEST_CASE("a plate that is faster than any particle does not pass through a body in one step")
{
    using Solver = Scene<Snow<Plane>, QuadraticBSpline, Mls>::Solver;
    Solver solver(lattice(0.05));
    solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.05), 0.025 * 0.025);
    Obstacle<Box> const plate{.shape = {{0.06, 2, 2}},
                              .contact = Contact::sticky(),
                              .motion = {.position = {-0.5, 0.2, 0}, .velocity = {50, 0, 0}}};
    auto const report = solver.advance(0.012, plate);
    CHECK(report.usual_limit() == StepLimit::obstacle);
    CHECK(Totals(solver).momentum.x() / Totals(solver).mass > 20);
}

TEST_CASE("the plastic volume ratio of snow that flies apart stays finite")
{
    using Solver = Scene<Snow<SolidFloat>, CubicBSpline, Mls>::Solver;
    Solver solver(lattice(0.1));
    solver.add(std::vector<Eigen::Vector3d>{{0.03, 0.03, 0.03}}, 1.25e-4);
    solver.upload<AffineVelocity>({Eigen::Matrix3f::Identity() * 20});
    auto const report = solver.advance(2.5);
    CHECK(report.capped == 1);
    CHECK(std::isfinite(solver.download<PlasticVolumeRatio>()[0]));
}

TEST_CASE("a body of snow that is packed takes shorter steps: hardening raises the wave speed")
{
    using Solver = Scene<Snow<Plane>, QuadraticBSpline, Mls>::Solver;
    Solver fresh(lattice(0.05)), packed(lattice(0.05));
    for (auto* solver : {&fresh, &packed})
        solver->add(box_of_points<2>({0, 0}, {0.2, 0.2}, 0.05), 0.025 * 0.025);
    packed.upload<PlasticVolumeRatio>(std::vector<double>(packed.size(), 0.8));
    auto const slow = packed.advance(0.01), fast = fresh.advance(0.01);
    CHECK(packed.bounds().wave_speed / fresh.bounds().wave_speed ==
          Approx(std::exp(1.0)).epsilon(1e-6)); // e^(10 * 0.2 / 2)
    CHECK(slow.substeps > 2 * fast.substeps);
    CHECK(slow.usual_limit() == StepLimit::wave);
}

using OnePass =
    Combinations<Scene<NeoHookean<Solid>, QuadraticBSpline, Mls>,
                 More<Scene<Snow<Solid>, CubicBSpline, Flip>, Scene<Snow<Plane>, QuadraticBSpline, Pic>,
                      Scene<FixedCorotated<Plane>, CubicBSpline, Apic>>,
                 Scene<MooneyRivlin<Plane>, QuadraticBSpline, Asflip>>;

// A step scatters to the next grid in the pass that moves the particles, for a next step of the same length.
// After an upload particles scatter afresh.
TEMPLATE_LIST_TEST_CASE(
    "giving while moving is giving afresh, for particles that change their cells and steps "
    "that change their length too",
    "", OnePass)
{
    constexpr int d = TestType::d;
    double const h = 0.1, dt = 2e-4;
    typename TestType::Solver once(lattice(h)), afresh(lattice(h));
    auto const points = ball_of_points<d>(Vector<double, d>::Constant(0.013), 0.35, h);
    auto velocity = [&](Vector<double, d> const& x) {
        Vector<double, d> v = 40 * Vector<double, d>::Ones() - 8 * x;
        v[0] += 12 * x[1];
        return v;
    };
    std::vector<Vector<double, d>> velocities;
    for (auto const& x : points) velocities.push_back(velocity(x));
    for (auto* const solver : {&once, &afresh}) {
        solver->add(points, std::pow(h / 2, d));
        solver->template upload<Velocity>(velocities);
    }
    for (int i = 0; i < 60; ++i) {
        // now and then another length than the one that particles scattered for
        double const length = i % 7 == 3 ? 0.6 * dt : i % 7 == 5 ? 1.3 * dt : dt;
        once.step(length);
        afresh.step(length);
        afresh.template upload<Velocity>(afresh.template download<Velocity>());
    }
    auto const x = once.positions(), y = afresh.positions();
    double worst = 0, travelled = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        worst = std::max(worst, (x[i] - y[i]).norm());
        travelled = std::max(travelled, (x[i] - points[i]).norm());
    }
    CHECK(travelled > 4 * h);
    CHECK(worst < 1e-12);
    auto const v = once.template download<Velocity>(), w = afresh.template download<Velocity>();
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (v[i] - w[i]).norm());
    CHECK(worst < 1e-10);
}
