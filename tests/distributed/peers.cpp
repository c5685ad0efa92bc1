// SPDX-License-Identifier: MIT
// Needs a device; of several devices ranks take one by turns.
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/encounter.hpp"
#include "distributed/numbers.hpp"

#include <firn/distributed.hpp>
#include <firn/distributed/on_cuda.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/distributed/room_for_items.hpp>
#include <firn/firn.hpp>
#include <firn/peers.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <vector>

using namespace firn;
using firn::test::box_of_points;
using firn::test::encounter;
using firn::test::Numbers;
using firn::test::OfBlocks;

TEST_CASE("ranks whose devices copy from each other come to the bits of one device")
{
    auto const scene = encounter(NeoHookean<OfBlocks>{});
    std::vector<int> numbers{1, 2, 3, 4};
#if defined(FIRN_TESTS_FEW_OF_RANKS)
    numbers = {1, 4};
#endif
    SECTION("by themselves") { firn::test::require_same_on_ranks(numbers, scene, firn::test::on_peers); }
#if defined(FIRN_ON_PROCESSOR)
    SECTION("by their driver, where they do not reach each other's memory")
    {
        on_processor::Memory::are_peers = false;
        firn::test::require_same_on_ranks({3}, scene, firn::test::on_peers);
        on_processor::Memory::are_peers = true;
    }
#endif
}

TEST_CASE("particles that are changed on their way from device to device come to the bits of one device")
{
    // Particles travel as soon as they have moved, but what a call changes between steps is of another value.
    auto const with = [](auto const& transfer) {
        return [transfer](auto const& backend) {
            using Model = NeoHookean<Space<2, double>>;
            using Transfer = std::remove_cvref_t<decltype(transfer)>;
            Solver<std::remove_cvref_t<decltype(backend)>, Model, QuadraticBSpline, Transfer> solver(
                lattice(0.1), {}, transfer, {}, backend);
            solver.add(box_of_points<2>({0, 0}, {2, 0.6}, 0.05), 0.05 * 0.05, {20, 3});
            double const dt = 0.02 / 20; // each second layer or so changes its cells in a step
            solver.steps(6, dt);
            for (int i = 0; i < 6; ++i) {
                solver.steps(1, dt);
                auto strains = solver.template download<DisplacementGradient>();
                for (auto& strain : strains) strain *= 0.9;
                solver.template upload<DisplacementGradient>(strains);
            }
            solver.steps(2, dt);
            for (int i = 0; i < 3; ++i) {
                auto velocities = solver.template download<Velocity>();
                for (auto& velocity : velocities) velocity *= 1.01;
                solver.template upload<Velocity>(velocities);
                solver.steps(1, dt);
            }
            solver.steps(3, dt);
            Numbers all;
            try {
                solver.step(0.5);
            }
            catch (StepError const&) {
                all.push_back(1);
            }
            firn::test::append_all(all, solver);
            solver.steps(3, dt);
            solver.remove_if(Inside{Sphere{0.2}, Motion{.position = {1.2, 0.3, 0}}});
            solver.steps(3, dt);
            solver.add(box_of_points<2>({3, 0}, {3.2, 0.2}, 0.05), 0.05 * 0.05, {-20, 0});
            solver.steps(10, dt);
            firn::test::append_all(all, solver);
            return all;
        };
    };
    // velocities are gathered from the grid, and travel beside the others if they are set; or they are stored
    firn::test::require_same_on_ranks({2}, with(Mls{}), firn::test::on_peers);
    firn::test::require_same_on_ranks({3}, with(Flip{}), firn::test::on_peers);
}

TEST_CASE("particles go from device to device beside one to which none go")
{
    // One body moves over two of three ranks, and the third rank has one at rest.
    auto const scene = [](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Space<2, double>>> solver(lattice(0.1), {},
                                                                                            {}, {}, backend);
        auto points = box_of_points<2>({0, 0}, {2, 0.6}, 0.05);
        std::size_t const moving = points.size();
        auto const at_rest = box_of_points<2>({10, 10}, {11, 10.6}, 0.05);
        points.insert(points.end(), at_rest.begin(), at_rest.end());
        solver.add(points, 0.05 * 0.05);
        auto velocities = solver.template download<Velocity>();
        for (std::size_t i = 0; i < moving; ++i) velocities[i] = {20, 3};
        solver.template upload<Velocity>(velocities);
        solver.steps(10, 0.001);
        Numbers all;
        firn::test::append_all(all, solver);
        return all;
    };
    firn::test::require_same_on_ranks({3}, scene, firn::test::on_peers);
}

TEST_CASE("messages between devices have room for as many particles as have travelled of late")
{
    distributed::RoomForItems room(2);
    auto const steps = [&](int count, std::uint32_t leave) {
        for (int i = 0; i < count; ++i) room.count_step([&](int from, int) { return from == 0 ? leave : 0; });
    };
    CHECK(!room.is_any());
    steps(1, 1000);
    CHECK((room(0, 1) > 1100 && room(0, 1) < 1300));
    CHECK(room(0, 1) % distributed::RoomForItems::unit == 0);
    CHECK(room(1, 0) == 0);
    auto const before = room(0, 1);
    steps(1, distributed::RoomForItems::most + 1); // they gain nothing by being sent early
    steps(20, 1050);
    CHECK(room(0, 1) == before);
    steps(100, 10);
    CHECK((room(0, 1) >= 10 && room(0, 1) < 100));
    steps(100, 0);
    CHECK(!room.is_any());
}

TEST_CASE("no rank waits for the device of one that has ended, or that makes another call")
{
    // what each of three ranks says when it ends
    auto const ends = [](auto const& work) {
        std::vector<std::string> said(3);
        CHECK_THROWS_AS(run_ranks(3,
                                  [&](RankThreads const& threads) {
                                      try {
                                          work(threads, firn::test::on_peers(threads));
                                      }
                                      catch (Error const& error) {
                                          said[std::size_t(threads.rank())] = error.what();
                                          throw;
                                      }
                                  }),
                        Error);
        return said;
    };
    SECTION("one that ends after some steps, and whose memory is freed")
    {
        auto const said = ends([](RankThreads const& threads, auto const& backend) {
            Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<OfBlocks>> solver(lattice(0.1), {}, {},
                                                                                        {}, backend);
            constexpr int d = OfBlocks::dimension;
            solver.add(box_of_points<d>(Vector<double, d>::Zero(), Vector<double, d>::Constant(0.8), 0.05),
                       std::pow(0.05, d));
            solver.steps(3, 1e-4);
            if (threads.rank() == 1) throw Error{"it has had enough", "here", "None."};
            solver.steps(100, 1e-4);
        });
        for (auto const& error : said) CHECK_THAT(error, Contains("it has had enough"));
        CHECK_THAT(said[0], Contains("rank 1 has ended"));
    }
    SECTION("one that does not send what another one expects")
    {
        auto const said = ends([](RankThreads const& threads, auto const& backend) {
            cuda::Array<std::byte> memory(backend);
            memory.resize(64);
            std::vector<DeviceMessage> to, from;
            if (threads.rank() == 0) from.push_back({2, memory.data(), 32});
            if (threads.rank() == 2) to.push_back({0, memory.data(), 64});
            backend.communicator.exchange_on_device(backend.queue().stream, to, from);
            for (;;) threads.all_gather({});
        });
        for (auto const& error : said)
            CHECK_THAT(error, Contains("a rank does not send what another one expects"));
    }
    SECTION("one that makes another call")
    {
        auto const said = ends([](RankThreads const& threads, auto const& backend) {
            if (threads.rank() == 2)
                threads.all_gather({});
            else
                backend.communicator.exchange_on_device(backend.queue().stream, {}, {});
        });
        for (auto const& error : said) CHECK_THAT(error, Contains("not all ranks make the same call"));
    }
    SECTION("one whose device is not there")
    {
        auto const said =
            ends([](RankThreads const& threads, auto const&) { Peers(threads, 1000 * threads.rank()); });
        for (auto const& error : said) CHECK_THAT(error, Contains("Pass a device that is there"));
    }
}
