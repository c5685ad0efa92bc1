// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/encounter.hpp"
#include "distributed/numbers.hpp"

#include <firn/budget.hpp>
#include <firn/distributed.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/firn.hpp>
#include <firn/io/checkpoint.hpp>
#if defined(__CUDACC__)
#include <firn/distributed/on_cuda.hpp>
#else
#include <firn/openmp.hpp>
#if defined(FIRN_TESTS_ALL)
#include <firn/distributed/on_reference.hpp>
#include <firn/reference.hpp>
#endif
#endif

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

using namespace firn;
using firn::test::append;
using firn::test::append_all;
using firn::test::append_report;
using firn::test::box_of_points;
using firn::test::encounter;
using firn::test::local;
using firn::test::most_ranks;
using firn::test::Numbers;
using firn::test::OfBlocks;
using firn::test::on;
using firn::test::Ranks;
using firn::test::require_same_on_any_ranks;

// One scene on one rank and on several, which are threads here, must come to the same bits.
namespace
{

using Plane = firn::Space<2, double>;
using Solid = firn::Space<3, float>;
} // namespace

TEST_CASE(
    "elastic blocks that fly through the parts of all ranks come to the same bits on any number of them")
{
    require_same_on_any_ranks(encounter(NeoHookean<OfBlocks>{}));
}

#if !defined(FIRN_ON_PROCESSOR) || defined(FIRN_TESTS_ALL) // else they take long
TEST_CASE("transfers of every kind, kernels and flow come to the same bits on any number of ranks")
{
    SECTION("sand by APIC") { require_same_on_any_ranks(encounter<Sand<Plane>, Apic>({})); }
    SECTION("snow by FLIP, cubic")
    {
        require_same_on_any_ranks(encounter<Snow<Plane>, Flip, CubicBSpline>({}));
    }
    SECTION("elastic by XPIC")
    {
        require_same_on_any_ranks(encounter<FixedCorotated<Plane>, Xpic>({}, Xpic{3}));
    }
}
#endif

TEST_CASE("obstacles that push particles react with the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                 backend);
        solver.add(box_of_points<2>({0, 0.3}, {1.6, 1.1}, 0.05), 0.05 * 0.05, {1, -2});
        Obstacle<Box> const block{
            .shape = {{0.5, 0.2, 1}}, .motion = {.position = {0.8, 0, 0}}, .on_particles = true};
        Numbers all;
        append_report(all, solver.advance(0.1, Gravity{}, block, ReflectingWall{0, 24, -1}));
        append_all(all, solver);
        return all;
    });
}

TEST_CASE("lists of obstacles react with the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                 backend);
        solver.add(box_of_points<2>({0, 0.3}, {1.6, 1.1}, 0.05), 0.05 * 0.05, {1, -2});
        Obstacles<Sphere, ActsOn::particles> balls;
        for (int i = 0; i < 6; ++i)
            balls.list.push_back({.shape = {0.2},
                                  .contact = Contact::coulomb(0.3),
                                  .motion = {.position = {0.4 * i, 0.1, 0}},
                                  .on_particles = i % 2 == 0});
        Numbers all;
        for (int i = 0; i < 3; ++i) append_report(all, solver.advance(0.05, Gravity{}, balls));
        append_all(all, solver);
        return all;
    });
}

#if !defined(FIRN_ON_PROCESSOR) || defined(FIRN_TESTS_ALL) // else they take long
TEST_CASE("materials and bodies that share a grid come to the same bits on any number of ranks")
{
    auto const scene = [](auto solver, auto const& wall) {
        solver.template add<Material<0>>(box_of_points<2>({0, 0}, {0.8, 0.8}, 0.05), 0.05 * 0.05, {2, 0});
        solver.template add<Material<1>>(box_of_points<2>({0.85, 0.3}, {1.6, 1.1}, 0.05), 0.05 * 0.05,
                                         {-2, 0});
        Numbers all;
        append_report(all, solver.advance(0.1, Gravity{}, wall));
        append_all(all, solver);
        append(all, solver.template positions<Material<1>>());
        return all;
    };
    SECTION("materials")
    {
        require_same_on_any_ranks([&](auto const& backend) {
            using B = std::remove_cvref_t<decltype(backend)>;
            return scene(
                Solver<B, Materials<NeoHookean<Plane>, Sand<Plane>>>(lattice(0.1), {}, {}, {}, backend),
                ReflectingWall{1, 0, 1});
        });
    }
    SECTION("bodies")
    {
        require_same_on_any_ranks([&](auto const& backend) {
            using B = std::remove_cvref_t<decltype(backend)>;
            using Jelly = NeoHookean<Plane>;
            return scene(Solver<B, Bodies<Jelly, Jelly>>(
                             lattice(0.1), {Jelly{}, Jelly{}, Contact::coulomb(0.4)}, {}, {}, backend),
                         Obstacle<HalfSpace>{});
        });
    }
}
#endif

TEST_CASE("particles that come, go and are set, and periods, keep the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>, QuadraticBSpline, Apic> solver(
            lattice(0.1).periodic(0, 64), {}, {}, {}, backend);
        solver.add(box_of_points<2>({5.8, 0}, {6.8, 0.8}, 0.05), 0.05 * 0.05, {4, 0});
        solver.advance(0.02);
        solver.add(box_of_points<2>({1, 1}, {1.4, 1.4}, 0.05), 0.05 * 0.05 / 2, {0, -1});
        solver.advance(0.02);
        for (double x = 6.1; x < 6.5;
             x += 0.1) { // some have moved to another rank's cells since they were sorted
            solver.remove_if(Inside{Sphere{0.1}, Motion{.position = {x, 0.4, 0}}});
            solver.advance(0.005);
        }
        auto velocities = solver.template download<Velocity>();
        for (std::size_t i = 0; i < velocities.size(); ++i) velocities[i] *= 1 + 0.1 * double(i % 3);
        solver.template upload<Velocity>(velocities);
        auto strains = solver.template download<DisplacementGradient>();
        for (auto& strain : strains) strain *= 0.5;
        solver.template upload<DisplacementGradient>(strains);
        Numbers all;
        append_report(all, solver.advance(0.05));
        append_all(all, solver);
        append(all, solver.template download<AffineVelocity>());
        using Memory = typename std::remove_cvref_t<decltype(backend)>::template Array<double>;
        auto const written = [&](std::size_t stride, auto const& write) {
            Memory memory(backend);
            memory.resize(solver.size() * stride);
            memory.fill(0, memory.size(), 0.5);
            write(memory.data(), stride);
            std::vector<double> here(memory.size());
            memory.download(0, here);
            append(all, here);
        };
        written(3, [&](auto... to) { solver.write_positions(to...); });
        written(2, [&](auto... to) { solver.template write<Velocity>(to...); }); // gathered
        written(4, [&](auto... to) { solver.template write<DisplacementGradient>(to...); });
        written(5, [&](auto... to) { solver.template write<Stress>(to...); });
        return all;
    });
}

#if !defined(FIRN_ON_PROCESSOR) || defined(FIRN_TESTS_ALL) // else they take long
TEST_CASE("a snapshot is the same on any number of ranks, and any number goes on from it")
{
    auto const begin = [](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, Snow<Solid>> solver(lattice(0.1), {}, {}, {}, backend);
        solver.add(box_of_points<3>({0, 0.05, 0}, {1.2, 0.6, 0.4}, 0.05), 0.05 * 0.05 * 0.05, {3, -1, 0});
        return solver;
    };
    Obstacle<HalfSpace> const floor{};
    auto first = begin(local());
    first.advance(0.03, floor);
    auto const middle = first.snapshot();
    auto const path = std::filesystem::temp_directory_path() / "firn_over_ranks.firn";
    require_same_on_any_ranks([&](auto const& backend) {
        auto solver = begin(backend);
        solver.advance(0.03, floor);
        auto const own = solver.snapshot();
        Numbers all;
        append(all, own.materials[0].ids);
        append(all, own.materials[0].cells);
        for (auto const& offset : own.materials[0].offsets) append(all, offset);
        solver.advance(0.02, floor);
        append_all(all, solver);
        auto other = begin(backend);
        other.restore(middle);
        other.advance(0.02, floor);
        append_all(all, other);
        write_checkpoint(path, solver); // of the first rank alone
        auto third = begin(backend);
        read_checkpoint(path, third);
        third.advance(0.02, floor);
        append_all(all, third);
        return all;
    });
}
#endif

TEST_CASE("what a rank cannot take, no rank takes, and all get the same Error")
{
    std::mutex mutex;
    std::set<std::string> said;
    int count = 0;
    auto const note = [&](auto const& call) {
        try {
            call();
        }
        catch (Error const& error) {
            std::lock_guard const lock(mutex);
            said.insert(error.what());
            ++count;
        }
    };
    SECTION("a state that the material could not have come to, of one particle")
    {
        run_ranks(3, [&](RankThreads const& communicator) {
            Solver<Ranks, Snow<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
            solver.add(box_of_points<2>({0, 0}, {3, 1}, 0.05), 0.05 * 0.05);
            auto strains = solver.download<DisplacementGradient>();
            strains[7](0, 0) = -1.5;
            note([&] { solver.upload<DisplacementGradient>(strains); });
            solver.advance(0.01);
        });
    }
    SECTION("a step that goes wrong for a particle of one rank")
    {
        run_ranks(3, [&](RankThreads const& communicator) {
            Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
            solver.add(box_of_points<2>({0, 0}, {3, 1}, 0.05), 0.05 * 0.05);
            auto velocities = solver.download<Velocity>();
            velocities[7][0] = 1e4;
            solver.upload<Velocity>(velocities);
            note([&] { solver.step(1e-3); });
        });
    }
    SECTION("memory for values that is none on one rank")
    {
        run_ranks(3, [&](RankThreads const& communicator) {
            Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
            solver.add(box_of_points<2>({0, 0}, {1, 1}, 0.05), 0.05 * 0.05);
            firn::test::Local::Array<double> memory(on(communicator));
            memory.resize(2 * solver.size());
            note([&] { solver.write_positions(communicator.rank() == 1 ? nullptr : memory.data()); });
            solver.advance(0.01);
        });
    }
    SECTION("a checkpoint that one rank does not see")
    {
        auto const path = std::filesystem::temp_directory_path() / "firn_seen_by_ranks.firn";
        run_ranks(3, [&](RankThreads const& communicator) {
            Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
            solver.add(box_of_points<2>({0, 0}, {1, 1}, 0.05), 0.05 * 0.05);
            write_checkpoint(path, solver);
            auto const seen = communicator.rank() == 1 ? path.string() + " of another host" : path.string();
            note([&] { read_checkpoint(seen, solver); });
            solver.advance(0.01);
        });
    }
    SECTION("another snapshot on one rank")
    {
        run_ranks(3, [&](RankThreads const& communicator) {
            Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
            solver.add(box_of_points<2>({0, 0}, {1, 1}, 0.05), 0.05 * 0.05);
            auto const before = solver.snapshot();
            solver.advance(0.01);
            auto const after = solver.snapshot();
            note([&] { solver.restore(communicator.rank() == 1 ? before : after); });
            solver.advance(0.01);
        });
        CHECK(count == 3);
        return;
    }
    SECTION("another step control on one rank")
    {
        run_ranks(3, [&](RankThreads const& communicator) {
            StepControl control;
            if (communicator.rank() == 1) control.growth = 1.2;
            note([&] {
                Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, control, on(communicator));
            });
        });
        CHECK(count == 3);
        return;
    }
    SECTION("other points, volumes or values on one rank, or a step of another length")
    {
        int const other = GENERATE(0, 1, 2, 3);
        run_ranks(3, [&](RankThreads const& communicator) {
            Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
            bool const is_other = communicator.rank() == 1;
            auto points = box_of_points<2>({0, 0}, {3, 1}, 0.05);
            std::vector<double> volumes(points.size(), 0.05 * 0.05);
            std::vector<Eigen::Vector2d> velocities(points.size(), Eigen::Vector2d(1, 0));
            if (is_other && other == 0) points[3][0] += 1e-9;
            if (is_other && other == 1) volumes[5] *= 1.01;
            if (is_other && other == 2) velocities[7].y() = -0.0;
            note([&] {
                solver.add(points, volumes);
                solver.upload<Velocity>(velocities);
                solver.step(is_other && other == 3 ? 1e-4 : 1.1e-4);
            });
        });
        CHECK(count == 3);
        return;
    }
    SECTION("other arguments on one rank")
    {
        run_ranks(3, [&](RankThreads const& communicator) {
            NeoHookean<Plane> model;
            if (communicator.rank() == 1) model.density = 2000;
            note([&] {
                Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), model, {}, {}, on(communicator));
            });
        });
        CHECK(count == 3);
        return;
    }
    CHECK(count == 3);
    CHECK(said.size() == 1);
}

TEST_CASE("particles in quarantine are the same on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                 backend);
        solver.add(box_of_points<2>({0, 0}, {2, 0.8}, 0.05), 0.05 * 0.05);
        solver.quarantine(3);
        auto strains = solver.template download<DisplacementGradient>();
        strains[100](0, 0) = -1.5;
        solver.template upload<DisplacementGradient>(strains);
        solver.advance(0.01);
        Numbers all;
        append_all(all, solver);
        for (auto const& gone : solver.isolated()) append(all, Numbers{double(gone.particle), gone.time});
        return all;
    });
}

TEST_CASE("the same one of particles that are equally bad is named on any number of ranks")
{
    auto const scene = [](auto const& backend, auto const& spoil) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                 backend);
        solver.add(box_of_points<2>({0, 0}, {2.4, 2.4}, 0.05), 0.05 * 0.05, {3, -1});
        solver.advance(0.005);
        solver.quarantine(20);
        spoil(solver, std::vector<std::size_t>{2000, 500, 20, 100, 40, 300, 1000, 3, 1182, 588, 612});
        Numbers all;
        try {
            solver.step(1e-3);
        }
        catch (StepError const& error) {
            append(all, Numbers{double(error.failure().particle), error.failure().position[0]});
        }
        for (auto const& gone : solver.isolated())
            append(all, Numbers{double(gone.particle), gone.position[0], double(gone.count)});
        append_all(all, solver);
        return all;
    };
    SECTION("by their strain")
    {
        require_same_on_any_ranks([&](auto const& backend) {
            return scene(backend, [](auto& solver, auto const& particles) {
                auto strains = solver.template download<DisplacementGradient>();
                for (auto const i : particles) strains[i](0, 0) = -1.5;
                solver.template upload<DisplacementGradient>(strains);
            });
        });
    }
    SECTION("by their velocity")
    {
        require_same_on_any_ranks([&](auto const& backend) {
            return scene(backend, [](auto& solver, auto const& particles) {
                auto velocities = solver.template download<Velocity>();
                for (auto const i : particles) velocities[i][0] = 4e4;
                solver.template upload<Velocity>(velocities);
            });
        });
    }
}

TEST_CASE("a run goes on after a failed step with the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                 backend);
        solver.add(box_of_points<2>({0, 0}, {2, 0.8}, 0.05), 0.05 * 0.05, {1, -1});
        Obstacle<HalfSpace> const floor{};
        solver.advance(0.02, floor);
        bool failed = false; // Catch2's macros are for one thread
        try {
            solver.step(0.5, floor);
        }
        catch (StepError const&) {
            failed = true;
        }
        Numbers all{failed ? 1.0 : 0.0};
        append_all(all, solver);
        append_report(all, solver.advance(0.02, floor));
        append_all(all, solver);
        return all;
    });
}

TEST_CASE("a budget in seconds is kept by the clock of the first rank, and all ranks take the same steps")
{
    std::vector<double> times(3);
    run_ranks(3, [&](RankThreads const& communicator) {
        Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
        solver.add(box_of_points<2>({0, 0}, {3, 1}, 0.05), 0.05 * 0.05);
        for (int i = 0; i < 20; ++i) solver.advance(1, Budget{.seconds = 1e-3}, Gravity{});
        times[std::size_t(communicator.rank())] = solver.time();
    });
    CHECK(times[0] > 0);
    CHECK(times[0] < 20);
    CHECK(times == std::vector<double>(3, times[0]));
}

TEST_CASE("an error of one rank ends the others, which wait for it")
{
    CHECK_THROWS_WITH(run_ranks(3,
                                [](RankThreads const& communicator) {
                                    if (communicator.rank() == 2) throw Error{"no", "here", "Go."};
                                    communicator.all_gather({});
                                }),
                      Contains("no [here]. Go."));
}

TEST_CASE("a call that one rank makes alone is refused on all")
{
    std::vector<std::string> said(3);
    run_ranks(3, [&](RankThreads const& communicator) {
        Solver<Ranks, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, on(communicator));
        solver.add(box_of_points<2>({0, 0}, {1, 1}, 0.05), 0.05 * 0.05);
        try {
            if (communicator.rank() == 0) static_cast<void>(solver.positions());
            solver.advance(0.01);
        }
        catch (Error const& error) {
            said[std::size_t(communicator.rank())] = error.what();
        }
    });
    for (auto const& error : said) CHECK_THAT(error, Contains("not all ranks make the same call"));
}

TEST_CASE("a rank that has ended can call no other any more")
{
    std::vector<int> errors(2, 0);
    run_ranks(2, [&](RankThreads const& communicator) {
        auto& own = errors[std::size_t(communicator.rank())];
        if (communicator.rank() == 1) communicator.abort("it has no room");
        for (int i = 0; i < 2; ++i) try {
                communicator.all_gather({});
            }
            catch (Error const&) {
                ++own;
            }
    });
    CHECK(errors == std::vector<int>{2, 2});
}

TEST_CASE(
    "what ranks wait for elsewhere is ended once for each that has asked, and at once where one has ended")
{
    std::vector<int> ended(2, 0), missing(2, 0);
    run_ranks(2, [&](RankThreads const& communicator) {
        int const rank = communicator.rank();
        auto const note = [&, rank] { ++ended[std::size_t(rank)]; };
        communicator.require_all();
        if (rank == 0) communicator.when_one_ends(note);
        communicator.all_gather({});
        if (rank == 1) {
            communicator.abort("it has no room");
            communicator.abort("it has no room");
            communicator.when_one_ends(note);
        }
        try {
            while (rank == 0) communicator.all_gather({});
            communicator.require_all();
        }
        catch (Error const&) {
            ++missing[std::size_t(rank)];
        }
    });
    CHECK(ended == std::vector<int>{1, 1});
    CHECK(missing == std::vector<int>{1, 1});
}

TEST_CASE("space is divided anew where a body has flown from one rank's part into another's")
{
    auto const flown = [](auto const& backend, int* divisions) {
        using Backend = std::remove_cvref_t<decltype(backend)>;
        Solver<Backend, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {}, backend);
        solver.add(box_of_points<2>({0, 0}, {1.2, 1.2}, 0.05), 0.05 * 0.05, {20, 5});
        solver.advance(0.5);
        if constexpr (spans_ranks<Backend>) *divisions = solver.backend().partition->divisions();
        Numbers all;
        append_all(all, solver);
        return all;
    };
    Numbers const alone = flown(local(), nullptr);
    std::vector<int> divisions(3, 0), same(3, 0);
    run_ranks(3, [&](RankThreads const& communicator) {
        auto const rank = std::size_t(communicator.rank());
        same[rank] = flown(on(communicator), &divisions[rank]) == alone;
    });
    CHECK(divisions[0] >= 2);
    CHECK(divisions == std::vector<int>(3, divisions[0]));
    CHECK(same == std::vector<int>(3, 1));
}

#if !defined(FIRN_ON_PROCESSOR) || defined(FIRN_TESTS_ALL) // else they take long
TEST_CASE("two solvers of one backend divide space each by itself")
{
    require_same_on_any_ranks([](auto const& backend) {
        auto const flying = [&](double x, double speed) {
            Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                     backend);
            solver.add(box_of_points<2>({x, 0}, {x + 1.2, 1.2}, 0.05), 0.05 * 0.05, {speed, 5});
            return solver;
        };
        auto first = flying(0, 20), second = flying(3, -15);
        for (int i = 0; i < 10; ++i) {
            first.advance(0.03);
            second.advance(0.03);
        }
        Numbers all;
        append_all(all, first);
        append_all(all, second);
        return all;
    });
}

TEST_CASE("space is divided anew in the first step, where one of the materials has no particles")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, Materials<NeoHookean<Plane>, Sand<Plane>>> solver(
            lattice(0.1), {}, {}, {}, backend);
        solver.template add<Material<0>>(box_of_points<2>({0, 0}, {1, 1}, 0.05), 0.05 * 0.05, {20, 5});
        solver.template add<Material<0>>(box_of_points<2>({5, 0}, {7, 2}, 0.05), 0.05 * 0.05, {20, 5});
        solver.advance(0.05);
        solver.template add<Material<1>>(box_of_points<2>({-1, 0}, {0, 1}, 0.05), 0.05 * 0.05);
        Numbers all;
        append_report(all, solver.advance(0.05));
        append_all(all, solver);
        return all;
    });
}
#endif

TEST_CASE("more ranks than blocks, and a rank whose particles all leave")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                                 backend);
        solver.add(box_of_points<2>({0, 0}, {0.3, 0.3}, 0.05), 0.05 * 0.05, {20, 5});
        solver.advance(0.2); // by ten blocks
        Numbers all;
        append_all(all, solver);
        return all;
    });
}
