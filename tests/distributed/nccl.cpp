// SPDX-License-Identifier: MIT
// Needs a device, and two for the scene.
#include "catch.hpp"
#include "distributed/numbers.hpp"

#include <firn/distributed.hpp>
#include <firn/distributed/on_cuda.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/firn.hpp>
#include <firn/nccl.hpp>

#include <cstddef>
#include <type_traits>
#include <vector>

using namespace firn;

namespace
{

int devices()
{
    int count = 0;
    static_cast<void>(cudaGetDeviceCount(&count));
    return count;
}

/// A block that falls on a floor and moves along it, through the parts of all ranks.
template <class Backend>
firn::test::Numbers flight(Backend const& backend)
{
    double const h = 0.1;
    Solver<Backend, NeoHookean<Space<3, float>>> solver(lattice(h), {}, {}, {}, backend);
    solver.add(firn::test::box_of_points<3>({0.1, 0.1, 0.1}, {1.7, 0.9, 0.9}, h / 2), h * h * h / 8,
               {3, -2, 0});
    firn::test::Numbers all;
    for (int i = 0; i < 4; ++i)
        firn::test::append_report(all, solver.advance(0.05, Gravity{}, Obstacle<HalfSpace>{}));
    firn::test::append_all(all, solver);
    return all;
}

} // namespace

TEST_CASE("ranks whose devices swap by NCCL come to the bits of one device")
{
    if (devices() < 2) {
        WARN("there is one device: NCCL was not tried");
        return;
    }
    auto const alone = flight(Cuda{});
    for (int ranks = 2; ranks <= devices(); ++ranks) {
        std::vector<std::size_t> same(std::size_t(ranks), 0);
        run_ranks(ranks, [&](RankThreads const& threads) {
            Nccl<RankThreads> const communicator(threads, threads.rank());
            using Backend = Distributed<Cuda, Nccl<RankThreads>>;
            auto const here =
                flight(Backend{.local = {.device = threads.rank()}, .communicator = communicator});
            for (std::size_t i = 0; i < here.size() && here.size() == alone.size(); ++i)
                same[std::size_t(threads.rank())] += here[i] == alone[i];
        });
        for (auto const count : same) CHECK(count == alone.size());
    }
}

TEST_CASE("no rank waits for messages of the device of a rank that has ended")
{
    if (devices() < 2) {
        WARN("there is one device: NCCL was not tried");
        return;
    }
    CHECK_THROWS_WITH(run_ranks(2,
                                [](RankThreads const& threads) {
                                    cuda::Queue const queue{.device = threads.rank()};
                                    Nccl<RankThreads> const communicator(threads, queue.device);
                                    cuda::Array<int> own(queue), all(queue);
                                    own.resize(1);
                                    all.resize(2);
                                    auto const gather = [&] {
                                        communicator.gather_on_device(queue.stream, own.data(), sizeof(int),
                                                                      all.data());
                                        queue.wait();
                                        communicator.require_all();
                                    };
                                    gather();
                                    if (threads.rank() == 1)
                                        throw Error{"it has had enough", "here", "None."};
                                    gather();
                                }),
                      Contains("it has had enough"));
}

TEST_CASE("NCCL is refused where two ranks have one device, or a solver has another one")
{
    CHECK_THROWS_WITH(run_ranks(2, [](RankThreads const& threads) { Nccl<RankThreads>(threads, 0); }),
                      Contains("ranks 0 and 1 have the same device"));
    if (devices() > 1)
        CHECK_THROWS_WITH(run_ranks(1,
                                    [](RankThreads const& threads) {
                                        using Backend = Distributed<Cuda, Nccl<RankThreads>>;
                                        flight(Backend{.local = {.device = 1},
                                                       .communicator = Nccl<RankThreads>(threads, 0)});
                                    }),
                          Contains("another device"));
}
