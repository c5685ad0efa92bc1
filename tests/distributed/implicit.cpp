// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/numbers.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/firn.hpp>

#include <mutex>
#include <set>
#include <string>
#include <type_traits>

// Implicit steps, with the same bits on any number of ranks.
using namespace firn;
using firn::test::append;
using firn::test::append_all;
using firn::test::append_report;
using firn::test::box_of_points;
using firn::test::Numbers;
using firn::test::part_of_size;
using firn::test::part_of_time;
using firn::test::require_same_on_any_ranks;

namespace
{

using Body = NeoHookean<firn::Space<2, double>>;
template <class Backend>
using ImplicitSolver = Solver<Backend, Body, QuadraticBSpline, Mls, Implicit>;

template <class Backend>
ImplicitSolver<Backend> block(Backend const& backend, double young, Implicit const& by = {})
{
    ImplicitSolver<Backend> solver(lattice(0.1), {.density = 1000, .elasticity = lame<double>(young, 0.3)},
                                   {{}, by}, {}, backend);
    solver.add(box_of_points<2>({0, 0}, {2.4 * part_of_size, 0.8 * part_of_size}, 0.05), 0.05 * 0.05, {1, 0});
    return solver;
}

/// The same obstacle in a list.
Obstacles<HalfSpace> list_of(Obstacle<HalfSpace> const& one)
{
    Obstacles<HalfSpace> obstacles;
    obstacles.list = {one};
    return obstacles;
}

/// How a call was solved.
void append_solved(Numbers& to, SolveReport const& solved)
{
    append(to, Numbers{double(solved.products), double(solved.newton), solved.residual, solved.largest});
    append(to, solved.where);
}

} // namespace

TEST_CASE("implicit steps with walls and friction come to the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.3),
                                        .motion = {.position = {0, -0.02, 0}}};
        ReflectingWall const wall{0, static_cast<int>(2 + 24 * part_of_size), -1};
        int const calls = static_cast<int>(1 + 2 * part_of_time);
        Numbers all;
        auto soft = block(backend, 1e6);
        for (int i = 0; i < calls; ++i) {
            append_report(all, soft.advance(0.03, Gravity{}, floor, wall));
            append_solved(all, soft.solved());
        }
        append_all(all, soft);
        auto stiff = block(backend, 1e8); // by coarse grids
        for (int i = 0; i < calls; ++i)
            for (auto const& step : stiff.steps(2, 0.005, Gravity{}, list_of(floor), wall)) {
                append(all, step.reactions[0].impulse);
                append_solved(all, stiff.solved());
            }
        append_all(all, stiff);
        return all;
    });
}

TEST_CASE("a scene that is brought to rest comes to the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        auto solver = block(backend, 1e6);
        auto const report =
            solver.settle(Gravity{}, ReflectingWall{0, 0, 1}, list_of({.contact = Contact::bound_slip()}));
        Numbers all{double(report.load_steps)};
        append_solved(all, report.solve);
        for (auto const& reaction : report.reactions) append(all, reaction.impulse);
        append_all(all, solver);
        return all;
    });
}

TEST_CASE("a step that is not solved is the same Error on any number of ranks")
{
    std::mutex mutex;
    std::set<std::string> said;
    require_same_on_any_ranks([&](auto const& backend) {
        auto solver = block(backend, 1e6, {.tolerance = 1e-15, .newton = 1});
        try {
            solver.step(0.1, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()});
        }
        catch (Error const& error) {
            std::lock_guard const lock(mutex);
            said.insert(error.what());
        }
        Numbers all;
        append_all(all, solver);
        return all;
    });
    CHECK(said.size() == 1);
}

TEST_CASE("steps of a fixed number of products come to the same bits and numbers on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        auto solver = block(backend, 1e8, {.newton = 2, .linear = 7, .fixed = true}); // by coarse grids
        Numbers all;
        for (int i = 0; i < static_cast<int>(1 + 2 * part_of_time); ++i) {
            solver.step(0.005, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::coulomb(0.3)});
            append_solved(all, solver.solved());
            CHECK(solver.solved().products == 14);
        }
        append_all(all, solver);
        return all;
    });
}
