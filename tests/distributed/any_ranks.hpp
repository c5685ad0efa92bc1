// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"
#include "distributed/numbers.hpp"

#include <firn/core/exactly_equal.hpp>
#include <firn/distributed.hpp>
#include <firn/distributed/rank_threads.hpp>
#if defined(__CUDACC__)
#include <firn/distributed/on_cuda.hpp>
#include <firn/peers.hpp>
#else
#include <firn/openmp.hpp>
#endif

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

// Scenes on one rank and on several, which are threads here.
#if defined(FIRN_ON_PROCESSOR) && !defined(FIRN_TESTS_ALL)
#define FIRN_TESTS_FEW_OF_RANKS // a processor that stands in for a device takes long
#endif

namespace firn::test
{

/// Where a test needs blocks of cells, but not those of space.
#if defined(FIRN_ON_PROCESSOR) && !defined(FIRN_TESTS_ALL)
using OfBlocks = Space<2, double>; // a block of cells in space takes a processor long
#else
using OfBlocks = Space<3, float>;
#endif

#if defined(__CUDACC__)
using Local = Cuda;
constexpr int most_ranks = 3;
/// The backend of a rank: of several devices each has its own.
inline Local local(int rank = 0)
{
    int devices = 1;
    static_cast<void>(cudaGetDeviceCount(&devices));
    return {.device = rank % std::max(devices, 1)};
}
#else
using Local = OpenMP;
constexpr int most_ranks = 5;
inline Local local(int = 0) { return {.threads = 1}; }
#endif
using Ranks = Distributed<Local, RankThreads>;
inline Ranks on(RankThreads const& communicator)
{
    return {.local = local(communicator.rank()), .communicator = communicator};
}
#if defined(__CUDACC__)
/// The same, with devices that copy from each other.
inline Distributed<Cuda, Peers> on_peers(RankThreads const& threads)
{
    Cuda const here = local(threads.rank());
    return {.local = here, .communicator = Peers(threads, here.device)};
}
#endif

/// How much of a scene's time is run, and of its size.
#if defined(FIRN_TESTS_FEW_OF_RANKS)
constexpr double part_of_time = 0.1, part_of_size = 0.5;
#else
constexpr double part_of_time = 1, part_of_size = 1;
#endif

/// Checks that a scene comes to the same numbers on so many ranks as without. `scene(backend)` returns them,
/// and `backend_of(communicator)` the backend of a rank.
template <class Scene, class BackendOf>
void require_same_on_ranks(std::vector<int> const& numbers, Scene const& scene, BackendOf const& backend_of)
{
    Numbers const alone = scene(local());
    REQUIRE(alone.size() > 100);
    for (int const ranks : numbers) {
        std::vector<std::size_t> different(std::size_t(ranks), 0);
        run_ranks(ranks, [&](RankThreads const& communicator) {
            Numbers const here = scene(backend_of(communicator));
            auto& count = different[std::size_t(communicator.rank())];
            count = here.size() == alone.size() ? 0 : 1;
            for (std::size_t i = 0; i < here.size() && i < alone.size(); ++i)
                if (!(exactly_equal(here[i], alone[i]) || (std::isnan(here[i]) && std::isnan(alone[i]))))
                    ++count;
        });
        for (std::size_t rank = 0; rank < different.size(); ++rank) {
            CAPTURE(ranks, rank);
            CHECK(different[rank] == 0);
        }
    }
}
/// The same on 1, 2, 3 and 5.
template <class Scene>
void require_same_on_any_ranks(Scene const& scene)
{
    std::vector<int> numbers{1, 2, 3, 5};
    std::erase_if(numbers, [](int ranks) { return ranks > most_ranks; });
    require_same_on_ranks(numbers, scene, on);
}

} // namespace firn::test
