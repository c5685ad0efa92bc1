// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/assign.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/held_marked.hpp>
#include <firn/effects/marked_force.hpp>
#include <firn/settle.hpp>
#include <firn/transfer/marks.hpp>

#include <cmath>
#include <limits>

using namespace firn;
using namespace firn::test;

namespace
{

struct Left : Mark
{
    static constexpr auto name = "left";
};
struct Right : Mark
{
    static constexpr auto name = "right";
};

using Pair = Scene<Materials<NeoHookean<Plane>, NeoHookean<Plane>>, QuadraticBSpline,
                   Carrying<Mls, Marks<Left, Right>>>;
using PairScenes = Combinations<Pair, More<Scene<Bodies<NeoHookean<SolidFloat>, NeoHookean<SolidFloat>>,
                                                 CubicBSpline, Carrying<Flip, Marks<Left, Right>>>>>;

constexpr double size = 0.1; // of a cell

/// Tells which particles are marked.
struct IsLeft
{
    template <class Vec, class Particle>
    FIRN_HOST_DEVICE auto operator()(Vec const&, Particle const& particle) const
        -> decltype(particle[Left{}] > 0)
    {
        return particle[Left{}] > 0;
    }
};

/// Two blocks, one of each material, with a gap between them.
template <class Solver>
Solver pair_of_blocks(double gap)
{
    constexpr int d = Solver::d;
    Solver solver{lattice(size)};
    Vector<double, d> const edge = Vector<double, d>::Constant(4 * size);
    auto const block = box_of_points<d>(Vector<double, d>::Zero(), edge, size);
    auto other = block;
    for (auto& x : other) x[0] += edge[0] + gap;
    solver.template add<Material<0>>(block, std::pow(size / 2, d));
    solver.template add<Material<1>>(other, std::pow(size / 2, d));
    return solver;
}

} // namespace

TEMPLATE_LIST_TEST_CASE(
    "a force on a marked material gives it its mass times the acceleration, and others nothing", "",
    PairScenes)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    double const rounding = TestType::is_float ? 1e-5 : 1e-12;
    auto solver = pair_of_blocks<typename TestType::Solver>(1);
    auto const before = solver.template positions<Material<0>>();
    assign<Left, Material<0>>(solver, 1);
    MarkedForce<Left> const force{{0.5, 3, 0}};
    Vec a = Vec::Zero();
    a[0] = 0.5, a[1] = 3;
    CHECK(solver.stable_step(force) <= std::sqrt(0.5 * size / norm(force.acceleration)));
    double time = 0, way = 0; // symplectic Euler: velocity first
    for (int i = 0; i < 50; ++i) {
        auto const report = solver.step(1e-3, force);
        time += report.time_of_forces;
        way += 1e-3 * time;
    }
    auto const first = solver.template totals<Material<0>>();
    CHECK((first.momentum - first.mass * time * a).norm() <= rounding * first.mass);
    CHECK(solver.template totals<Material<1>>().momentum.norm() == 0);
    auto const x = solver.template positions<Material<0>>();
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (x[i] - before[i] - way * a).norm());
    CHECK(worst <= rounding);

    // where they touch it pushes the other one, and what both gain is its impulse
    auto touching = pair_of_blocks<typename TestType::Solver>(0);
    assign<Left, Material<0>>(touching, 1);
    MarkedForce<Left> const push{{2, 0, 0}};
    auto const report = touching.advance(0.05, push);
    CHECK(touching.totals().momentum[0] ==
          Approx(first.mass * 2 * report.time_of_forces).epsilon(10 * rounding));
    CHECK(touching.template totals<Material<1>>().momentum[0] > 0.01 * first.mass * 2 * 0.05);
}

TEST_CASE("marks of ids, of places and of shares act by mass, and each mark for itself")
{
    auto solver = pair_of_blocks<Pair::Solver>(0);
    auto const ids = solver.ids<Material<1>>();
    assign<Left, Material<1>>(solver, std::vector<std::uint32_t>{ids[7], ids[3], ids[20]}, 0.5);
    Inside<Box> const corner{{{0.21, 0.21, 1}}};
    CHECK(assign<Right, Material<0>>(solver, corner, 1) == 16);
    CHECK(assign<Left, Material<0>>(solver, corner, 0.25) == 16);
    auto const left = solver.download<Left, Material<1>>();
    for (std::size_t i = 0; i < left.size(); ++i) CHECK(left[i] == (i == 3 || i == 7 || i == 20 ? 0.5 : 0.0));
    double const one = 1000 * size * size / 4; // a particle's mass
    auto const report = solver.advance(0.01, MarkedForce<Left>{{4, 0, 0}}, MarkedForce<Right>{{0, -8, 0}});
    Eigen::Vector2d const expected = report.time_of_forces * one * Eigen::Vector2d(4 * (1.5 + 4), -8 * 16);
    CHECK((solver.totals().momentum - expected).norm() <= 1e-12 * expected.norm());
    // a snapshot has them, and new particles none
    auto restored = pair_of_blocks<Pair::Solver>(0);
    restored.restore(solver.snapshot());
    CHECK((restored.download<Left, Material<1>>() == left));
    auto const added = solver.add<Material<1>>(std::vector<Eigen::Vector2d>{{5, 5}}, one / 1000);
    CHECK(solver.download<Left, Material<1>>().back() == 0);
    assign<Left, Material<1>>(solver, std::vector{added}, 1);
    solver.step(1e-3, MarkedForce<Left>{{4, 0, 0}}, MarkedForce<Right>{{0, -8, 0}});
    CHECK(solver.download<Velocity, Material<1>>().back().x() > 3.9e-3);
}

TEMPLATE_LIST_TEST_CASE("marked particles move as they are told, to rounding, and tell what it takes", "",
                        PairScenes)
{
    constexpr int d = TestType::d;
    double const rounding = TestType::is_float ? 1e-5 : 1e-12;
    auto solver = pair_of_blocks<typename TestType::Solver>(0);
    auto const x = solver.template positions<Material<0>>();
    auto const ids = solver.template ids<Material<0>>();
    std::vector<std::uint32_t> held; // the outermost layers
    for (std::size_t i = 0; i < x.size(); ++i)
        if (x[i][0] < size) held.push_back(ids[i]);
    assign<Left, Material<0>>(solver, held, 1);
    HeldMarked<Left> const grip{.motion = {.velocity = {-0.3, 0.1, 0}, .time = 0}};
    auto const report = solver.advance(0.2, grip);
    auto const after = solver.template positions<Material<0>>();
    Vector<double, d> way = Vector<double, d>::Zero();
    way[0] = -0.06, way[1] = 0.02;
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i)
        if (x[i][0] < size) worst = std::max(worst, (after[i] - x[i] - way).norm());
    CHECK(worst <= 10 * rounding);
    auto const totals = solver.totals();
    for (int a = 0; a < d; ++a)
        CHECK(totals.momentum[a] == Approx(-report.reactions[0].impulse[a])
                                        .epsilon(1e3 * rounding)
                                        .margin(1e3 * rounding * totals.mass));
    CHECK(report.reactions[0].impulse[0] > 0);
    CHECK(solver.stable_step(grip) <= size / norm(grip.motion.velocity));
}

TEMPLATE_LIST_TEST_CASE("effects on a mark that no particle has are refused, also once the last one has gone",
                        "", PairScenes)
{
    auto solver = pair_of_blocks<typename TestType::Solver>(0);
    auto const is_refused = [&](auto const& effect) {
        auto const before = solver.positions();
        double const time = solver.time();
        auto const error = refused([&] { solver.advance(1e-3, Gravity{}, effect); });
        CHECK_THAT(error.what_is_wrong(), Contains("no particle has the mark 'left'"));
        CHECK_THAT(error.where(), EndsWith(", effect 2 of Solver::advance"));
        CHECK_THAT(error.remedy(), Contains("assign"));
        CHECK((solver.positions() == before));
        CHECK(solver.time() == time);
        return error.where();
    };
    MarkedForce<Left> const push{{1, 0, 0}};
    HeldMarked<Left> const grip{};
    CHECK_THAT(is_refused(push), StartsWith("MarkedForce"));
    CHECK_THAT(is_refused(grip), StartsWith("HeldMarked"));
    std::vector<std::uint32_t> const one{solver.template ids<Material<1>>()[5]};
    assign<Right, Material<1>>(solver, one, 1);
    is_refused(push);
    assign<Left, Material<1>>(solver, one, 0.5);
    solver.advance(1e-3, Gravity{}, push, grip);
    solver.step(1e-4, push);
    CHECK(solver.remove_if(IsLeft{}) == 1);
    is_refused(push);
    is_refused(grip);
    assign<Left, Material<0>>(solver, 1);
    solver.step(1e-4, push);
    assign<Left, Material<0>>(solver, 0);
    is_refused(grip);
}

TEST_CASE("a bar whose marked ends are pulled apart bears E times its strain, as between held regions")
{
    double const cell = 1.0 / 16, height = 0.25, modulus = 1e5, density = 1000, pulled = 7.5e-4;
    double const c = std::sqrt(modulus / density), time = 4 / c;
    NeoHookean<Plane> rubber;
    rubber.density = density;
    rubber.elasticity = lame<double>(modulus, 0);
    auto const bar = [&] {
        Pair::Solver solver(lattice(cell), {rubber, rubber});
        solver.add<Material<0>>(box_of_points<2>({0, 0}, {1, height}, cell), cell * cell / 4);
        // the edges lie in the middle between two nodes
        assign<Left, Material<0>>(
            solver, [&](auto const& x) { return x[0] < 2.5 * cell; }, 1);
        assign<Right, Material<0>>(
            solver, [&](auto const& x) { return x[0] > 1 - 2.5 * cell; }, 1);
        return solver;
    };
    Motion pull{.velocity = {pulled / time, 0, 0}, .time = 0}, stop{.position = {pulled, 0, 0}};
    auto const stress_in_the_middle = [&](Pair::Solver const& solver) {
        auto const x = solver.positions<Material<0>>();
        auto const stress = solver.download<Stress, Material<0>>();
        double sum = 0;
        int count = 0;
        for (std::size_t i = 0; i < x.size(); ++i)
            if (std::abs(x[i].x() - 0.5) < 1.0 / 6) sum += stress[i](0, 0), ++count;
        return sum / count;
    };
    for (double const beyond : {0.0, 0.5}) {
        auto solver = bar();
        HeldMarked<Left> const left{.beyond = beyond};
        HeldMarked<Right> right{.motion = pull, .beyond = beyond};
        solver.advance(time, Damping{2 * M_PI * c}, left, right);
        right.motion = stop;
        REQUIRE(settle(solver, {.rate = 2 * M_PI * c, .share = 1e-12, .longest = 20 / c}, left, right)
                    .is_at_rest);
        auto const rest = solver.advance(0.5 / c, left, right);
        double const stress = stress_in_the_middle(solver);
        auto const x = solver.positions<Material<0>>();
        double const strain = (x[22 * 8].x() - x[10 * 8].x()) / (12 * cell / 2) - 1;
        CHECK(stress == Approx(modulus * strain).epsilon(2e-3)); // strains are a thousandth
        CHECK(rest.reactions[0].impulse.x() / rest.time_of_forces == Approx(stress * height).epsilon(1e-3));
        CHECK(rest.reactions[1].impulse.x() / rest.time_of_forces == Approx(-stress * height).epsilon(1e-3));
        // between the last nodes that are held, and the grid smooths the edges
        double const length = beyond > 0 ? 0.75 : 0.75 - 2 * cell;
        CHECK(stress < modulus * pulled / length);
        CHECK(stress > modulus * pulled / (length + cell));
        if (beyond > 0) continue;
        CHECK(std::abs(x.front().x() - cell / 4) <= 1e-12);
        CHECK(std::abs(x.back().x() - (1 - cell / 4 + pulled)) <= 1e-12);
    }
    // the nodes that are half marked are those of two regions
    auto by_marks = bar(), by_regions = bar();
    HeldMarked<Left> const marked_left{.beyond = 0.5};
    HeldMarked<Right> const marked_right{.motion = pull, .beyond = 0.5};
    Held<HalfSpace> const left{.shape = {{1, 0, 0}}, .motion = {.position = {0.14, 0, 0}}};
    Held<HalfSpace> right{.shape = {{-1, 0, 0}}, .motion = pull};
    right.motion.position = {0.86, 0, 0};
    by_marks.steps(50, 1e-3, marked_left, marked_right);
    by_regions.steps(50, 1e-3, left, right);
    auto const x = by_marks.positions<Material<0>>(), y = by_regions.positions<Material<0>>();
    double worst = 0;
    for (std::size_t i = 0; i < x.size(); ++i) worst = std::max(worst, (x[i] - y[i]).norm());
    CHECK(worst <= 1e-14);
}

TEST_CASE(
    "what is marked may be held along some axes, turned, or driven at another velocity than the motion's")
{
    auto solver = pair_of_blocks<Pair::Solver>(1);
    assign<Left, Material<0>>(solver, 1);
    double const mass = solver.totals<Material<0>>().mass;
    // free to fall
    HeldMarked<Left> held{.axes = {true, false, true}};
    auto const fall = solver.advance(0.01, Gravity{{5, -9.81, 0}}, held);
    auto v = solver.download<Velocity, Material<0>>();
    CHECK(std::abs(v[20].x()) <= 1e-15);
    CHECK(v[20].y() == Approx(-9.81 * fall.time_of_forces).epsilon(1e-12));
    CHECK(fall.reactions[0].impulse.x() == Approx(5 * mass * fall.time_of_forces).epsilon(1e-12));
    // others know nothing of it
    CHECK(solver.download<Velocity, Material<1>>()[20].x() == Approx(5 * fall.time_of_forces).epsilon(1e-12));
    held = {.velocity = Eigen::Vector3d(0.5, 0.25, 0)};
    solver.advance(0.01, Gravity{{5, -9.81, 0}}, held);
    v = solver.download<Velocity, Material<0>>();
    CHECK((v[20] - Eigen::Vector2d(0.5, 0.25)).norm() <= 1e-12);
    // a turn about a point, which the affine velocities of particles have exactly
    held = {.motion = {.position = {0.5, 0, 0}, .angular_velocity = {0, 0, 2}}};
    auto const x = solver.positions<Material<0>>();
    solver.step(1e-4, Gravity{{5, -9.81, 0}}, held);
    v = solver.download<Velocity, Material<0>>();
    for (std::size_t i = 0; i < x.size(); ++i)
        CHECK((v[i] - 2 * Eigen::Vector2d(-x[i].y(), x[i].x() - 0.5)).norm() <= 1e-12);
}

TEST_CASE(
    "marks beyond 0 to 1, of no particle, and what makes no sense of them is refused, and nothing changes")
{
    auto solver = pair_of_blocks<Pair::Solver>(0);
    using Ids = std::vector<std::uint32_t>;
    double const nan = std::numeric_limits<double>::quiet_NaN();
    for (double const wrong : {-0.1, 1.1, nan}) {
        refused([&] { assign<Left, Material<0>>(solver, wrong); });
        refused([&] { assign<Left, Material<0>>(solver, Ids{3}, wrong); });
        CHECK(refused([&] {
                  assign<Left, Material<0>>(solver, Inside<Box>{{{0.06, 0.06, 1}}}, wrong);
              }).where() == "Solver::upload, value 0");
    }
    CHECK(refused([&] { assign<Left, Material<0>>(solver, Ids{3, 64}, 1); }).where() == "assign, id 1");
    refused([&] { assign<Left, Material<1>>(solver, Ids{3}, 1); });
    refused([&] { assign<Left, Material<0>>(solver, Inside<Box>{{{-1, 1, 1}}}, 1); });
    refused([&] { assign<Left, Material<0>>(solver, Inside<Sphere>{.shape = {1e-9}}, 1); });
    refused([&] { solver.step(1e-3, MarkedForce<Left>{{nan, 0, 0}}); });
    refused([&] { solver.step(1e-3, MarkedForce<Left>{{0, 0, 1}}); });
    HeldMarked<Left> const fine{.velocity = Eigen::Vector3d(1, 0, 0)};
    for (int i = 0; i < 8; ++i) {
        HeldMarked<Left> wrong = fine;
        if (i == 0) wrong.beyond = 1;
        if (i == 1) wrong.beyond = nan;
        if (i == 2) wrong.beyond = -1e-9;
        if (i == 3) wrong.velocity->x() = nan;
        if (i == 4) wrong.velocity->z() = 1;
        if (i == 5) wrong.axes = {false, false, true};
        if (i == 6) wrong.axes = {false, false, false};
        if (i == 7) wrong.motion.angular_velocity = {1, 0, 0};
        refused([&] { solver.step(1e-3, wrong); });
    }
    for (double const mark : solver.download<Left, Material<0>>()) CHECK(mark == 0);
    CHECK(solver.time() == 0);
}
