// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

constexpr double h = 0.05;

/// The ways to lie on a floor: the floor's height over a node, and what it is.
struct Floor
{
    double height; ///< [m]
    Obstacle<Shell<HalfSpace>> shell() const
    {
        return {.shape = {HalfSpace{}, 0.1 * h}, .motion = {.position = {0, height, 0}}};
    }
    Obstacle<HalfSpace> solid() const { return {.motion = {.position = {0, height, 0}}}; }
};

FixedCorotated<Plane> jelly()
{
    FixedCorotated<Plane> model;
    model.elasticity = lame(1e5, 0.3);
    return model;
}

using JellySolver = Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>::Solver;

/// A block of jelly above a height [m].
JellySolver block(double above, double velocity = 0)
{
    JellySolver solver(lattice(h), jelly());
    auto points = box_of_points<2>({0, 0}, {8 * h, 6 * h}, h);
    for (auto& x : points) x.y() += above;
    solver.add(points, h * h / 4, {0, velocity});
    return solver;
}

double lowest(JellySolver const& solver)
{
    double y = 1e9;
    for (auto const& x : solver.positions()) y = std::min(y, x.y());
    return y;
}

} // namespace

// The four heights are all the ways in which a floor lies between nodes.
TEST_CASE("a block rests on a shell as on a solid: within a cell and a half of it, with its whole weight")
{
    for (double height : {0.0, 0.25 * h, 0.5 * h, 0.75 * h}) {
        CAPTURE(height / h);
        auto solver = block(height + 0.5 * h);
        solver.advance(1, Gravity{}, Floor{height}.shell(), Damping{10});
        auto const report = solver.advance(0.2, Gravity{}, Floor{height}.shell(), Damping{10});
        double const weight = Totals(solver).mass * 9.81;
        CHECK(-report.reactions[0].impulse.y() / 0.2 == Approx(weight).epsilon(0.005));
        CHECK(lowest(solver) > height);
        CHECK(lowest(solver) < height + 1.5 * h);
    }
}

TEST_CASE("a block bounces off a shell as fast as off a solid")
{
    for (double height : {0.0, 0.25 * h, 0.5 * h, 0.75 * h}) {
        auto const leaving = [&](auto const& obstacle) {
            auto solver = block(height + 2 * h, -1);
            double fastest = 0;
            for (int i = 0; i < 60; ++i) {
                solver.advance(0.01, obstacle);
                fastest = std::max(fastest, Totals(solver).momentum.y() / Totals(solver).mass);
            }
            return fastest;
        };
        CAPTURE(height / h);
        CHECK(leaving(Floor{height}.shell()) == Approx(leaving(Floor{height}.solid())).epsilon(0.01));
    }
}

TEST_CASE("a block that slides on a shell is held back by Coulomb's friction")
{
    double const angle = M_PI / 6, g = 9.81;
    Eigen::Vector3d const pull(g * std::sin(angle), -g * std::cos(angle), 0);
    for (double mu : {0.0, 0.3}) {
        Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>::Solver solver(lattice(h));
        auto points = box_of_points<2>({0, 0}, {8 * h, 4 * h}, h);
        for (auto& x : points) x.y() += 0.5 * h;
        solver.add(points, h * h / 4);
        auto floor = Floor{0}.shell();
        floor.contact = Contact::coulomb(mu);
        for (int i = 1; i <= 10; ++i) solver.advance(0.02, Gravity{pull * (i / 10.0)}, floor);
        solver.advance(0.3, Gravity{pull}, floor);
        auto const report = solver.advance(0.2, Gravity{pull}, floor);
        auto const impulse = report.reactions[0].impulse;
        CHECK(impulse.x() / -impulse.y() == Approx(mu).margin(1e-3));
    }
}

TEST_CASE("two blocks on both sides of a shell that moves between them stay there, and momentum is kept")
{
    auto solver = block(h, -2);
    std::size_t const above = solver.size();
    auto points = box_of_points<2>({0, 0}, {8 * h, 6 * h}, h);
    for (auto& x : points) x.y() -= 7 * h;
    solver.add(points, h * h / 4, {0, 3});
    auto const start = Totals(solver);
    auto shell = Floor{0}.shell();
    shell.motion.velocity = {0, 0.5, 0};
    shell.motion.time = 0;
    shell.contact = Contact::coulomb(0.4);
    auto const report = solver.advance(0.3, Gravity{}, shell, Damping{0});
    auto const x = solver.positions();
    double const middle = shell.motion.at(solver.time()).position.y();
    for (std::size_t i = 0; i < x.size(); ++i) CHECK((x[i].y() > middle) == (i < above));
    Totals const end(solver);
    Eigen::Vector2d const expected = start.momentum - report.reactions[0].impulse.head<2>() +
                                     Eigen::Vector2d(0, -9.81 * report.time_of_forces * start.mass);
    CHECK((end.momentum - expected).norm() <= 1e-12 * start.mass);
    CHECK(report.reactions[0].impulse.norm() > 0.1 * start.mass);
}

TEST_CASE("what a shell of six cells is laid over comes out on its own side of it, and momentum is booked")
{
    auto solver = block(-3 * h); // its middle is that of the shell
    auto const start = solver.positions();
    Totals const before(solver);
    Obstacle<Shell<HalfSpace>> const slab{.shape = {HalfSpace{}, 6 * h}};
    auto const report = solver.advance(0.05, slab);
    auto const end = solver.positions();
    for (std::size_t i = 0; i < end.size(); ++i) {
        double const side = start[i].y() > 0 ? 1 : -1;
        CHECK(end[i].y() * side >= 3 * h * (1 - 1e-9));
    }
    Eigen::Vector2d const expected = before.momentum - report.reactions[0].impulse.head<2>();
    CHECK((Totals(solver).momentum - expected).norm() <= 1e-12 * before.mass);
}

TEST_CASE("a shell is as thick as it says, and one without thickness, or thicker than its shape, is refused")
{
    Shell<Sphere> const bowl{{0.5}, 0.02};
    CHECK(bowl.surface<double, 3>(Eigen::Vector3d(0.6, 0, 0)).distance == Approx(0.09));
    auto const inside = bowl.surface<double, 3>(Eigen::Vector3d(0.4, 0, 0));
    CHECK(inside.distance == Approx(0.09));
    CHECK(inside.normal.x() == Approx(-1));
    CHECK(bowl.reach() == Approx(0.51));
    CHECK_NOTHROW(bowl.validate());
    CHECK_THROWS_AS((Shell<Sphere>{{0.5}, 0}.validate()), Error);
    CHECK_THROWS_AS((Shell<Sphere>{{0.5}, std::nan("")}.validate()), Error);
    CHECK_THROWS_AS((Shell<Sphere>{{-1}, 0.1}.validate()), Error);
    CHECK_THROWS_AS((Shell<Sphere>{{0.5}, 1e300}.validate()), Error);
    CHECK_THROWS_AS((Shell<HalfSpace>{{}, 1e300}.validate()), Error);
    CHECK_THROWS_AS((Shell<Sphere>{{1e300}, 0.1}.validate()), Error);
    CHECK_THROWS_AS((Shell<Sphere>{{0.5}, 1.1}.validate()), Error); // there is no inside left
}
