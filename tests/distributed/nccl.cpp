// SPDX-License-Identifier: MIT
// Needs a device, and two for the scene.
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/encounter.hpp"

#include <firn/distributed.hpp>
#include <firn/distributed/on_cuda.hpp>
#include <firn/distributed/rank_threads.hpp>
#include <firn/firn.hpp>
#include <firn/nccl.hpp>

#include <cstddef>
#include <numeric>
#include <vector>

using namespace firn;
using firn::test::encounter;

namespace
{

int devices()
{
    int count = 0;
    static_cast<void>(cudaGetDeviceCount(&count));
    return count;
}

} // namespace

TEST_CASE("ranks whose devices swap by NCCL come to the bits of one device")
{
    if (devices() < 2) {
        WARN("there is one device: NCCL was not tried");
        return;
    }
    std::vector<int> numbers(std::size_t(devices() - 1));
    std::iota(numbers.begin(), numbers.end(), 2);
    firn::test::require_same_on_ranks(numbers, encounter(NeoHookean<Space<3, float>>{}),
                                      [](RankThreads const& threads) {
                                          return Distributed<Cuda, Nccl<RankThreads>>{
                                              .local = {.device = threads.rank()},
                                              .communicator = Nccl<RankThreads>(threads, threads.rank())};
                                      });
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
        CHECK_THROWS_WITH(
            run_ranks(1,
                      [](RankThreads const& threads) {
                          using Backend = Distributed<Cuda, Nccl<RankThreads>>;
                          encounter(NeoHookean<Space<3, float>>{})(
                              Backend{.local = {.device = 1}, .communicator = Nccl<RankThreads>(threads, 0)});
                      }),
            Contains("another device"));
}
