// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <array>
#include <tuple>

using namespace firn;
using namespace firn::test;

namespace
{

/// Takes one step with as many walls as there are axes, and other effects before them.
template <class Solver, class... Effects>
StepReport step_in_corner(Solver& solver, double dt, std::vector<ReflectingWall> const& walls,
                          Effects const&... effects)
{
    if constexpr (Solver::d == 3)
        return solver.step(dt, effects..., walls[0], walls[1], walls[2]);
    else
        return solver.step(dt, effects..., walls[0], walls[1]);
}

/// Whether fewer walls than axes are tried: in space they take long to compile.
template <int d>
constexpr bool has_fewer_walls = d == 2 || sample_of(0, 1);

/// Takes one step with all of the walls.
template <class Solver>
StepReport step_with(Solver& solver, double dt, std::vector<ReflectingWall> const& walls)
{
    if constexpr (has_fewer_walls<Solver::d>) {
        if (walls.size() == 1) return solver.step(dt, walls[0]);
        if (walls.size() == 2) return solver.step(dt, walls[0], walls[1]);
    }
    return step_in_corner(solver, dt, walls);
}

/// Random points with random velocities, within 8 cells of the node (3, -2, 5) on the walls' sides.
template <class SceneType>
struct Cloud
{
    static constexpr int d = SceneType::d;
    using Number = typename SceneType::Number;
    static constexpr double h = 0.025;
    static constexpr int nodes[3] = {3, -2, 5};
    Lattice where = lattice(h, {0.01, 0.7, -0.3});
    std::vector<Vector<double, d>> points;
    std::vector<Vector<Number, d>> velocities;

    Cloud(int count, std::array<int, 3> const& sides)
    {
        std::mt19937 random(3);
        std::uniform_real_distribution<double> unit(0, 1);
        for (int i = 0; i < count; ++i) {
            Vector<double, d> x;
            Vector<Number, d> v;
            for (int a = 0; a < d; ++a) {
                x[a] = where.origin[a] + h * (nodes[a] + sides[a] * 8 * unit(random));
                v[a] = Number(unit(random) - 0.5 - sides[a]);
            }
            points.push_back(x);
            velocities.push_back(v);
        }
    }

    /// Adds the mirror image behind a wall.
    void mirror(int axis)
    {
        std::size_t const count = points.size();
        for (std::size_t i = 0; i < count; ++i) {
            auto x = points[i];
            auto v = velocities[i];
            x[axis] = 2 * (where.origin[axis] + h * nodes[axis]) - x[axis];
            v[axis] = -v[axis];
            points.push_back(x);
            velocities.push_back(v);
        }
    }

    typename SceneType::Solver solver(double volume) const
    {
        typename SceneType::Model jelly;
        jelly.elasticity = lame<Number>(1e5, 0.3);
        typename SceneType::Solver made(where, jelly);
        made.add(points, volume);
        made.template upload<Velocity>(velocities);
        return made;
    }
};

} // namespace

using Schemes = Combinations<
    Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>,
    More<Scene<NeoHookean<Plane>, CubicBSpline, Apic>, Scene<NeoHookean<Solid>, QuadraticBSpline, Asflip>>,
    Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>, Scene<NeoHookean<SolidFloat>, CubicBSpline, Mls>>;

TEMPLATE_LIST_TEST_CASE("a body before walls moves as one with its images does, in corners too", "", Schemes)
{
    constexpr int d = TestType::d;
    int const count = d == 3 ? 1000 : 400;
    double const volume = std::pow(8 * Cloud<TestType>::h, d) / count, dt = 5e-5;
    for (std::vector<int> const& axes : std::vector<std::vector<int>>{{0}, {1}, {d - 1}, {1, 0}, {0, 1, 2}}) {
        if (int(axes.size()) > d || (int(axes.size()) < d && !has_fewer_walls<d>)) continue;
        for (int side : {1, -1}) {
            std::array<int, 3> const sides{side, -side, side};
            Cloud<TestType> cloud(count, sides);
            auto alone = cloud.solver(volume);
            std::vector<ReflectingWall> walls;
            for (int axis : axes) {
                cloud.mirror(axis);
                walls.push_back({axis, cloud.nodes[axis], sides[axis]});
            }
            auto with_images = cloud.solver(volume);
            for (int i = 0; i < 100; ++i) {
                step_with(alone, dt, walls);
                with_images.step(dt);
            }
            auto const a = alone.positions(), b = with_images.positions();
            double worst = 0, moved = 0;
            for (std::size_t i = 0; i < a.size(); ++i) {
                worst = std::max(worst, (a[i] - b[i]).norm() / cloud.h);
                moved = std::max(moved, (a[i] - cloud.points[i]).norm() / cloud.h);
            }
            CAPTURE(axes, side);
            CHECK(worst <= (TestType::is_float ? 1e-4 : 1e-10));
            CHECK(moved > 0.1);
        }
    }
}

TEST_CASE("so do bodies of two materials that share a grid, in a corner")
{
    using Solver = Scene<Materials<NeoHookean<Plane>, FixedCorotated<Plane>>, QuadraticBSpline, Mls>::Solver;
    double const h = 0.025, volume = std::pow(6 * h, 2) / 400, dt = 5e-5;
    std::mt19937 random(5);
    std::uniform_real_distribution<double> unit(0, 6 * h);
    std::array<std::vector<Vector<double, 2>>, 2> points;
    for (int i = 0; i < 400; ++i) points[std::size_t(i % 2)].emplace_back(unit(random), unit(random));
    auto const made = [&](std::vector<Vector<double, 2>> const& sides) {
        Solver solver(lattice(h));
        for (auto const& side : sides) {
            auto image = points;
            for (auto& body : image)
                for (auto& x : body) x = x.cwiseProduct(side);
            solver.add<Material<0>>(image[0], volume, -side);
            solver.add<Material<1>>(image[1], volume, -0.5 * side);
        }
        return solver;
    };
    Solver alone = made({{1, 1}}), with_images = made({{1, 1}, {-1, 1}, {1, -1}, {-1, -1}});
    for (int i = 0; i < 100; ++i) {
        alone.step(dt, ReflectingWall{.axis = 0}, ReflectingWall{.axis = 1});
        with_images.step(dt);
    }
    double worst = 0;
    auto const compare = [&](auto const& a, auto const& b) {
        for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, (a[i] - b[i]).norm() / h);
    };
    compare(alone.positions<Material<0>>(), with_images.positions<Material<0>>());
    compare(alone.positions<Material<1>>(), with_images.positions<Material<1>>());
    CHECK(worst <= 1e-10);
}

TEMPLATE_LIST_TEST_CASE("what walls, gravity and a ball give a body is what its momentum changes by", "",
                        Schemes)
{
    constexpr int d = TestType::d;
    int const count = d == 3 ? 3000 : 400;
    Cloud<TestType> const cloud(count, {1, 1, -1});
    auto solver = cloud.solver(std::pow(8 * cloud.h, d) / count);
    std::vector<ReflectingWall> walls{{0, cloud.nodes[0]}, {1, cloud.nodes[1]}, {2, cloud.nodes[2], -1}};
    walls.resize(d);
    Vector<double, 3> const corner =
        cloud.where.origin + cloud.h * Vector<double, 3>(cloud.nodes[0], cloud.nodes[1], cloud.nodes[2]);
    Obstacle<Sphere> const ball{.shape = {0.08},
                                .motion = {.position = corner + Eigen::Vector3d(0.15, 0, 0)}};
    Gravity const gravity{{5, -9, d == 3 ? 3.0 : 0.0}};
    Totals const start(solver);
    Vector<double, d> expected = start.momentum;
    Vector<double, d> received = Vector<double, d>::Zero();
    double const dt = 5e-5;
    for (int i = 0; i < 200; ++i) {
        auto const report = step_in_corner(solver, dt, walls, gravity, ball);
        expected += start.mass * dt * gravity.acceleration.template head<d>();
        for (auto const& reaction : report.reactions) expected -= reaction.impulse.template head<d>();
        for (int a = 0; a < d; ++a) received[a] += report.reactions[std::size_t(a) + 1].impulse[a];
    }
    double const scale = start.momentum.norm();
    CHECK((Totals(solver).momentum - expected).norm() <= (TestType::is_float ? 1e-5 : 1e-12) * scale);
    for (int a = 0; a < d; ++a) CHECK(std::abs(received[a]) > 0.01 * scale);
    auto const x = solver.positions();
    for (int a = 0; a < d; ++a) {
        double furthest = 0; // behind the wall
        for (auto const& at : x)
            furthest = std::max(furthest, (corner[a] - at[a]) * walls[std::size_t(a)].side / cloud.h);
        CHECK(furthest <= (TestType::Transfer::moves_with_grid ? 1e-6 : 0.1));
    }
}

TEST_CASE("walls that are none, or share nodes, are refused, and nothing has changed")
{
    using TestType = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    auto solver = Cloud<TestType>(100, {1, 1, 1}).solver(1e-4);
    auto const before = solver.positions();
    ReflectingWall const wall{.axis = 0};
    CHECK_THROWS_AS(solver.step(1e-5, ReflectingWall{.axis = -1}), Error);
    CHECK_THROWS_AS(solver.step(1e-5, ReflectingWall{.axis = 3}), Error);
    CHECK_THROWS_AS(solver.step(1e-5, ReflectingWall{.axis = 2}), Error); // the scene has no third axis
    CHECK_THROWS_AS(solver.step(1e-5, ReflectingWall{.side = 0}), Error);
    CHECK_THROWS_AS(solver.step(1e-5, ReflectingWall{.node = -2147483647 - 1}), Error);
    CHECK_THROWS_AS(solver.step(1e-5, wall, wall), Error);
    CHECK_THROWS_AS(solver.advance(1e-5, ReflectingWall{.axis = 0, .node = 1, .side = -1}, wall), Error);
    CHECK_THROWS_AS(solver.advance(1e-5, ReflectingWall{.axis = 0, .node = -2, .side = -1}, wall), Error);
    CHECK(solver.time() == 0);
    CHECK((solver.positions() == before));
    CHECK_NOTHROW(solver.step(1e-5, wall, ReflectingWall{.axis = 0, .node = 200, .side = -1}));
}

#if defined(FIRN_TESTS_ON_OPENMP)

TEST_CASE("with walls, too, results are the same bits with any number of threads")
{
    using TestType = Scene<NeoHookean<SolidFloat>, CubicBSpline, Mls>;
    Cloud<TestType> const cloud(20000, {1, 1, -1});
    auto const run = [&](int threads) {
        NeoHookean<SolidFloat> jelly;
        jelly.elasticity = lame<float>(1e5, 0.3);
        TestType::Solver solver(cloud.where, jelly, {}, {}, OpenMP{.threads = threads});
        solver.add(cloud.points, std::pow(8 * cloud.h, 3) / double(cloud.points.size()));
        solver.upload<Velocity>(cloud.velocities);
        Obstacle<Sphere> const ball{.shape = {0.08},
                                    .motion = {.position = cloud.points[0].template cast<double>()}};
        auto const report =
            solver.advance(5e-3, Gravity{}, ball, ReflectingWall{0, cloud.nodes[0]},
                           ReflectingWall{1, cloud.nodes[1]}, ReflectingWall{2, cloud.nodes[2], -1});
        std::vector<Eigen::Vector3d> received;
        for (auto const& reaction : report.reactions) received.push_back(reaction.impulse);
        return std::tuple{solver.positions(), solver.download<Velocity>(), received};
    };
    auto const one = run(1);
    for (int threads : {1, 2, 3, 5}) CHECK((run(threads) == one)); // not to be printed
}

#endif
