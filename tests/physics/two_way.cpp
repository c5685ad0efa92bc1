// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

Vector<double, 3> momentum_of_particles(auto const& solver) { return Totals(solver).momentum; }

} // namespace

TEST_CASE("a ball that snow stops: its momentum and the snow's change by what gravity and the floor gave")
{
    using Solver = Scene<Snow<Solid>, QuadraticBSpline, Mls>::Solver;
    double const h = 0.05, radius = 0.15, dt = 5e-4;
    Solver solver(lattice(h), materials::fresh_snow<Solid>());
    auto points = box_of_points<3>({-0.4, 0, -0.4}, {0.4, 0.3, 0.4}, h);
    for (auto& x : points) x.y() += 0.5 * h;
    solver.add(points, h * h * h / 8);
    RigidBody ball =
        RigidBody::ball(radius, 10, {.position = {0.03, 0.52, 0.02}, .velocity = {0.5, -3, 0}, .time = 0});
    ball.motion.angular_velocity = {0, 4, 0};
    ball.validate();

    Gravity const gravity;
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.5)};
    double const mass = Totals(solver).mass + ball.mass;
    Eigen::Vector3d const start = momentum_of_particles(solver) + ball.momentum();
    Eigen::Vector3d given = Eigen::Vector3d::Zero(); // by floor and gravity
    double const energy = 0.5 * ball.momentum().dot(ball.motion.velocity);
    double highest = energy;
    // some of the packs of particles that the ball touches are not full: empty lanes must not push it
    for (int i = 0; i < 400; ++i) {
        Obstacle<Sphere> const sphere{
            .shape = {radius}, .contact = Contact::coulomb(0.5), .motion = ball.motion, .on_particles = true};
        auto const report = solver.advance(dt, gravity, floor, sphere);
        ball.advance(report.reactions[1], dt, gravity.acceleration);
        given += ((mass - ball.mass) * report.time_of_forces + ball.mass * dt) * gravity.acceleration -
                 report.reactions[0].impulse;
        double const kinetic = 0.5 * ball.momentum().dot(ball.motion.velocity);
        highest = std::max(highest, kinetic);
        REQUIRE((momentum_of_particles(solver) + ball.momentum() - start - given).norm() <=
                1e-12 * mass * 3 * (i + 1));
    }
    CHECK(highest <= energy * 1.01 + ball.mass * 9.81 * 0.1); // a fall of 7 cm before it touches
    CHECK(std::abs(ball.motion.velocity.y()) < 0.3);          // stopped, from 3 m/s
    CHECK(ball.motion.position.y() < 0.3 + radius);           // in a hole of its own
    CHECK(ball.motion.position.y() > radius);
    CHECK(ball.motion.velocity.x() < 0.4);
}

TEST_CASE("a free body turns as its angular momentum says, and falls as gravity says")
{
    RigidBody body{.mass = 2, .inertia = Eigen::Vector3d(1, 2, 2.5).asDiagonal()};
    body.motion.angular_velocity = {0.3, 2, 0.1};
    body.motion.time = 0;
    Eigen::Vector3d const spin = body.angular_momentum();
    for (int i = 0; i < 1000; ++i) body.advance({}, 1e-3, {0, -10, 0});
    CHECK((body.angular_momentum() - spin).norm() <= 1e-12);
    CHECK((body.motion.velocity - Eigen::Vector3d(0, -10, 0)).norm() <= 1e-12);
    CHECK(*body.motion.time == Approx(1));
    CHECK(body.motion.position.y() == Approx(-5).epsilon(2e-3)); // symplectic Euler, late by half a step
    body.advance({.impulse = {4, 0, 0}, .angular_impulse = {0, 0, 1}}, 1e-3, {0, 0, 0});
    CHECK(body.motion.velocity.x() == Approx(2));
    CHECK((body.angular_momentum() - spin - Eigen::Vector3d(0, 0, 1)).norm() <= 1e-12);
}

TEST_CASE("a body without a time of its own moves as one that has one, call by call")
{
    RigidBody timed = RigidBody::ball(0.1, 3, {.velocity = {1, 2, 3}, .angular_velocity = {3, 0, 4}}),
              free = timed;
    timed.motion.time = 0.3;
    for (int i = 0; i < 50; ++i)
        for (RigidBody* const body : {&timed, &free}) body->advance({}, 1e-2, {0, -10, 0});
    CHECK(*timed.motion.time == Approx(0.8));
    CHECK(!free.motion.time.has_value());
    CHECK((timed.motion.position - free.motion.position).norm() <= 1e-14);
    CHECK((timed.motion.rotation() - free.motion.rotation()).norm() <= 1e-14);
}

TEST_CASE("bodies of any mass and size turn on")
{
    for (auto const& [radius, mass] : {std::pair{0.3, 1e105}, {0.3, 1e200}, {0.3, 1e-105}, {1e60, 1.0}}) {
        RigidBody body = RigidBody::ball(radius, mass, {.angular_velocity = {1, -2, 3}});
        body.advance({}, 0.01, {0, -10, 0});
        CHECK((body.motion.angular_velocity - Eigen::Vector3d(1, -2, 3)).norm() <= 1e-14);
    }
    for (double thin : {1e-5, 1e-12}) { // a needle turns about itself
        Eigen::Quaterniond const turned(Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()));
        Eigen::Vector3d const axis = turned * Eigen::Vector3d::UnitZ();
        RigidBody needle{.inertia = Eigen::Vector3d(1, 1, thin).asDiagonal(),
                         .motion = {.orientation = turned, .angular_velocity = axis}};
        for (int i = 0; i < 100; ++i) needle.advance({}, 0.01, {0, -10, 0});
        CHECK((needle.motion.angular_velocity - axis).norm() <= 1e-12);
    }
}

TEST_CASE("a body without mass or with an impossible inertia is refused, as is an impossible push")
{
    RigidBody body;
    CHECK_THROWS_AS(body.advance({.impulse = {std::nan(""), 0, 0}}, 1e-3, {0, 0, 0}), Error);
    CHECK_THROWS_AS(body.advance({}, -1e-3, {0, 0, 0}), Error);
    CHECK(body.motion.position.isZero());
    CHECK_NOTHROW(RigidBody{}.validate());
    CHECK_THROWS_AS((RigidBody{.mass = 0}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.mass = std::nan("")}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.inertia = -Eigen::Matrix3d::Identity()}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.inertia = Eigen::Vector3d(-1, -1, 1).asDiagonal()}.validate()), Error);
    // no body is harder to turn about one axis than about the two others together
    CHECK_THROWS_AS((RigidBody{.inertia = Eigen::Vector3d(1, 1, 100).asDiagonal()}.validate()), Error);
    Eigen::Matrix3d const turn = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).matrix();
    CHECK_THROWS_AS(
        (RigidBody{.inertia = turn * Eigen::Vector3d(3, 1, 1.9).asDiagonal() * turn.transpose()}.validate()),
        Error);
    CHECK_NOTHROW(
        RigidBody{.inertia = turn * Eigen::Vector3d(3, 1, 2).asDiagonal() * turn.transpose()}.validate());
    CHECK_NOTHROW(
        RigidBody{.inertia = turn * Eigen::Vector3d(1, 1, 1e-5).asDiagonal() * turn.transpose()}.validate());
    Eigen::Matrix3d lopsided = 1e200 * Eigen::Matrix3d::Identity();
    lopsided(0, 1) = 1e199;
    CHECK_THROWS_AS((RigidBody{.inertia = lopsided}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.motion = {.velocity = {std::nan(""), 0, 0}}}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.motion = {.position = {0, 1e16, 0}}}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.motion = {.time = -1e300}}.validate()), Error);
    CHECK_THROWS_AS((RigidBody{.motion = {.orientation = {0, 0, 1e200, 1e200}}}.validate()), Error);
}

TEST_CASE("a body that would be set off beyond all numbers is refused, and stays where it is")
{
    auto const stays = [](RigidBody body, Reaction const& received, double dt) {
        Motion const before = body.motion;
        CHECK_THROWS_AS(body.advance(received, dt, {0, 0, 0}), Error);
        CHECK(body.motion.position == before.position);
        CHECK(body.motion.velocity == before.velocity);
        CHECK(body.motion.time == before.time);
    };
    stays({.mass = 1e-310}, {.impulse = {1, 0, 0}}, 1e-3);
    stays({.motion = {.velocity = {10, 0, 0}}}, {}, 1e308);
    stays({.inertia = Eigen::Matrix3d::Identity() * 1e-100}, {.angular_impulse = {0, 1e250, 0}}, 1e-3);
}
