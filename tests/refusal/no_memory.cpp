// SPDX-License-Identifier: MIT
// In a program of its own: here `new` fails when it is told to.
#include "catch.hpp"
#include "support/policies.hpp"

#include <cstdlib>
#include <functional>
#include <new>

namespace
{
int allowed = -1; ///< so many more may succeed; below 0: all

void* allocated_or_null(std::size_t bytes, std::size_t alignment)
{
    if (allowed == 0) return nullptr;
    if (allowed > 0) --allowed;
    return std::aligned_alloc(alignment, (bytes / alignment + 1) * alignment);
}
void* allocated(std::size_t bytes, std::size_t alignment)
{
    void* const memory = allocated_or_null(bytes, alignment);
    if (!memory) throw std::bad_alloc{};
    return memory;
}
} // namespace

void* operator new(std::size_t bytes) { return allocated(bytes, 16); }
void* operator new(std::size_t bytes, std::nothrow_t const&) noexcept { return allocated_or_null(bytes, 16); }
void* operator new(std::size_t bytes, std::align_val_t alignment)
{
    return allocated(bytes, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }

using namespace firn;
using namespace firn::test;

namespace
{
using Jelly = Solver<OpenMP, NeoHookean<Plane>, QuadraticBSpline, Mls>;

/// A block that has moved, with a box far from it that is yet to be added.
struct Block
{
    Jelly solver;
    std::vector<Eigen::Vector2d> more = box_of_points<2>({3, 3}, {3.5, 3.5}, 0.1);

    explicit Block(StepControl const& control = {}) : solver(lattice(0.1), {}, {}, control, OpenMP{1})
    {
        solver.add(box_of_points<2>({0, 0}, {0.4, 0.4}, 0.1), 0.0025, {1, 2});
        for (int i = 0; i < 3; ++i) solver.step(1e-3, Gravity{});
    }
};

/// What the call leaves when memory ends at any of its allocations: a solver that goes on, or one that says
/// why it does not.
void check_whatever_fails(std::function<void(Block&)> const& call)
{
    int refused = 0, usable = 0;
    for (int k = 0;; ++k) {
        Block block;
        bool failed = false;
        allowed = k;
        try {
            call(block);
        }
        catch (...) {
            failed = true;
        }
        allowed = -1;
        if (!failed) break;
        try {
            auto const before = block.solver.positions();
            REQUIRE(before.size() == block.solver.size());
            for (auto const& x : before) REQUIRE((x.array().abs() < 10).all());
            block.solver.step(1e-3, Gravity{});
            block.solver.remove_if(Inside{Sphere{0.2}});
            REQUIRE(block.solver.positions().size() == block.solver.size());
            ++usable;
        }
        catch (Error const& error) {
            REQUIRE_THAT(error.what(), Contains("broke off") && Contains("make a new one"));
            ++refused;
        }
    }
    CAPTURE(refused, usable);
    CHECK(refused + usable > 3);
}
} // namespace

TEST_CASE("where memory ends in the middle of a call, the solver goes on or says why it does not")
{
    SECTION("add")
    {
        check_whatever_fails([](Block& b) { b.solver.add(b.more, 0.0025); });
    }
    SECTION("remove_if")
    {
        check_whatever_fails([](Block& b) { b.solver.remove_if(Inside{Sphere{0.2}}); });
    }
    SECTION("step")
    {
        check_whatever_fails([](Block& b) { b.solver.step(1e-3, Gravity{}); });
    }
    SECTION("step into new blocks")
    {
        check_whatever_fails([](Block& b) {
            b.solver.add(b.more, 0.0025, {40, 0});
            for (int i = 0; i < 30; ++i) b.solver.step(1e-3, Gravity{});
        });
    }
    SECTION("advance")
    {
        check_whatever_fails([](Block& b) { b.solver.advance(0.01, Gravity{}); });
    }
    SECTION("snapshot")
    {
        check_whatever_fails([](Block& b) { b.solver.snapshot(); });
    }
    SECTION("restore")
    {
        auto const known = Block{}.solver.snapshot();
        check_whatever_fails([&](Block& b) { b.solver.restore(known); });
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
            catch (std::bad_alloc const&) {
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
        CHECK(refused > 3);
        CHECK(kept > 3);
    }
    SECTION("upload")
    {
        check_whatever_fails([](Block& b) {
            b.solver.template upload<Velocity>(
                std::vector<Eigen::Vector2d>(b.solver.size(), Eigen::Vector2d(1, 1)));
        });
    }
}
