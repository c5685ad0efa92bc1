// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/obstacles.hpp>

#include <algorithm>
#include <limits>
#include <random>

using namespace firn;
using namespace firn::test;

namespace
{

using InPlane = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
using InSpace = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;
double const h = 0.05;

template <class SolverType>
SolverType block()
{
    constexpr int d = SolverType::d;
    SolverType solver(lattice(h));
    using Vec = Vector<double, d>;
    Vec low = Vec::Zero();
    low[1] = 0.02;
    solver.add(box_of_points<d>(low, low + Vec::Constant(0.3), h), std::pow(h / 2, d), 0.5 * Vec::UnitX());
    return solver;
}

template <class SolverType>
double apart(SolverType const& one, SolverType const& other)
{
    auto const x = one.positions(), y = other.positions();
    double most = 0;
    for (std::size_t i = 0; i < x.size(); ++i) most = std::max(most, (x[i] - y[i]).norm());
    return most;
}

bool agree(Reaction const& one, Reaction const& other, double tolerance)
{
    return (one.impulse - other.impulse).norm() <= tolerance &&
           (one.angular_impulse - other.angular_impulse).norm() <= tolerance;
}

Obstacle<HalfSpace> const ground{.contact = Contact::coulomb(0.3)};
Obstacle<Sphere> const ball{
    .shape = {0.1},
    .contact = Contact::coulomb(0.5),
    .motion = {.position = {0.42, 0.1, 0.1}, .velocity = {-0.4, 0, 0}, .angular_velocity = {0, 0, 3}}};
Obstacle<Box> const crate{
    .shape = {{0.1, 0.2, 1}}, .contact = Contact::sticky(), .motion = {.position = {-0.09, 0.1, 0}}};

Obstacles<> all_of_them()
{
    return {{{.shape = ground.shape, .contact = ground.contact},
             {.shape = ball.shape, .contact = ball.contact, .motion = ball.motion},
             {.shape = crate.shape, .contact = crate.contact, .motion = crate.motion}}};
}

/// A shape of a program's own: all on the right of a line.
struct RightOf
{
    double x = 0;

    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& at) const
    {
        Vector<Real, d> normal = zeros<Vector<Real, d>>();
        normal[0] = Real(-1);
        return {Real(static_cast<ScalarOf<Real>>(x)) - at[0], normal};
    }
};

/// Compares obstacles that are arguments each with those that are one or two, for a while: `apart` and
/// `together` advance a solver with them.
template <class SolverType>
void compare(double tolerance, auto const& advance_apart, auto const& advance_together)
{
    auto one_by_one = block<SolverType>(), together = block<SolverType>();
    double const mass = 1000 * std::pow(0.3, SolverType::d);
    std::vector<int> received;
    for (int i = 0; i < 8; ++i) {
        auto const expected = advance_apart(one_by_one), found = advance_together(together);
        CHECK(found.substeps == expected.substeps);
        REQUIRE(found.reactions.size() == expected.reactions.size());
        received.resize(expected.reactions.size());
        for (std::size_t k = 0; k < expected.reactions.size(); ++k) {
            CHECK(agree(found.reactions[k], expected.reactions[k], tolerance * mass));
            received[k] += expected.reactions[k].impulse.norm() > 0.01 * mass;
        }
    }
    CHECK(apart(one_by_one, together) <= tolerance);
    for (int const calls : received) CHECK(calls > 0); // or nothing would have been compared
}

/// The same obstacles, of which all act on particles but the ground, and shells: one that drives through the
/// block, and a large one around it.
Obstacle<Shell<Sphere>> const bowl{.shape = {{0.24}, 0.002},
                                   .contact = Contact::coulomb(0.2),
                                   .motion = {.position = {0.15, 0.2, 0.1}, .velocity = {0.1, 0, 0}}};
Obstacle<Shell<Box>> const sheet{.shape = {{{0.001, 0.15, 0.2}}, 0.001},
                                 .motion = {.position = {0.05, 0.2, 0.1}, .velocity = {1, 0, 0}}};
template <class ShapeType>
Obstacle<ShapeType> on_particles(Obstacle<ShapeType> obstacle)
{
    obstacle.on_particles = true;
    return obstacle;
}
template <class SolverType>
void compare_on_particles(double tolerance)
{
    auto const hard_ball = on_particles(ball);
    auto const hard_crate = on_particles(crate);
    compare<SolverType>(
        tolerance,
        [&](auto& solver) {
            return solver.advance(0.02, sheet, Gravity{}, ground, hard_ball, hard_crate, bowl);
        },
        [&](auto& solver) {
            Obstacles<Shell<Box>> const sheets{{sheet}};
            Obstacles<AnyShape<>, ActsOn::particles> solids{all_of_them().list};
            for (std::size_t i = 1; i < 3; ++i) solids.list[i].on_particles = true;
            return solver.advance(0.02, sheets, Gravity{}, solids, bowl);
        });
}

} // namespace

TEST_CASE("obstacles in one argument act as if each were an argument of its own")
{
    auto const apart = [](auto& solver) { return solver.advance(0.02, Gravity{}, ground, ball, crate); };
    auto const together = [](auto& solver) { return solver.advance(0.02, Gravity{}, all_of_them()); };
    compare<InPlane>(1e-11, apart, together);
    compare<InSpace>(1e-4, apart, together);
}

TEST_CASE("slopes of a list meet the nodes that they meet by themselves, wherever they move")
{
    for (double const angle : {0.0, 0.3, 2.0}) {
        auto const slope = [&](int quarter) { // they close in on the block
            double const turned = angle + quarter * M_PI / 2;
            Eigen::Vector3d const normal(std::cos(turned), std::sin(turned), 0);
            return Obstacle<HalfSpace>{.shape = {normal},
                                       .motion = {.position = Eigen::Vector3d(0.15, 0.2, 0.1) - 0.25 * normal,
                                                  .velocity = 1.5 * normal,
                                                  .time = 0}};
        };
        auto const apart = [&](auto& solver) {
            return solver.advance(0.02, slope(0), slope(1), slope(2), slope(3));
        };
        auto const together = [&](auto& solver) {
            Obstacles<HalfSpace> slopes{{slope(0), slope(1), slope(2), slope(3)}};
            return solver.advance(0.02, slopes);
        };
        compare<InPlane>(1e-11, apart, together);
        if (angle > 0 && angle < 1) compare<InSpace>(1e-4, apart, together);
    }
}

TEST_CASE("a slope of a list holds what lies far from the origin")
{
    Eigen::Vector3d const far(30000001.35, -20000002.85,
                              0); // 6e8 cells, beyond what single precision tells apart
    for (double angle = 0.02; angle < 2 * M_PI; angle += 0.1) {
        Eigen::Vector3d const normal(std::cos(angle), std::sin(angle), 0);
        Obstacle<HalfSpace> const slope{
            .shape = {normal}, .motion = {.position = far + Eigen::Vector3d(0.15, 0.15, 0) - 0.25 * normal}};
        auto const impulse = [&](auto const& obstacle) {
            InPlane solver(lattice(h));
            solver.add(box_of_points<2>(far.head<2>(), far.head<2>() + Eigen::Vector2d::Constant(0.3), h),
                       0.25 * h * h, -normal.head<2>());
            return solver.advance(0.1, obstacle).reactions[0].impulse;
        };
        Eigen::Vector3d const expected = impulse(slope), found = impulse(Obstacles<HalfSpace>{{slope}});
        CHECK(expected.norm() > 10); // of 90 kg m/s
        CHECK((found - expected).norm() <= 1e-6 * expected.norm());
    }
}

using OnParticles = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
                                 More<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>>>;

TEMPLATE_LIST_TEST_CASE("solids and shells in one argument act on particles as if each were one of its own",
                        "", OnParticles)
{
    compare_on_particles<typename TestType::Solver>(TestType::is_float ? 2e-3 : 1e-9);
}

TEST_CASE("no particle gets into one of many obstacles that act on particles, wherever they lie and move")
{
    auto solver = block<InPlane>();
    Obstacles<AnyShape<>, ActsOn::particles> balls;
    for (int i = 0; i < 300; ++i)
        balls.list.push_back({.shape = Sphere{0.03 + 0.0001 * (i % 30)},
                              .contact = Contact::coulomb(0.1 * (i % 5)),
                              .motion = {.position = {0.45 + 0.15 * (i % 20), 0.15 * (i / 20) - 1, 0},
                                         .velocity = {-2, 0.2, 0},
                                         .time = 0},
                              .on_particles = i % 7 != 0});
    std::vector<int> touched(balls.list.size());
    double deepest = 0;
    for (int call = 0; call < 8; ++call) {
        auto const report = solver.advance(0.02, balls);
        for (std::size_t k = 0; k < balls.list.size(); ++k) {
            touched[k] += report.reactions[k].impulse.norm() > 0;
            auto const& one = balls.list[k];
            auto const centre = one.motion.at(solver.time()).position;
            if (!one.on_particles) continue;
            for (auto const& x : solver.positions())
                deepest = std::max(deepest, one.shape.as<Sphere>()->radius - (x - centre.head<2>()).norm());
        }
    }
    CHECK(deepest <= 1e-5 * h);
    CHECK(std::count_if(touched.begin(), touched.end(), [](int calls) { return calls > 0; }) > 5);
}

TEST_CASE("particles leave obstacles of a group that are laid over them, by a quarter of a cell for each")
{
    for (int const many : {1, 3}) {
        auto solver = block<InPlane>();
        Obstacles<Sphere, ActsOn::particles> balls;
        for (int i = 0; i < many; ++i)
            balls.list.push_back({.shape = {0.12},
                                  .motion = {.position = {0.15, 0.17, 0}, .velocity = {0.5, 0, 0}, .time = 0},
                                  .on_particles = true});
        double inside = 0;
        for (int i = 0; i < 20; ++i) {
            auto const before = solver.positions();
            double const start = solver.time();
            solver.step(1e-4, balls);
            auto const after = solver.positions();
            Eigen::Vector2d const centre(0.15 + 0.5 * solver.time(), 0.17);
            double furthest = 0;
            inside = 0;
            for (std::size_t k = 0; k < after.size(); ++k) {
                furthest = std::max(furthest, (after[k] - before[k]).norm());
                inside = std::max(inside, 0.12 - (after[k] - centre).norm());
            }
            CHECK(furthest <= 0.25 * many * h + 10 * (solver.time() - start));
        }
        CHECK(inside <= 1e-5 * h);
    }
}

TEST_CASE("reactions are in the order of arguments, groups and fixed obstacles mixed")
{
    Obstacles<Sphere> balls{{ball, ball}};
    balls.list[1].motion.position = {5, 5, 0}; // touches nothing
    Obstacles<AnyShape<RightOf>> const right{{{.shape = RightOf{0.33}}}};
    auto solver = block<InPlane>();
    Totals const before(solver);
    auto const report = solver.advance(0.1, balls, ground, Gravity{}, right);
    Totals const after(solver);
    REQUIRE(report.reactions.size() == 4);
    CHECK(report.reactions[0].impulse.x() > 0);
    CHECK(report.reactions[1].impulse.norm() == 0);
    CHECK(report.reactions[2].impulse.y() < 0);
    CHECK(report.reactions[3].impulse.x() > 0);
    Eigen::Vector2d given = before.mass * report.time_of_forces * Eigen::Vector2d(0, -9.81);
    for (auto const& reaction : report.reactions) given -= reaction.impulse.head<2>();
    CHECK((after.momentum - before.momentum - given).norm() <= 1e-12 * before.mass);
}

TEST_CASE("images in a wall meet the obstacles of a group as the nodes that they are images of do")
{
    for (int const side : {1, -1}) {
        auto alone = block<InPlane>(), in_group = block<InPlane>();
        ReflectingWall const wall{.axis = 0, .node = side > 0 ? 0 : 6, .side = side};
        Obstacle<Sphere> at_wall = ball;
        at_wall.motion.position = {side > 0 ? 0.02 : 0.28, 0.05, 0};
        auto const expected = alone.advance(0.05, Gravity{}, wall, at_wall, ground);
        auto const found = in_group.advance(0.05, Gravity{}, wall, Obstacles<Sphere>{{at_wall}}, ground);
        CHECK(apart(alone, in_group) <= 1e-12);
        REQUIRE(found.reactions.size() == 3);
        for (std::size_t k = 0; k < 3; ++k) {
            CHECK(expected.reactions[k].impulse.norm() > 0);
            CHECK(agree(found.reactions[k], expected.reactions[k], 1e-9));
        }
    }
}

TEST_CASE("obstacles come and go between calls, and two groups of a type do not mix")
{
    auto solver = block<InPlane>();
    Obstacles<> some, others;
    auto report = solver.advance(0.01, Gravity{}, some, others);
    CHECK(report.reactions.empty());
    some = all_of_them();
    report = solver.advance(0.05, Gravity{}, some, others);
    REQUIRE(report.reactions.size() == 3);
    others.list.push_back(some.list.back());
    some.list.erase(some.list.begin() + 1, some.list.end());
    report = solver.advance(0.02, Gravity{}, some, others);
    REQUIRE(report.reactions.size() == 2);
    CHECK(report.reactions[0].impulse.y() < 0); // the ground
    CHECK(std::abs(report.reactions[0].impulse.x()) < 1000);
    some.list.clear();
    others.list.clear();
    Totals const before(solver);
    report = solver.advance(0.02, Gravity{}, some, others); // it falls
    CHECK(report.reactions.empty());
    CHECK(Totals(solver).momentum.y() - before.momentum.y() ==
          Approx(-9.81 * report.time_of_forces * before.mass));
}

TEST_CASE("an obstacle that crosses the scene in one call is met wherever it comes")
{
    // 2 m in 0.1 s: it begins and ends far from what it hits
    Obstacle<Sphere> fast{.shape = {0.08}, .motion = {.position = {-1, 0.15, 0}, .velocity = {20, 0, 0}}};
    auto alone = block<InPlane>(), in_group = block<InPlane>();
    auto const expected = alone.advance(0.1, fast);
    auto const found = in_group.advance(0.1, Obstacles<Sphere>{{fast}});
    CHECK(expected.reactions[0].impulse.norm() > 10);
    CHECK(agree(found.reactions[0], expected.reactions[0], 1e-9 * expected.reactions[0].impulse.norm()));
}

TEST_CASE("a step that failed leaves no trace in reactions")
{
    auto solver = block<InPlane>();
    Obstacles<AnyShape<>, ActsOn::particles> all{all_of_them().list};
    for (std::size_t i = 1; i < 3; ++i) all.list[i].on_particles = true;
    solver.advance(0.05, Gravity{}, all);
    CHECK_THROWS_AS(solver.step(0.5, Gravity{}, all), StepError);
    Totals const before(solver);
    auto const report = solver.step(1e-4, Gravity{}, all);
    Eigen::Vector2d given = before.mass * report.time_of_forces * Eigen::Vector2d(0, -9.81);
    for (auto const& reaction : report.reactions) given -= reaction.impulse.head<2>();
    CHECK((Totals(solver).momentum - before.momentum - given).norm() <= 1e-12 * before.mass);
}

TEST_CASE("a step in which an obstacle receives more than its reaction holds fails, and changes nothing")
{
    auto const refuses = [](double speed, auto const& obstacle) {
        auto solver = block<InPlane>();
        auto velocities = solver.template download<Velocity>();
        for (auto& v : velocities) v = {0, -speed / 2};
        velocities[70] *= 2;
        solver.template upload<Velocity>(velocities);
        auto const before = solver.positions();
        try {
            solver.step(1e-4, Gravity{}, obstacle);
            FAIL("it was taken");
        }
        catch (StepError const& error) {
            CHECK(error.failure().cause == FailureCause::overflowed);
            CHECK(error.failure().particle == 70);
        }
        CHECK((solver.positions() == before));
        CHECK((solver.template download<Velocity>() == velocities));
        CHECK(solver.time() == 0);
        for (auto& v : velocities) v.setZero();
        solver.template upload<Velocity>(velocities);
        solver.step(1e-4, Gravity{}, obstacle);
    };
    Obstacle<Box> const all_around{.shape = {{1, 1, 1}}, .contact = Contact::sticky()};
    double const largest = std::numeric_limits<double>::max();
    refuses(largest, all_around);
    for (double const speed : {1e30, largest}) {
        refuses(speed, Obstacles<>{{{.shape = all_around.shape, .contact = all_around.contact}}});
        refuses(speed,
                Obstacles<AnyShape<>, ActsOn::particles>{
                    {{.shape = all_around.shape, .contact = all_around.contact, .on_particles = true}}});
    }
}

TEST_CASE("obstacles of a group that make no sense are refused by their number")
{
    auto solver = block<InPlane>();
    auto const before = solver.positions();
    auto const refuses = [&](auto const& change, char const* what) {
        Obstacles<> wrong = all_of_them();
        change(wrong.list[1]);
        Error const error = refused([&] { solver.advance(0.01, Gravity{}, wrong); });
        CHECK(error.where().find("number 1 of Obstacles") != std::string::npos);
        CHECK(error.what_is_wrong().find(what) != std::string::npos);
    };
    refuses([](auto& one) { one.shape = Sphere{-1}; }, "radius");
    refuses([](auto& one) { one.on_particles = true; }, "its list does not");
    refuses([](auto& one) { one.motion.velocity.z() = 1; }, "plane");
    refuses([](auto& one) { one.motion.position.x() = std::numeric_limits<double>::infinity(); }, "motion");
    CHECK((solver.positions() == before));
}

TEST_CASE("obstacles of a group for whose depths there is no room push once, and then wait")
{
    SparedDepths<double, 2, true> spared;
    spared.set(1, 5);
    for (int i = 0; i < 10; ++i) spared.set(2 + i, 0); // not deep: these need no room
    for (int i = 0; i < 20; ++i) spared.set(20 + i, 1 + i);
    CHECK(spared.of(0, 9, 0.25) == 0);
    CHECK(spared.of(1, 9, 0.25) == 5);
    CHECK(spared.of(20, 9, 0.25) == 1);
    CHECK(spared.of(35, 9, 0.25) == 16);
    CHECK(spared.of(36, 9, 0.25) == 9);
    CHECK(spared.of(36, 0.2, 0.25) == 0);
    spared = {};
    CHECK(spared.of(1, 9, 0.25) == 0);
    CHECK(spared.of(20, 9, 0.25) == 0);
}

TEST_CASE("no list has obstacles that nothing is to meet")
{
    std::vector<SweptBox<2>> boxes(3, SweptBox<2>::nowhere());
    boxes[1].is_bounded = false;
    BroadPhase<2> const sorted(boxes);
    CHECK(sorted.everywhere == 1);
    REQUIRE(sorted.lists.size() == 1);
    CHECK(sorted.lists[0].number == 1);
}

TEST_CASE("a cell's list has all obstacles whose boxes it lies in, by rising number")
{
    std::mt19937 random(1);
    auto const below = [&](int n) { return static_cast<int>(random() % static_cast<unsigned>(n)); };
    for (int const reach : {3, 60, 100000}) { // cubes of several sizes
        std::vector<SweptBox<3>> boxes(200);
        for (std::size_t i = 0; i < boxes.size(); ++i) {
            boxes[i].is_bounded = i % 17 != 0;
            for (std::size_t a = 0; a < 3; ++a) {
                boxes[i].low[a] = below(200) - 100;
                boxes[i].high[a] = boxes[i].low[a] + below(reach);
            }
        }
        int const before = below(3);
        BroadPhase<3> const sorted(boxes, before);
        NearObstacles<3> const near{sorted.table.data(), static_cast<std::uint32_t>(sorted.table.size() - 1),
                                    sorted.lists.data(), sorted.everywhere,
                                    sorted.shift,        before};
        for (int k = 0; k < 2000; ++k) {
            Coordinates<3> const cell(below(300) - 150, below(300) - 150, below(300) - 150);
            std::vector<std::uint32_t> listed;
            near.for_each(cell, [&](std::uint32_t i, float) { listed.push_back(i); });
            if (!std::is_sorted(listed.begin(), listed.end())) FAIL("not by rising number");
            for (std::uint32_t i = 0; i < boxes.size(); ++i) {
                bool inside = true;
                for (std::size_t a = 0; a < 3; ++a)
                    inside = inside && boxes[i].low[a] <= cell[int(a)] && cell[int(a)] <= boxes[i].high[a];
                if ((inside || !boxes[i].is_bounded) && !std::binary_search(listed.begin(), listed.end(), i))
                    FAIL("obstacle " << i << " is missing");
            }
        }
    }
}

TEST_CASE("sums of reactions do not depend on the order, and are exact to rounding")
{
    std::mt19937 random(1);
    std::normal_distribution<double> normal;
    std::vector<Reaction> parts(10000);
    for (auto& part : parts) {
        double const scale = std::exp(8 * normal(random)); // from 1e-12 to 1e12
        for (int a = 0; a < 3; ++a) {
            part.impulse[a] = scale * normal(random);
            part.angular_impulse[a] = 1e-9 * scale * normal(random);
        }
    }
    auto const sum = [&](std::uint32_t slots) {
        std::vector<std::int64_t> memory(ReactionSums{nullptr, 2, slots}.size());
        ReactionSums const sums{memory.data(), 2, slots};
        for (std::uint32_t i = 0; i < parts.size(); ++i) sums.add(1, i, parts[i]);
        CHECK(sums.of(0).impulse.norm() == 0);
        return sums.of(1);
    };
    Reaction const forwards = sum(1);
    std::reverse(parts.begin(), parts.end());
    Reaction const backwards = sum(4);
    CHECK((forwards.impulse == backwards.impulse));
    CHECK((forwards.angular_impulse == backwards.angular_impulse));
    // the smallest first, so that little is rounded
    std::sort(parts.begin(), parts.end(), [](Reaction const& one, Reaction const& other) {
        return one.impulse.squaredNorm() < other.impulse.squaredNorm();
    });
    Eigen::Vector3d expected(0, 0, 0);
    for (auto const& part : parts) expected += part.impulse;
    CHECK((forwards.impulse - expected).norm() <= 1e-13 * expected.norm());
}

TEST_CASE("a number that is too large for sums of reactions is told of its step alone")
{
    std::uint32_t part = 1;
    std::vector<std::int64_t> memory(2 * ReactionSums{nullptr, 2, 4}.size());
    ReactionSums const sums{memory.data(), 2, 4, &part};
    sums.add(1, 3, {{1, 0, 0}, {0, 0, 0}});
    CHECK(!sums.overflow(1));
    using Double = std::numeric_limits<double>;
    for (double const number : {0x1p60, -Double::infinity(), Double::quiet_NaN()})
        for (bool const angular : {false, true}) {
            Reaction too_large;
            (angular ? too_large.angular_impulse : too_large.impulse).y() = number;
            sums.add(1, 3, too_large);
            CHECK(sums.overflow(1));
            CHECK(!sums.overflow(0));
            CHECK((sums.of(1, 1).impulse == Eigen::Vector3d(1, 0, 0)));
            sums.clear(sums.sums(), 1);
            CHECK(!sums.overflow(1));
        }
}
