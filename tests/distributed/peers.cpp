// SPDX-License-Identifier: MIT
// Needs a device; of several devices ranks take one by turns.
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/encounter.hpp"
#include "distributed/numbers.hpp"

#include <firn/distributed.hpp>
#include <firn/distributed/on_cuda.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/firn.hpp>
#include <firn/peers.hpp>

#include <cmath>
#include <cstddef>
#include <string>
#include <type_traits>
#include <vector>

using namespace firn;
using firn::test::box_of_points;
using firn::test::encounter;
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
