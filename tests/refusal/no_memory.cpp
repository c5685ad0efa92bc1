// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/failing_memory.hpp"
#include "support/policies.hpp"

#include <functional>
#include <optional>

using namespace firn;
using namespace firn::test;

namespace
{
using Jelly = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;

/// A block that has moved, with a box far from it that is yet to be added.
struct Block
{
    Jelly solver;
    std::vector<Eigen::Vector2d> more = box_of_points<2>({3, 3}, {3.5, 3.5}, 0.1);

    explicit Block(StepControl const& control = {}) : solver(lattice(0.1), {}, {}, control)
    {
        solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025, {1, 2});
        for (int i = 0; i < 3; ++i) solver.step(1e-3, Gravity{});
    }
};

/// Particles so far from one another that each has a block of its own, which it leaves now and then: blocks
/// are created, and empty ones removed.
struct Flight
{
    Jelly solver;

    explicit Flight(int steps) : solver(lattice(0.05))
    {
        std::vector<Eigen::Vector2d> points;
        for (int i = 0; i < sample_of(6, 20); ++i) points.emplace_back(0.013 + 2 * i, 0.013);
        solver.add(points, 1e-5, {0, 20});
        for (int i = 0; i < steps; ++i) solver.step(1e-3);
    }
};

/// Gravity far too strong, which has no memory for a second step.
struct StrongGravity
{
    int* steps;
    Gravity gravity{{0, -1e9, 0}};

    void validate() const {}
    template <class Number, int d>
    auto over(Interval const& interval) const
    {
        if (++*steps > 1) throw std::bad_alloc{};
        return gravity.over<Number, d>(interval);
    }
};

/// How often a call failed, and after how many of these times the solver went on.
struct Failures
{
    int all = 0, gone_on = 0;
};

/// The call is to fail at one allocation after the other. It then leaves a solver that says why it does not
/// go on, or one that goes on from what there was before the call, to where one goes that was never called.
/// It fails `most` times at most.
template <class Make, class Call>
Failures fail_everywhere(Make const& make, Call const& call, int most = 1000)
{
    std::vector<std::vector<Eigen::Vector2d>> expected;
    for (auto untouched = make(); expected.size() < 3; untouched.solver.step(1e-3, Gravity{}))
        expected.push_back(untouched.solver.positions());
    Failures failures;
    for (int k = 0; k < most; ++k) {
        auto scene = make();
        bool failed = false;
        allowed = k;
        try {
            call(scene);
        }
        catch (...) {
            failed = true;
        }
        allowed = -1;
        if (!failed) break;
        ++failures.all;
        CAPTURE(k);
        try {
            for (auto const& there : expected) {
                auto const here = scene.solver.positions();
                REQUIRE(here.size() == there.size());
                double worst = 0;
                for (std::size_t p = 0; p < here.size(); ++p)
                    worst = std::max(worst, (here[p] - there[p]).norm());
                REQUIRE(worst < 1e-9);
                scene.solver.step(1e-3, Gravity{});
            }
            scene.solver.remove_if(Inside{Sphere{0.2}});
            REQUIRE(scene.solver.positions().size() == scene.solver.size());
            ++failures.gone_on;
        }
        catch (Error const& error) {
            REQUIRE_THAT(error.what(), Contains("broke off") && Contains("make a new one"));
        }
    }
    return failures;
}
template <class Call>
Failures fail_everywhere(Call const& call)
{
    return fail_everywhere([] { return Block{}; }, call);
}
} // namespace

TEST_CASE("where memory ends in the middle of a call, the solver goes on or says why it does not")
{
    SECTION("add")
    {
        auto const failures = fail_everywhere([](Block& b) { b.solver.add(b.more, 0.0025); });
        CAPTURE(failures.all, failures.gone_on); // it goes on where the new ones have no room
        CHECK(failures.all > 3);
        CHECK(3 * failures.gone_on > failures.all);
    }
    SECTION("remove_if")
    {
        auto const failures = fail_everywhere([](Block& b) { b.solver.remove_if(Inside{Sphere{0.2}}); });
        CAPTURE(failures.all, failures.gone_on); // as long as what is to stay is prepared
        CHECK(failures.all > 3);
        CHECK(3 * failures.gone_on > failures.all);
    }
    SECTION("step")
    {
        auto const failures = fail_everywhere([](Block& b) { b.solver.step(1e-3, Gravity{}); });
        if (TestedBackend::reaches_host_memory)
            CHECK(failures.all > 0);
        else // where it has been before it asks a device for none
            CHECK(failures.all == 0);
    }
    SECTION("a step with other effects than before: it goes on where there is no room for what they store")
    {
        auto const known = fail_everywhere([](Block& b) { b.solver.step(1e-3, Gravity{}); });
        auto const others = fail_everywhere([](Block& b) { b.solver.step(1e-3); });
        CHECK(others.gone_on > known.gone_on);
    }
    SECTION("steps into new blocks, and those that leave many behind")
    {
        int all = 0;
        for (int steps = 16; steps < 22; ++steps)
            all += fail_everywhere([&] { return Flight(steps); }, [](Flight& f) { f.solver.step(1e-3); }).all;
        CHECK(all > 3);
    }
    SECTION("advance")
    {
        CHECK(fail_everywhere([](Block& b) { b.solver.advance(0.01, Gravity{}); }).all > 0);
    }
    SECTION("snapshot")
    {
        CHECK(fail_everywhere([](Block& b) { b.solver.snapshot(); }).all > 3);
        for (int steps = 18; steps < 22; ++steps) { // all blocks are left behind in one of them
            auto const make = [&] { return Flight(steps); };
            fail_everywhere(
                make, [](Flight& f) { f.solver.snapshot(); }, 12);
        }
    }
    SECTION("a snapshot where particles are in quarantine: their list finds its room before anything changes")
    {
        auto const with_a_list = [](bool keeps) {
            Block block;
            block.solver.quarantine(1);
            std::vector<Eigen::Matrix2d> H(block.solver.size(), Eigen::Matrix2d::Zero());
            H[0] = Eigen::Vector2d(-3, 0).asDiagonal();
            block.solver.template upload<DisplacementGradient>(H);
            block.solver.step(1e-3, Gravity{});
            REQUIRE(block.solver.isolated().size() == 1);
            auto state = block.solver.snapshot();
            if (!keeps) state.isolated.clear();
            block.solver.restore(state);
            return block;
        };
        auto const broken_off = [&](bool keeps) {
            auto const failures =
                fail_everywhere([&] { return with_a_list(keeps); }, [](Block& b) { b.solver.snapshot(); });
            return failures.all - failures.gone_on;
        };
        CHECK(broken_off(true) == broken_off(false));
    }
    SECTION("restore")
    {
        auto const known = Block{}.solver.snapshot();
        CHECK(fail_everywhere([&](Block& b) { b.solver.restore(known); }).all > 3);
        auto unknown = known;
        unknown.forget_parameters(); // the bounds of the next step are found anew
        CHECK(fail_everywhere([&](Block& b) { b.solver.restore(unknown); }).all > 3);
    }
    SECTION("a step that goes wrong")
    {
        // after some that go well, so that the grid alone has the velocities; it is not beyond the stable one
        double const dt = 1e-5;
        auto const pressed = [&](std::size_t good) {
            Block block({.deformation = 1e-4, .rejection = 1.0001e-4});
            std::vector<Eigen::Matrix2d> half(block.solver.size(), Eigen::Vector2d(0, -0.3).asDiagonal());
            block.solver.template upload<DisplacementGradient>(half);
            block.solver.steps(good, dt, Gravity{});
            return block;
        };
        std::size_t good = 0;
        Block counted = pressed(0);
        CHECK_THROWS_AS(
            [&] {
                for (; good < 1000; ++good) counted.solver.step(dt, Gravity{});
            }(),
            StepError);
        REQUIRE(good > 3);
        int refused = 0, kept = 0;
        for (int k = 0;; ++k) {
            Block block = pressed(good);
            auto const before = Totals(block.solver).momentum;
            bool went_wrong = false;
            allowed = k;
            try {
                block.solver.step(dt, Gravity{});
            }
            catch (StepError const&) {
                went_wrong = true;
            }
            catch (...) { // no memory
            }
            allowed = -1;
            try {
                auto const after = Totals(block.solver).momentum;
                REQUIRE((after - before).norm() < 1e-9 * before.norm());
                ++kept;
            }
            catch (Error const& error) {
                REQUIRE_THAT(error.what(), Contains("broke off"));
                ++refused;
            }
            if (went_wrong) break;
        }
        CAPTURE(refused, kept);
        int const few = TestedBackend::reaches_host_memory ? 3 : 0; // devices ask for memory up front
        CHECK(refused > few);
        CHECK(kept > few);
    }
    SECTION("a step that went wrong and is to be repeated, where the grid alone had the velocities")
    {
        if constexpr (TestedBackend::reaches_host_memory) { // loops of a device throw nothing
            Block block;
            int steps = 0;
            CHECK_THROWS_AS(block.solver.advance(0.9e-3, StrongGravity{&steps}), std::bad_alloc);
            CHECK(steps == 2);
            CHECK_THROWS_WITH(block.solver.positions(), Contains("broke off"));
        }
    }
    SECTION("upload")
    {
        auto const upload = [](Block& b) {
            b.solver.template upload<Velocity>(
                std::vector<Eigen::Vector2d>(b.solver.size(), Eigen::Vector2d(1, 1)));
        };
        CHECK(fail_everywhere(upload).all > 3);
    }
}
