// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/snow_block.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/force.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/rigid_body.hpp>

#include <cmath>

using namespace firn;
using namespace firn::test;

namespace
{

using RubberSolver = Solver<TestedBackend, NeoHookean<Plane>, QuadraticBSpline, Apic, Implicit>;

/// What a stiff block does on a plane of 30 degrees, in steps in which a wave goes through so many cells.
struct ImplicitSlide
{
    double acceleration; ///< along the plane, from the momentum gained [m/s^2]
    double friction;     ///< tangential over normal reaction
    double normal;       ///< reaction over what the weight presses with
    double way;          ///< along the plane in the time that is measured [cells]
};

ImplicitSlide slide_implicitly(double friction, double cells_of_wave, double share = 1e-2)
{
    constexpr double angle = M_PI / 6, g = 9.81, h = 0.04, young = 1e8;
    RubberSolver block(lattice(h), {.density = 1000, .elasticity = lame<double>(young, 0.3)},
                       {Apic{}, Implicit{.share = share}});
    auto points = box_of_points<2>({0, 0}, {0.4, 0.2}, h);
    for (auto& x : points) x.y() += h / 2;
    block.add(points, h * h / 4);
    Obstacle<HalfSpace> const plane{.contact = Contact::coulomb(friction)};
    Eigen::Vector3d const pull(g * std::sin(angle), -g * std::cos(angle), 0);
    double const dt = cells_of_wave * h / std::sqrt(block.model().elasticity.p_wave_modulus() / 1000);
    int const ramp = 10, then = 10, measured = 20;
    for (int i = 1; i <= ramp; ++i) block.step(dt, Gravity{pull * (double(i) / ramp)}, plane);
    block.steps(then, dt, Gravity{pull}, plane);
    Totals const before(block);
    Eigen::Vector3d received(0, 0, 0);
    for (auto const& report : block.steps(measured, dt, Gravity{pull}, plane))
        received += report.reactions[0].impulse;
    Totals const after(block);
    double const duration = measured * dt;
    return {(after.momentum.x() - before.momentum.x()) / after.mass / duration, received.x() / -received.y(),
            -received.y() / (after.mass * -pull.y() * duration), (after.centre.x() - before.centre.x()) / h};
}

/// A scene whose steps are implicit: see Scene.
struct ImplicitSnow
{
    using Model = Snow<Plane>;
    using Transfer = SteppedBy<Flip, ImplicitMidpoint>;
    using Backend = TestedBackend;
    using Space = Plane;
    using Solver = firn::Solver<Backend, Model, QuadraticBSpline, Flip, ImplicitMidpoint>;
};

/// A soft block of 1 by 0.5 m on a floor that mirrors it, and a plate that comes from above.
template <class Transfer, class By>
struct Pressed
{
    static constexpr double h = 0.1;
    using Solver = firn::Solver<TestedBackend, NeoHookean<Plane>, QuadraticBSpline, Transfer, By>;

    explicit Pressed(typename Solver::Transfer const& steps, Eigen::Vector2d const& velocity = {0, 0})
        : block(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)}, steps)
    {
        block.add(box_of_points<2>({0, 0}, {1, 0.5}, h), h * h / 4, velocity);
    }
    static Obstacle<HalfSpace> plate(Motion const& motion, Contact const& contact)
    {
        return {.shape = {{0, -1, 0}}, .contact = contact, .motion = motion};
    }
    /// Takes a step; `lost` becomes the momentum of particles that neither gravity nor obstacles account for.
    StepReport step(double dt, Obstacle<HalfSpace> const& plate)
    {
        Totals const before(block);
        auto report = block.step(dt, gravity, floor, plate);
        Totals const after(block);
        Eigen::Vector3d given = gravity.acceleration * (report.time_of_forces * after.mass);
        for (auto const& to : report.reactions) given -= to.impulse;
        lost = (after.momentum - before.momentum - given.head<2>()).norm();
        return report;
    }

    Gravity gravity{};
    ReflectingWall floor{.axis = 1};
    double lost = 0;
    Solver block;
};

/// Halves all velocities, which no contact does.
struct HalvesVelocities
{
    void validate() const {}
    template <class Number, int d>
    struct Action
    {
        template <Lane Real>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const&, Vector<Real, d> const& v) const
        {
            return v * Real(Number(0.5));
        }
    };
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const&) const
    {
        return {};
    }
};

} // namespace

// As in colliders, whose explicit block has to be one of PIC, since friction sets it flapping; implicit steps
// damp that.
TEST_CASE("a block on an incline slides and sticks by Coulomb's law in implicit steps of any length")
{
    for (double const cells_of_wave : {5.0, 30.0})
        for (double const mu : {0.0, 0.3, 0.5}) {
            CAPTURE(cells_of_wave, mu);
            auto const block = slide_implicitly(mu, cells_of_wave);
            double const exact = 9.81 * (std::sin(M_PI / 6) - mu * std::cos(M_PI / 6));
            CHECK(std::abs(block.acceleration - exact) <= 5e-3 * exact);
            CHECK(std::abs(block.friction - mu) <= 1e-4);
            CHECK(block.normal == Approx(1).epsilon(1e-3));
        }
    auto const stuck =
        slide_implicitly(0.7, 30, 1e-3); // it rests without a solve, as exactly as is asked for
    CHECK(std::abs(stuck.way) <= 1e-4);
    CHECK(stuck.friction == Approx(std::tan(M_PI / 6)).epsilon(2e-3));
}

// In 64 steps, in which it falls by 0.6 cells each at first, by the midpoint rule: backward Euler takes a
// part of the bounce (5 %), and a floor that held on to the snow would take all of it (9 %).
TEST_CASE("a block of snow bounces off a floor in implicit steps of 0.6 cells as in its fine run")
{
    SnowBlock<ImplicitSnow> block(32, 2, {Flip{0.95}, {}});
    double const dt = 0.6 * block.side / 32 / block.speed; // [s]
    for (int third = 0; third < 4; ++third) {
        block.solver.steps(16, dt, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::slip()});
        block.observe(3 * third + 2);
    }
    CHECK(block.solver.time() == Approx(block.duration));
    CHECK(block.error() * std::sqrt(3.0) <= 0.015); // four of twelve looks
    CHECK(block.most_gained() <= 0.01);
}

// Nodes on the floor and one below are held, so the kernel lets particles at the foot sink by an eighth of
// what the next node sinks, some of a cell: half as much in half as wide cells.
TEST_CASE("a column settles on a floor that separates, or rubs, as on one that holds it")
{
    constexpr double sinks = 0.0348553; // as in implicit.cpp: the integral of stretches by the weight above
    auto const settled = [&](Contact const& contact, int cells) {
        double const h = 1.0 / cells;
        RubberSolver column(lattice(h), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
        auto const points = box_of_points<2>({0, 0}, {2 * h, 1}, h);
        column.add(points, h * h / 4);
        auto const report = column.settle(Gravity{}, ReflectingWall{.axis = 0},
                                          ReflectingWall{.axis = 0, .node = 2, .side = -1},
                                          Obstacle<HalfSpace>{.contact = contact});
        CHECK(report.solve.converged);
        CHECK(report.solve.passes <= 60);
        CHECK(report.reactions[2].impulse.y() == Approx(-9810.0 * 2 * h).epsilon(1e-3));
        auto const H = column.download<DisplacementGradient>();
        auto const x = column.positions();
        return points.back().y() - x.back().y() - H.back()(1, 1) * (1 - points.back().y());
    };
    double const held = settled(Contact::bound_slip(), 32);
    CHECK(held == Approx(sinks).epsilon(0.02));
    CHECK(settled(Contact::slip(), 32) == Approx(held).epsilon(1e-4));
    CHECK(settled(Contact::coulomb(0.5), 32) == Approx(held).epsilon(1e-4));
    CHECK(settled(Contact::slip(), 64) == Approx(sinks).epsilon(0.01));
}

// Its end rises as the part that has left the floor bends, which statics alone has the length of: the moment
// of weight and lift about where it begins is 0. Euler-Bernoulli, so shear is left out.
TEST_CASE("a beam on a floor whose end is lifted leaves the floor as far as statics has it")
{
    constexpr double length = 1.6, thickness = 0.05, young = 1e8, density = 1000, g = 9.81,
                     end = 0.1,       // [m] that is lifted, by 4 times its weight
        w = density * g * thickness,  // [N/m]
        p = 4 * w, h = thickness / 2, // [N/m], [m]
        rigidity = young * thickness * thickness * thickness / 12;
    double const a = end * (4 + std::sqrt(12.0)), // [m] that has left the floor
        pressed = w * a - p * end;                // [N] where it begins
    double const rises =
        (pressed * a * a * a / 6 - w * a * a * a * a / 24 + p * end * end * end * end / 24) / rigidity;
    auto const lifted = [&](Contact const& contact) {
        RubberSolver beam(lattice(h), {.density = density, .elasticity = lame<double>(young, 0)});
        auto const points = box_of_points<2>({0, 0}, {length, thickness}, h, 3);
        beam.add(points, h * h / 9);
        auto const report = beam.settle(Gravity{}, Obstacle<HalfSpace>{.contact = contact},
                                        Force<Box>{.shape = {{end, 1, 1}},
                                                   .acceleration = {0, 4 * g, 0},
                                                   .motion = {.position = {length, 0, 0}}});
        CHECK(report.load_steps == 1);
        CHECK(report.reactions[0].impulse.y() == Approx(-w * (length - 4 * end)).epsilon(1e-3));
        double most = 0;
        auto const x = beam.positions();
        for (std::size_t i = 0; i < x.size(); ++i) most = std::max(most, x[i].y() - points[i].y());
        return most;
    };
    CHECK(lifted(Contact::slip()) == Approx(rises).epsilon(0.03));
    CHECK(lifted(Contact::bound_slip()) <= 1e-3 * rises);
}

// Friction mu w per length balances the pull over the length that slides, and the rest of the bar does not
// move. Friction acts at its lower side, so it turns the bar, too, and that changes the pressure below it:
// the more the thicker the bar is.
TEST_CASE("a bar pulled along a rough floor slides as far as friction does not hold it")
{
    constexpr double length = 1, thickness = 0.025, young = 1e7, mu = 0.5, density = 1000, g = 9.81,
                     end = 0.1,                                 // [m] that is pulled
        h = thickness / 2, rubs = mu * density * g * thickness, // [m], [N/m]
        slides = 4 * end,                                       // [m], since the pull is 4 rubs end
        moves = rubs * (slides * slides - 4 * end * end) / 2 / (young * thickness);
    RubberSolver bar(lattice(h), {.density = density, .elasticity = lame<double>(young, 0)});
    auto const points = box_of_points<2>({0, 0}, {length, thickness}, h, 3);
    bar.add(points, h * h / 9);
    auto const report = bar.settle(Gravity{}, Obstacle<HalfSpace>{.contact = Contact::coulomb(mu)},
                                   Force<Box>{.shape = {{end, 1, 1}},
                                              .acceleration = {4 * mu * g, 0, 0},
                                              .motion = {.position = {length, 0, 0}}});
    CHECK(report.reactions[0].impulse.x() == Approx(4 * rubs * end).epsilon(1e-3));
    CHECK(report.reactions[0].impulse.y() == Approx(-density * g * thickness * length).epsilon(1e-3));
    auto const x = bar.positions();
    double of_end = 0, of_rest = 0;
    int count = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        double const way = x[i].x() - points[i].x();
        if (points[i].x() > length - h / 3) of_end += way, ++count;
        if (points[i].x() < length - slides - 2 * thickness) of_rest = std::max(of_rest, std::abs(way));
    }
    CHECK(of_end / count == Approx(moves).epsilon(0.05));
    CHECK(of_rest <= 0.02 * moves);
}

TEST_CASE(
    "a block settles on a rough incline that it does not slide down, and nothing else is said to be rest")
{
    Eigen::Vector3d const pull(4.5, -9 * std::sqrt(0.75), 0); // on 30 degrees
    auto const block = [] {
        RubberSolver made(lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
        made.add(box_of_points<2>({0, 0}, {1, 0.5}, 0.1, 3), 0.1 * 0.1 / 9);
        return made;
    };
    auto const on = [](Contact const& contact) { return Obstacle<HalfSpace>{.contact = contact}; };
    auto const rest = block().settle(Gravity{pull}, on(Contact::coulomb(0.7)));
    CHECK(rest.reactions[0].impulse.x() == Approx(500 * pull.x()).epsilon(1e-3));
    CHECK(rest.reactions[0].impulse.y() == Approx(500 * pull.y()).epsilon(1e-3));

    auto const why = [](auto&& call) { return refused(call).what_is_wrong(); };
    CHECK_THAT(why([&] { block().settle(Gravity{pull}, on(Contact::coulomb(0.5))); }),
               Contains("free to slide"));
    CHECK_THAT(why([&] { block().settle(Gravity{pull}, on(Contact::slip())); }), Contains("free to slide"));
    auto lifted = block();
    auto const before = lifted.positions();
    CHECK_THAT(why([&] {
                   lifted.settle(Gravity{{0, 9, 0}}, on(Contact::slip()));
               }),
               Contains("lifts the scene off"));
    bool const stays = lifted.positions() == before;
    CHECK(stays);
    CHECK(lifted.time() < 1e-300);
    lifted.settle(Gravity{}, on(Contact::slip()));
    CHECK(lifted.settle(Gravity{{0, -1, 0}}, on(Contact::slip())).reactions[0].impulse.y() ==
          Approx(-500).epsilon(1e-3)); // most of its weight is gone, and it is relieved
}

TEST_CASE(
    "a list of obstacles acts in implicit steps and at rest as each of them alone, and has its reactions")
{
    auto const block = [] {
        RubberSolver made(lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
        made.add(box_of_points<2>({0, 0}, {1, 0.5}, 0.1, 3), 0.1 * 0.1 / 9);
        return made;
    };
    Obstacle<AnyShape<>> const floor{.shape = HalfSpace{}, .contact = Contact::coulomb(0.5)},
        wall{
            .shape = HalfSpace{{-1, 0, 0}}, .contact = Contact::slip(), .motion = {.position = {0.95, 0, 0}}},
        ball{.shape = Sphere{0.3}, .contact = Contact::coulomb(0.2), .motion = {.position = {0.2, 0.72, 0}}};
    Obstacles<> const both{{floor, wall}}, of_ball{{ball}}, none;
    Gravity const pull{{6, -8, 0}};
    auto const same = [](std::vector<Reaction> const& one, std::vector<Reaction> const& other) {
        REQUIRE(one.size() == other.size());
        for (std::size_t i = 0; i < one.size(); ++i) {
            double const all = 500 * 10;
            CHECK((one[i].impulse - other[i].impulse).norm() <= 1e-12 * all);
            CHECK((one[i].angular_impulse - other[i].angular_impulse).norm() <= 1e-12 * all);
        }
    };
    auto alone = block(), listed = block();
    auto const of_alone = alone.settle(pull, floor, wall, ball);
    auto const of_list = listed.settle(pull, both, none, of_ball);
    auto const are_same = [&] {
        bool const are = alone.positions() == listed.positions(); // to the bit
        CHECK(are);
    };
    are_same();
    CHECK(of_alone.solve.products == of_list.solve.products);
    same(of_alone.reactions, of_list.reactions);
    CHECK(of_list.reactions[1].impulse.x() > 100);
    for (int i = 0; i < 3; ++i) {
        auto const first = alone.step(0.02, pull, floor, wall, ball);
        auto const second = listed.step(0.02, pull, both, none, of_ball);
        are_same();
        same(first.reactions, second.reactions);
    }
    auto const first = alone.advance(0.1, floor, wall);
    auto const second = listed.advance(0.1, both);
    CHECK(first.substeps == second.substeps);
    are_same();
    same(first.reactions, second.reactions);
}

// Nodes take the solution, of which the residual is left.
TEMPLATE_TEST_CASE("obstacles receive what particles lose in implicit steps, whatever speed they have", "",
                   (Pressed<Apic, Implicit>), (Pressed<Flip, ImplicitMidpoint>))
{
    typename TestType::Solver::Transfer by;
    by.integrator.share = 1e-7;
    struct Meeting
    {
        double of_plate, of_block; ///< [m/s]
    };
    for (auto const& [of_plate, of_block] : {Meeting{-0.5, 0}, Meeting{-4, 0}, Meeting{3, 7}})
        for (auto const& contact : {Contact::slip(), Contact::coulomb(0.5), Contact::sticky()}) {
            CAPTURE(of_plate, contact.friction);
            TestType pressed(by, {0.3, of_block});
            double y = 0.5, received = 0;
            for (int i = 0; i < 10; ++i) {
                double const dt = 5e-3;
                auto const plate =
                    TestType::plate({.position = {0, y, 0}, .velocity = {0, of_plate, 0}}, contact);
                auto const report = pressed.step(dt, plate);
                y += dt * of_plate;
                received = std::max(received, report.reactions[1].impulse.norm());
                CHECK(pressed.lost <= 1e-5 * report.reactions[1].impulse.norm() + 1e-6);
            }
            CHECK(received > 20); // [N s]
            double highest = 0;
            for (auto const& x : pressed.block.positions()) highest = std::max(highest, x.y());
            CHECK(highest < y + pressed.h);
        }
}

// It receives at the end of a step what the block gave meanwhile, so it bounces a little more than it should
// in long ones.
TEST_CASE("a rigid plate falls on a block in implicit steps as in explicit ones, and comes to rest on it")
{
    using Steps = Pressed<Apic, Implicit>;
    RigidBody const at_first{.mass = 200,
                             .inertia = Eigen::Matrix3d::Identity() * 1e9, // it hardly turns
                             .motion = {.position = {0.5, 0.55, 0}, .velocity = {0, -1, 0}}};
    auto const fall = [&](auto& pressed, RigidBody& body, double dt, int steps) {
        double const mass = Totals(pressed.block).mass;
        for (int i = 0; i < steps; ++i) {
            Eigen::Vector3d const before = body.momentum();
            auto const report = pressed.step(dt, pressed.plate(body.motion, Contact::slip()));
            body.advance(report.reactions[1], dt, pressed.gravity.acceleration);
            // what one of them loses the other has, to the residual of the solve
            CHECK((body.momentum() - before - report.reactions[1].impulse -
                   body.mass * dt * pressed.gravity.acceleration)
                      .norm() <= 1e-12 * body.mass);
            CHECK(pressed.lost <= 1e-2 * (9.81 * dt * mass));
        }
    };
    RigidBody body = at_first;
    Steps pressed({});
    fall(pressed, body, 2.5e-3, 40);
    CHECK(body.motion.velocity.y() > -1); // it has turned
#if !defined(__CUDACC__)                  // nvcc would compile explicit steps for this alone
    RigidBody other = at_first;
    Pressed<Apic, SymplecticEuler> explicitly({});
    fall(explicitly, other, 5e-4, 200);
    CHECK(std::abs(body.motion.velocity.y() - other.motion.velocity.y()) <= 0.05);
    CHECK(std::abs(body.motion.position.y() - other.motion.position.y()) <= 0.05 * pressed.h);
#endif
    fall(pressed, body, 0.02, 150);
    CHECK(body.motion.velocity.norm() < 0.01);
    auto const rest = pressed.block.settle(
        pressed.gravity, pressed.floor, pressed.plate({.position = body.motion.position}, Contact::slip()));
    CHECK(rest.reactions[1].impulse.y() == Approx(9.81 * body.mass).epsilon(0.03));
}

#if defined(FIRN_TESTS_ON_OPENMP)
// Neither coarse grids nor directions are kept in so short a step, and no node lies beside the wall. The
// plate does not touch: nodes of 3 by 2 blocks of 64 lie within reach of the block.
TEST_CASE("an implicit scene stores numbers of its particles and nodes beside an explicit one, and no more")
{
    auto const bytes = [](auto pressed) {
        pressed.floor.node = -50;
        pressed.block.step(1e-3, pressed.gravity, pressed.floor,
                           pressed.plate({.position = {0, 0.6, 0}}, Contact::slip()));
        return pressed.block.memory();
    };
    std::size_t const of_steps = bytes(Pressed<Apic, SymplecticEuler>({})),
                      of_solves = bytes(Pressed<Apic, Implicit>({}));
    std::size_t const numbers = (of_solves - of_steps) / sizeof(double), expected = 200 * 11 + 6 * 64 * 23;
    CHECK(numbers >= expected);
    CHECK(numbers <= expected + 16); // of a list of images that is empty
}
#endif

TEST_CASE("implicit steps refuse effects on velocities that are no contact")
{
    Solver<TestedBackend, NeoHookean<Plane>, QuadraticBSpline, Mls, Implicit> block(
        lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
    block.add(box_of_points<2>({0, 0}, {0.5, 0.5}, 0.1), 0.1 * 0.1 / 4);
    CHECK(refused([&] { block.step(1e-3, Gravity{}, HalvesVelocities{}); })
              .what_is_wrong()
              .find("touch as an obstacle does") != std::string::npos);
    CHECK(refused([&] { block.settle(Gravity{}, HalvesVelocities{}); })
              .what_is_wrong()
              .find("obstacles stand still") != std::string::npos);
}
