// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/io/checkpoint.hpp>

#include <cmath>
#include <sstream>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

double const h = 0.05, pi = 3.14159265358979323846;

using InPlane = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
using InSpace = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;

/// The distance between two points where the nearest images of x are meant.
double apart(double one, double other, double period) { return std::remainder(one - other, period); }

} // namespace

TEMPLATE_TEST_CASE("what leaves a period comes in at its other end", "[physics][periodic]", InPlane, InSpace)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    int const axis = GENERATE(0, d - 1);
    int const cells = 16;
    double const period = cells * h, dt = 5e-4;
    double const rounding = std::is_same_v<typename TestType::Number, float> ? 2e-5 : 1e-10;
    Vec low = Vec::Constant(0.1), velocity = Vec::Constant(0.3);
    velocity[axis] = -8; // several times through
    auto const points = box_of_points<d>(low, low + Vec::Constant(0.25), h);
    TestType around(lattice(h).periodic(axis, cells)), unbounded(lattice(h));
    // a ball meets the block at the end of the period: it and its image are one
    Obstacles<> ball{{{.shape = Sphere{0.065}, .contact = Contact::slip()}}};
    ball.list[0].motion.position.template head<d>() = low + Vec::Constant(0.113);
    ball.list[0].motion.position[axis] = low[axis] - 0.413; // not on a node, where normals have no direction
    ball.list[0].motion.velocity[axis] = -5;
    ball.list[0].motion.time = 0.0;
    Obstacles<> images = ball;
    for (int k = -2; k < 5; ++k) {
        if (k == 0) continue;
        images.list.push_back(ball.list[0]);
        images.list.back().motion.position[axis] -= k * period;
    }
    ball.list[0].motion.position[axis] += 7 * period;
    around.add(points, std::pow(h / 2, d), velocity);
    unbounded.add(points, std::pow(h / 2, d), velocity);
    Reaction received, with_images;
    for (int call = 0; call < 4; ++call) {
        for (auto const& report : around.steps(100, dt, ball)) received += report.reactions[0];
        for (auto const& report : unbounded.steps(100, dt, images))
            for (auto const& reaction : report.reactions) with_images += reaction;
        if (call == 1) { // to a stream and back
            std::stringstream stream;
            write_checkpoint(stream, around);
            TestType other(lattice(h).periodic(axis, cells));
            read_checkpoint(stream, other);
            around = std::move(other);
        }
    }
    auto const x = around.positions(), y = unbounded.positions();
    double most = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        REQUIRE(x[i][axis] >= 0);
        REQUIRE(x[i][axis] < period);
        for (int a = 0; a < d; ++a)
            most = std::max(most, std::abs(a == axis ? apart(x[i][a], y[i][a], period) : x[i][a] - y[i][a]));
    }
    CHECK(most < rounding);
    CHECK(std::abs(y[0][axis]) > period); // it did go around
    CHECK(with_images.impulse.norm() > 0);
    CHECK((received.impulse - with_images.impulse).norm() < 100 * rounding * with_images.impulse.norm());
    CHECK(around.occupancy().pieces == 1);
    CHECK(around.occupancy().cells_with == unbounded.occupancy().cells_with);
    CHECK(around.occupancy().per_cell == Approx(unbounded.occupancy().per_cell));
}

TEST_CASE("a shear wave in a periodic box swings in its period, and the box is one piece without a border",
          "[physics][periodic]")
{
    int const cells = 32;
    double const length = cells * h, amplitude = 1e-3;
    InPlane solver(lattice(h).periodic(0, cells).periodic(1, 16));
    auto const points = box_of_points<2>({0, 0}, {length, 16 * h}, h);
    solver.add(points, h * h / 4);
    std::vector<Eigen::Vector2d> velocities;
    for (auto const& x : points) velocities.push_back({0, amplitude * std::cos(2 * pi * x[0] / length)});
    solver.upload<Velocity>(velocities);
    auto const& model = solver.model();
    double const wave = length / std::sqrt(model.elasticity.mu / model.density);
    CHECK(solver.occupancy().pieces == 1);
    CHECK(solver.occupancy().per_cell == 4);
    CHECK(solver.totals().mass == Approx(model.density * length * 16 * h));
    auto const momentum = solver.totals().momentum;
    // the share of the first mode in the velocities: it is 0 after a quarter of a period, and -1 after a half
    auto const mode = [&] {
        auto const v = solver.download<Velocity>();
        double sum = 0;
        for (std::size_t i = 0; i < v.size(); ++i) sum += v[i][1] * std::cos(2 * pi * points[i][0] / length);
        return 2 * sum / (amplitude * double(v.size()));
    };
    int const steps = 100; // of a quarter, so that velocities are hardly half a step behind
    solver.steps(steps, wave / 4 / steps);
    CHECK(std::abs(mode()) < 0.02);
    solver.steps(steps, wave / 4 / steps);
    CHECK(mode() == Approx(-1).epsilon(0.02));
    solver.steps(2 * steps, wave / 4 / steps);
    CHECK(mode() == Approx(1).epsilon(0.02));
    CHECK((solver.totals().momentum - momentum).norm() < 1e-12 * amplitude * solver.totals().mass);
    auto const x = solver.positions();
    auto const sampled =
        solver.sample(std::vector<Eigen::Vector2d>{{0, 0.1}, {length - 1e-6, 0.1}, {0.3, 0.1}});
    for (auto const& at : sampled) CHECK(at.density == Approx(model.density).epsilon(0.01));
}

TEST_CASE("cells at the corner of two periods are neighbours", "[physics][periodic]")
{
    InPlane solver(lattice(h).periodic(0, 32).periodic(1, 16));
    solver.add(box_of_points<2>({0, 0}, {32 * h, 16 * h}, h), h * h / 4);
    solver.add(std::vector<Eigen::Vector2d>(4, {0.1 * h, 15.1 * h}), h * h / 4); // in the cell (0, 15)
    CHECK(solver.occupancy().per_cell == Approx(4 + 4.0 / (32 * 16)).epsilon(1e-9));
    CHECK(solver.occupancy().cells == 32 * 16);
}

TEST_CASE("periods that cannot be are refused", "[physics][periodic][refusal]")
{
    auto const what = [](auto const& call) { return refused(call).what_is_wrong(); };
    CHECK_THAT(what([] { lattice(h).periodic(3, 16); }), Contains("no such axis"));
    CHECK_THAT(what([] { lattice(h).periodic(0, 0); }), Contains("the period is not"));
    CHECK_THAT(what([] { InPlane{lattice(h).periodic(2, 16)}; }), Contains("two dimensions"));
    if (InPlane::MaterialTraits<>::Table::CellOrder::extent(0) > 1)
        CHECK_THAT(what([] { InPlane{lattice(h).periodic(0, 17)}; }), Contains("a multiple of"));
    Lattice made = lattice(h);
    made.periods = {-16, 0, 0};
    CHECK_THAT(what([&] { InPlane{made}; }), Contains("the period is not"));
    made = lattice(h);
    made.half_world = 3;
    CHECK_THAT(what([&] { InPlane{made}; }), Contains("half_world"));
    InPlane solver(lattice(h).periodic(0, 16));
    solver.add(box_of_points<2>({0.1, 0.1}, {0.2, 0.2}, h), h * h / 4);
    CHECK_THAT(what([&] { solver.advance(0.01, ReflectingWall{.axis = 0}); }), Contains("periodic"));
    auto const snapshot = solver.snapshot();
    InPlane other(lattice(h));
    CHECK_THAT(what([&] { other.restore(snapshot); }), Contains("a period in cells along x"));
    solver.advance(0.01, ReflectingWall{.axis = 1});
}
