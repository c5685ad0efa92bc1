// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <cmath>
#include <limits>
#include <optional>

using namespace firn;
using namespace firn::test;

// What implicit steps and Solver::settle cannot solve, and what they must say of it.
namespace
{

using Rubber = NeoHookean<Plane>;
using RubberSolver = Solver<TestedBackend, Rubber, QuadraticBSpline, Mls, Implicit>;
using Point = Eigen::Vector2d;

constexpr double h = 0.1, volume = h * h / 4; ///< [m], [m^2]
Obstacle<HalfSpace> const ground{.contact = Contact::sticky()};

/// A block on the ground.
RubberSolver block(double young = 1e5)
{
    RubberSolver made(lattice(h), {.density = 1000, .elasticity = lame<double>(young, 0.3)});
    made.add(box_of_points<2>({0, 0}, {0.5, 0.5}, h), volume);
    return made;
}

/// All that a particle of a block is.
struct Seen
{
    explicit Seen(RubberSolver const& solver)
        : x(solver.positions()), v(solver.download<Velocity>()), H(solver.download<DisplacementGradient>()),
          time(solver.time())
    {}
    bool operator==(Seen const&) const = default;

    std::vector<Point> x, v;
    std::vector<Matrix<double, 2>> H;
    double time;
};

/// The error of a call that must leave a solver as it is.
template <class Call>
Error refused_by(RubberSolver& solver, Call const& call)
{
    Seen const before(solver);
    Error const error = refused(call);
    bool const stays = Seen(solver) == before;
    CHECK(stays);
    return error;
}

} // namespace

TEST_CASE("implicit steps and settle name the particle that is inside out, and leave it and all others")
{
    for (double const stretch : {-1.0, 0.0}) {
        auto solver = block();
        auto H = solver.download<DisplacementGradient>();
        H[37](1, 1) = stretch - 1;
        solver.upload<DisplacementGradient>(H);
        for (int i = 0; i < 3; ++i) {
            CAPTURE(stretch, i);
            auto const error = refused_by(solver, [&] {
                if (i == 0)
                    solver.step(1e-3, Gravity{}, ground);
                else if (i == 1)
                    solver.advance(1e-2, Gravity{}, ground);
                else
                    solver.settle(Gravity{}, ground);
            });
            CHECK_THAT(error.what_is_wrong(), Contains("particle 37 was turned inside out"));
            CHECK_THAT(error.where(), Contains("at (0.175 0.375) m"));
        }
    }
}

TEST_CASE("a particle whose stress is beyond all numbers is named, and in quarantine the rest is solved")
{
    auto solver = block(), without = block();
    auto H = solver.download<DisplacementGradient>();
    H[37](0, 1) = 1e200;
    solver.upload<DisplacementGradient>(H);
    for (bool const rests : {false, true}) {
        auto const error = refused_by(solver, [&] {
            if (rests)
                solver.settle(Gravity{}, ground);
            else
                solver.step(1e-3, Gravity{}, ground);
        });
        CHECK_THAT(error.what_is_wrong(), Contains("particle 37 has a state that is not finite"));
        CHECK_THAT(error.where(), Contains("at (0.175 0.375) m"));
    }
    solver.quarantine(1);
    auto const report = solver.step(1e-3, Gravity{}, ground);
    REQUIRE(report.isolated.size() == 1);
    CHECK(report.isolated[0].particle == 37);
    without.remove_if([](Point const& x) { return (x - Point(0.175, 0.375)).norm() < 1e-9; });
    without.step(1e-3, Gravity{}, ground);
    auto const x = solver.positions(), y = without.positions();
    REQUIRE(x.size() == y.size());
    for (std::size_t i = 0; i < x.size(); ++i) CHECK((x[i] - y[i]).norm() < 1e-9);
}

TEST_CASE("stiffness or density that is no number is refused, and one beyond all numbers is not solved")
{
    double const nan = std::numeric_limits<double>::quiet_NaN(),
                 inf = std::numeric_limits<double>::infinity();
    for (double const bad : {nan, inf, 0.0, -1.0}) {
        CAPTURE(bad);
        refused([&] { block(bad); });
        refused([&] { RubberSolver(lattice(h), {.elasticity = {bad, 1e5}}); });
        if (bad != 0 && bad != -1) refused([&] { RubberSolver(lattice(h), {.elasticity = {1e5, bad}}); });
        refused([&] { RubberSolver(lattice(h), {.density = bad}); });
        auto solver = block();
        refused_by(solver, [&] { solver.add(std::vector<Point>{{1, 1}}, bad); });
        refused_by(solver, [&] { solver.step(bad, Gravity{}, ground); });
    }
    // dt^2 times a node's stiffness is no number in a step of 10 s, and its solve no solution
    auto stiff = block(1e307);
    auto const error = refused_by(stiff, [&] { stiff.step(10, Gravity{}, ground); });
    CHECK_THAT(error.what_is_wrong(), Contains("implicit step did not converge"));
    CHECK_FALSE(stiff.solved().converged);
    auto sheared = block(1e307);
    auto v = sheared.download<Velocity>();
    auto const from = sheared.positions();
    for (std::size_t i = 0; i < v.size(); ++i) v[i].x() = 1e-4 * from[i].y();
    sheared.upload<Velocity>(v);
    CHECK_THAT(refused([&] { sheared.step(10, Gravity{}, ground); }).what_is_wrong(),
               Contains("implicit step did not converge"));
    stiff.step(1e-2, Gravity{}, ground);
    stiff.settle(Gravity{}, ground);
    auto const x = stiff.positions(), at_first = block().positions();
    for (std::size_t i = 0; i < x.size(); ++i) CHECK((x[i] - at_first[i]).norm() < 1e-9);
}

TEST_CASE("settle says what nothing holds, and where, and leaves the state")
{
    auto solver = block();
    solver.add(box_of_points<2>({3, 4}, {3.5, 4.5}, h), volume); // falls
    auto error = refused_by(solver, [&] { solver.settle(Gravity{}, ground); });
    CHECK_THAT(error.what_is_wrong(), Contains("free to slide or to turn"));
    CHECK((solver.solved().where - Eigen::Vector3d(3.25, 4.25, 0)).norm() < 0.7);
    CHECK_THAT(error.where(), Contains("Solver::settle, at (3"));

    auto one = block();
    one.add(std::vector<Point>{{3.02, 4.01}}, volume);
    error = refused_by(one, [&] { one.settle(Gravity{}, ground); });
    CHECK_THAT(error.what_is_wrong(), Contains("free to slide or to turn"));
    CHECK((one.solved().where - Eigen::Vector3d(3.02, 4.01, 0)).norm() < 0.3);

    // too far below to touch it
    auto free = block();
    error = refused_by(free, [&] {
        free.settle(Gravity{},
                    Obstacle<HalfSpace>{.contact = Contact::sticky(), .motion = {.position = {0, -3, 0}}});
    });
    CHECK_THAT(error.what_is_wrong(), Contains("nothing holds the scene"));
    CHECK(error.where() == "Solver::settle");

    RubberSolver empty(lattice(h));
    CHECK(empty.settle(Gravity{}, ground).reactions[0].impulse.norm() == 0);
    empty.step(0.1, Gravity{}, ground);
    CHECK(empty.time() == 0.1);
}
