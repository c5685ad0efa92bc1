// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/assign.hpp>
#include <firn/effects/marked_force.hpp>
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

TEST_CASE("marks beyond 0 to 1, of no particle, and forces without a number are refused, and nothing changes")
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
    for (double const mark : solver.download<Left, Material<0>>()) CHECK(mark == 0);
    CHECK(solver.time() == 0);
}
