// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/budget.hpp>
#include <firn/effects/obstacles.hpp>

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

using SceneType = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
using Block = SceneType::Solver;

Gravity const gravity{};
Obstacle<HalfSpace> const ground{};

/// A block that falls on the ground from a tenth of its height.
Block falling_block()
{
    double const h = 0.05;
    Block solver(lattice(h));
    solver.add(box_of_points<2>({0, 0.03}, {0.3, 0.33}, h), h * h / 4);
    return solver;
}

/// What is the same, bit by bit, in scenes that took the same steps.
auto state(Block const& solver)
{
    return std::tuple{solver.positions(), solver.download<Velocity>(), solver.time()};
}

/// Stretches everything along x, at a rate that grows with time.
struct Stretch
{
    double growth; ///< [1/s^2]

    void validate() const {}

    template <class Number>
    struct Action
    {
        Number rate;

        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const& node,
                                                 Vector<Real, d> const& velocity) const
        {
            Vector<Real, d> stretched = velocity;
            stretched[0] += Real(rate) * node.position.relative_to({0, 0, 0})[0];
            return stretched;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number> over(Interval const& interval) const
    {
        return {static_cast<Number>(growth * interval.length())};
    }
};

} // namespace

TEST_CASE("calls of any length take the steps of one long call, where the last step is not cut")
{
    double const frame = 1.0 / 24;
    int const frames = 4;
    Block cut = falling_block(), whole = falling_block();
    std::uint64_t steps_of_cut = 0, steps_of_whole = 0;
    for (int i = 0; i < frames; ++i) steps_of_cut += cut.advance(frame, gravity, ground).substeps;
    double owed = 0;
    for (int i = 0; i < frames; ++i) {
        auto const report = whole.advance(frame + owed, Budget{.cut_last_step = false}, gravity, ground);
        steps_of_whole += report.substeps;
        owed = report.left;
        CHECK(report.stopped_by == StoppedBy::nothing);
        CHECK(owed >= 0);
        CHECK(owed < whole.stable_step(gravity, ground));
    }
    CHECK(whole.time() + owed == Approx(frames * frame).epsilon(1e-12));
    CHECK(double(steps_of_whole) <= 1.05 * double(steps_of_cut));

    for (int const pieces : {3, 16, 100}) { // the last ones are shorter than a step
        Block split = falling_block();
        std::uint64_t steps = 0;
        owed = 0;
        for (int i = 0; i < frames * pieces; ++i) {
            auto const report =
                split.advance(frame / pieces + owed, Budget{.cut_last_step = false}, gravity, ground);
            steps += report.substeps;
            owed = report.left;
        }
        CHECK(steps == steps_of_whole);
        CHECK((state(split) == state(whole))); // not to be printed
    }
}

TEST_CASE("a call that takes no step has a reaction of nothing for each obstacle")
{
    Obstacles<> const list{{{.shape = HalfSpace{}}, {.shape = Sphere{0.1}}}};
    for (Budget const& budget : {Budget{.steps = 0}, Budget{.cancelled = [] { return true; }}}) {
        Block solver = falling_block();
        auto const report = solver.advance(0.01, budget, gravity, ground, list);
        CHECK(report.substeps == 0);
        REQUIRE(report.reactions.size() == 3);
        for (auto const& reaction : report.reactions) CHECK(reaction.impulse.norm() == 0);
    }
}

TEST_CASE("a call takes as many steps as it may, and says what is left")
{
    Block solver = falling_block();
    double const duration = 0.02;
    double left = duration;
    std::uint64_t steps = 0;
    for (int calls = 1; left > 0; ++calls) {
        REQUIRE(calls < 1000);
        auto const report = solver.advance(left, Budget{.steps = 3}, gravity, ground);
        steps += report.substeps;
        CHECK(report.substeps <= 3);
        CHECK((report.left > 0) == (report.stopped_by == StoppedBy::steps));
        CHECK(solver.time() + report.left == Approx(duration).epsilon(1e-12));
        left = report.left;
    }
    CHECK(solver.time() == Approx(duration).epsilon(1e-12));
    auto const all = falling_block().advance(duration, gravity, ground);
    CHECK(all.left == 0);
    CHECK(all.stopped_by == StoppedBy::nothing);
    CHECK(double(steps) <= 1.1 * double(all.substeps)); // each call plans whole shares of what is left

    auto const before = state(solver);
    auto const none = solver.advance(duration, Budget{.steps = 0}, gravity, ground);
    CHECK(none.substeps == 0);
    CHECK(none.left == duration);
    CHECK(none.stopped_by == StoppedBy::steps);
    CHECK((state(solver) == before));
}

TEST_CASE("a call ends when its seconds are over, but takes one step at least")
{
    Block solver = falling_block();
    auto report = solver.advance(1, Budget{.seconds = 1e-12}, gravity, ground);
    CHECK(report.substeps == 1);
    CHECK(report.stopped_by == StoppedBy::seconds);
    CHECK(report.left == Approx(1 - solver.time()));
    report = solver.advance(1, Budget{.seconds = 0}, gravity, ground);
    CHECK(report.substeps == 0);
    CHECK(report.left == 1);
    double const time = solver.time();
    report = solver.advance(0.01, Budget{.seconds = 1000}, gravity, ground);
    CHECK(report.stopped_by == StoppedBy::nothing);
    CHECK(report.left == 0);
    CHECK(solver.time() == time + 0.01);
}

TEST_CASE("a call tells how far it is, and stops when it is cancelled")
{
    Block solver = falling_block();
    double const duration = 0.02;
    std::vector<Progress> told;
    auto const all = solver.advance(
        duration, Budget{.progress = [&](Progress const& progress) { told.push_back(progress); }}, gravity,
        ground);
    REQUIRE(!told.empty());
    for (std::size_t i = 0; i < told.size(); ++i) {
        CHECK(told[i].begin == 0);
        CHECK(told[i].end == duration);
        CHECK(told[i].steps > (i > 0 ? told[i - 1].steps : 0));
        CHECK(told[i].time > (i > 0 ? told[i - 1].time : 0));
        CHECK(told[i].seconds >= (i > 0 ? told[i - 1].seconds : 0));
    }
    CHECK(told.back().time == duration);
    CHECK(told.back().steps == all.substeps);

    bool is_enough = false;
    Budget const until_enough{.progress = [&](Progress const& progress) { is_enough = progress.steps >= 5; },
                              .cancelled = [&] { return is_enough; }};
    auto const some = solver.advance(1, until_enough, gravity, ground);
    CHECK(some.stopped_by == StoppedBy::cancel);
    CHECK(some.substeps >= 5);
    CHECK(some.left == Approx(duration + 1 - solver.time()));

    // what a callback throws leaves the scene as after its last step
    struct Enough
    {};
    double const time = solver.time();
    CHECK_THROWS_AS(
        solver.advance(1, Budget{.progress = [](Progress const&) { throw Enough(); }}, gravity, ground),
        Enough);
    CHECK(solver.until_error().substeps >= 1);
    CHECK(solver.until_error().left == Approx(time + 1 - solver.time()));
    CHECK(solver.time() > time);
    solver.advance(0.01, gravity, ground);
}

TEST_CASE("what a callback calls of the solver is refused, in every build, and the solver goes on after it")
{
    struct Enough
    {};
    Block twin = falling_block(); // whose callback throws something else
    CHECK_THROWS_AS(
        twin.advance(1, Budget{.progress = [](Progress const&) { throw Enough(); }}, gravity, ground),
        Enough);
    auto const expected = state(twin);
    auto const is_refused = [&](auto const& call, bool is_asked = false) {
        Block solver = falling_block();
        Budget budget;
        if (is_asked) // after a step, before the next one
            budget.cancelled = [&, steps = 0]() mutable {
                if (steps++ > 0) call(solver);
                return false;
            };
        else
            budget.progress = [&](Progress const&) { call(solver); };
        auto const error = refused([&] { solver.advance(1, budget, gravity, ground); });
        CHECK_THAT(error.what_is_wrong(), Contains("another call of the same object is under way"));
        CHECK_THAT(error.remedy(), Contains("Budget::progress"));
        CHECK((state(solver) == expected));
        CHECK(solver.until_error().substeps == twin.until_error().substeps);
        solver.advance(0.01, gravity, ground);
    };
    is_refused([](Block& solver) { solver.advance(0.01, gravity, ground); });
    is_refused([](Block& solver) { solver.step(1e-5); });
    is_refused([](Block& solver) { solver.add(std::vector<Eigen::Vector2d>{{1, 1}}, 1e-3); });
    is_refused([](Block& solver) { solver.remove_if(Inside<Sphere>{}); });
    is_refused([](Block& solver) { (void)solver.snapshot(); });
    is_refused([](Block& solver) { (void)solver.positions(); });
    is_refused([](Block& solver) { (void)solver.totals(); });
    is_refused([](Block& solver) { (void)solver.stable_step(); }, true);
    is_refused([](Block& solver) { solver.quarantine(3); }, true);
}

TEST_CASE("a solver that is moved in its own callback, or assigned to, stays as it is, and so does the other")
{
    Block twin = falling_block();
    twin.advance(0.02, gravity, ground);
    auto const at_begin = state(falling_block()), at_end = state(twin);
    auto const is_refused = [&](auto const& move) {
        Block solver = falling_block(), other = falling_block();
        int refusals = 0;
        Budget const budget{.progress = [&](Progress const&) {
            auto const error = refused([&] { move(solver, other); });
            CHECK_THAT(error.what_is_wrong(), Contains("to be moved, or assigned to"));
            ++refusals;
        }};
        solver.advance(0.02, budget, gravity, ground);
        CHECK(refusals > 1);
        CHECK((state(solver) == at_end));
        CHECK((state(other) == at_begin));
    };
    is_refused([](Block& solver, Block&) { Block const gone(std::move(solver)); });
    is_refused([](Block& solver, Block& other) { other = std::move(solver); });
    is_refused([](Block& solver, Block& other) { solver = std::move(other); });
    is_refused([](Block& solver, Block&) { solver = falling_block(); });
    is_refused([](Block& solver, Block& other) { std::swap(solver, other); });

    std::vector<Block> several; // which move as it grows
    for (int i = 0; i < 3; ++i) several.push_back(falling_block());
    for (auto& solver : several) solver.advance(0.02, gravity, ground);
    std::swap(several[0], several[1]);
    for (auto& solver : several) CHECK((state(solver) == at_end));
}

TEST_CASE("a call tells of steps alone, and not of attempts after which a particle is taken out")
{
    Block solver = falling_block();
    solver.quarantine(1);
    auto H = solver.download<DisplacementGradient>();
    H[3](0, 0) = -1.5; // inside out
    solver.upload<DisplacementGradient>(H);
    std::uint64_t told = 0;
    Budget const watched{.progress = [&](Progress const& progress) {
        CHECK(progress.steps == ++told);
        CHECK(progress.time > 0);
    }};
    auto const report = solver.advance(0.001, watched, gravity, ground);
    CHECK(report.isolated.size() == 1);
    CHECK(report.substeps == told);
}

TEST_CASE("the stable step is the one that a step reports")
{
    Block solver = falling_block();
    for (int i = 0; i < 5; ++i) {
        double const stable = solver.stable_step(gravity, ground);
        CHECK(stable > 0);
        CHECK(solver.step(0.3 * stable, gravity, ground).stable_dt == stable);
    }
    Obstacle<HalfSpace> rising = ground;
    rising.motion.velocity.y() = 1e4; // half a cell per step at most
    CHECK(solver.stable_step(gravity, rising) == Approx(0.5 * 0.05 / 1e4));
    Gravity const none{{std::numeric_limits<double>::quiet_NaN(), 0, 0}};
    refused([&] { (void)solver.stable_step(none, ground); });
    CHECK_FALSE(is_finite(Block(lattice(0.1)).stable_step())); // nothing bounds it
}

TEST_CASE("a budget that is none is refused, and nothing changes")
{
    Block solver = falling_block();
    solver.advance(0.01, gravity, ground);
    auto const before = state(solver);
    double const nan = std::numeric_limits<double>::quiet_NaN();
    for (Budget const& wrong : {Budget{.seconds = -1}, Budget{.seconds = nan}, Budget{.respond_within = 0},
                                Budget{.respond_within = -1}, Budget{.respond_within = nan}})
        refused([&] { solver.advance(0.01, wrong, gravity, ground); });
    refused([&] { solver.advance(-0.01, Budget{}, gravity, ground); });
    CHECK((state(solver) == before));
}

TEST_CASE("a step that fails is repeated, also if it was planned by a call of equal steps")
{
    Block solver = falling_block();
    double const dt = 0.9 * solver.stable_step();
    solver.steps(3, dt);
    // dt |L| is 0.8, which is rejected; of halves and quarters it is less
    auto const report = solver.advance(dt, Stretch{0.8 / (dt * dt)});
    CHECK(report.rejected >= 1);
    CHECK(report.substeps >= 2);
}

TEST_CASE("no call ends between a step that failed and its repetition")
{
    Block solver = falling_block();
    double const dt = 0.9 * solver.stable_step();
    solver.steps(3, dt);
    Stretch const stretch{0.8 / (dt * dt)};
    auto const snapshot = solver.snapshot();
    solver.restore(snapshot);
    auto const expected = solver.step(0.25 * dt, stretch); // what the second repetition is
    auto const after = solver.totals();
    solver.restore(snapshot);
    double const time = solver.time();

    auto report = solver.advance(dt, Budget{.seconds = 1e-12}, stretch);
    CHECK(report.rejected >= 1);
    CHECK(report.substeps == 1);
    CHECK(report.stopped_by == StoppedBy::seconds);
    CHECK(solver.time() > time);
    CHECK(report.smallest_dt <= 0.5 * dt);
    if (report.smallest_dt == Approx(expected.dt))
        CHECK(solver.totals().kinetic_energy == Approx(after.kinetic_energy).epsilon(1e-6));
    CHECK(solver.totals().kinetic_energy <= 2 * after.kinetic_energy); // or it were the failed step's

    // a callback that throws finds whole steps, and the solver goes on
    struct Enough
    {};
    solver.restore(snapshot);
    CHECK_THROWS_AS(solver.advance(dt,
                                   Budget{.progress =
                                              [](Progress const& progress) {
                                                  CHECK(progress.steps == 1);
                                                  throw Enough();
                                              }},
                                   stretch),
                    Enough);
    CHECK(solver.until_error().rejected >= 1);
    solver.advance(0.1 * dt);
}
