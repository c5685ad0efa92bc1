// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/firn.hpp>
#include <firn/openmp.hpp>

#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

using namespace firn;

TEST_CASE("a team works on each index once, whatever its size and that of the chunks")
{
    int const threads = GENERATE(1, 2, 3, 16, 100), chunk = GENERATE(1, 4, 1000);
    for (int const count : {0, 1, 2, 5, 1000}) {
        std::vector<std::atomic<int>> visits(std::size_t(count) + 1);
        std::atomic<int> made = 0;
        openmp::parallel_for(threads, count, chunk, [&](int thread) {
            ++made;
            if (thread < 0 || thread >= threads) throw std::logic_error("a thread of no team");
            return [&](int i) { ++visits[std::size_t(i)]; };
        });
        for (int i = 0; i < count; ++i) CHECK(visits[std::size_t(i)] == 1);
        CHECK(visits[std::size_t(count)] == 0);
        CHECK((made >= 1 && made <= threads));
    }
}

TEST_CASE("a thread begins with the part that was its own before, and then helps others from behind")
{
    std::vector<int> order;
    auto const note = [&](int i) { order.push_back(i); };
    // Three threads have the chunks 0 1, then 2 3 and 4 5, then 6 7 and 8.
    openmp::detail::SharedIndices indices(9, 2, 3);
    indices.for_each<int>(1, 3, note);
    CHECK(order == std::vector<int>{2, 3, 4, 5, 8, 6, 7, 0, 1});
    order.clear();
    indices.for_each<int>(0, 3, note);
    CHECK(order.empty());
}

TEST_CASE("parts of threads may have bounds of their own, which count if they are for this loop")
{
    std::vector<int> order;
    std::vector<std::uint32_t> const bounds{0, 1, 1, 5};
    openmp::detail::SharedIndices indices(bounds);
    auto const note = [&](int i) { order.push_back(i); };
    indices.for_each<int>(1, 3, note);
    CHECK(order == std::vector<int>{4, 3, 2, 1, 0}); // a thread with an empty part helps the next one

    int const threads = GENERATE(1, 2, 3, 100), count = GENERATE(4, 5, 6);
    std::vector<std::atomic<int>> visits(8);
    openmp::parallel_for(threads, count, bounds,
                         [&](int) { return [&](int i) { ++visits[std::size_t(i)]; }; });
    for (int i = 0; i < 8; ++i) CHECK(visits[std::size_t(i)] == (i < count ? 1 : 0));
}

TEST_CASE("threads have equal numbers of items, as nearly as blocks allow")
{
    int const threads = GENERATE(1, 2, 3, 7), crowd = GENERATE(0, 5000);
    openmp::CellOrder<float, 2, 4> cells(OpenMP{threads});
    std::vector<Coordinates<2>> places;
    for (int i = 0; i < 600; ++i) // 8 in each block
        for (int k = 0; k < 8; ++k) places.push_back({i / 20 * 8, i % 20 * 8 + k});
    for (int i = 0; i < crowd; ++i) places.push_back({80, 80}); // in one of them
    cells.insert(places.data(), places.size(), 0);
    auto const parts = cells.partitions();
    REQUIRE(parts.size() == std::size_t(threads) + 1);
    CHECK(parts.front() == 0);
    CHECK(parts.back() == cells.blocks().size());
    double const fair = double(places.size()) / threads;
    for (int part = 0; part + 1 < threads; ++part) {
        auto const end = parts[std::size_t(part) + 1];
        std::size_t items = 0;
        for (std::size_t b = 0; b < end; ++b) items += cells.blocks()[b].end - cells.blocks()[b].begin;
        CHECK(std::abs(double(items) - fair * (part + 1)) <= (crowd + 8) / 2.0);
    }
}

TEST_CASE("what a thread of a team throws is thrown by the team, and what others made is gone")
{
    int const threads = GENERATE(1, 2, 5);
    auto const no_memory = [&]() -> std::vector<int> { throw std::bad_alloc(); };
    CHECK_THROWS_AS(
        openmp::parallel_for(threads, 100, 1, [&](int) { return [list = no_memory()](int) { (void)list; }; }),
        std::bad_alloc);
    std::atomic<int> alive = 0;
    struct Counted
    {
        std::atomic<int>* of;
        explicit Counted(std::atomic<int>& count) : of(&count) { ++count; }
        ~Counted() { --*of; }
    };
    auto const make = [&](int) {
        return [own = std::make_unique<Counted>(alive)](int i) {
            if (i == 57) throw std::runtime_error("index 57");
        };
    };
    CHECK_THROWS_WITH(openmp::parallel_for(threads, 100, 3, make), "index 57");
    CHECK(alive == 0);
}

TEST_CASE("one loop after another is done by threads that stay, and what is thrown leaves them whole")
{
    int const threads = GENERATE(1, 2, 5);
    std::atomic<long> sum = 0;
    auto const add = [&](int count) {
        openmp::parallel_for(threads, count, 1, [&](int) { return [&](int i) { sum += i; }; });
    };
    for (int loop = 0; loop < 1000; ++loop) add(loop % 10);
    CHECK_THROWS_WITH(openmp::parallel_for(threads, 100, 1,
                                           [&](int) {
                                               return [](int i) {
                                                   if (i == 57) throw std::runtime_error("index 57");
                                               };
                                           }),
                      "index 57");
    add(10);
    CHECK(sum == 100 * (0 + 0 + 1 + 3 + 6 + 10 + 15 + 21 + 28 + 36) + 45);
}

TEST_CASE("a loop within a loop is done by the thread that comes to it")
{
    int const threads = GENERATE(1, 2, 5);
    std::atomic<long> sum = 0;
    openmp::parallel_for(threads, 1000, 1, [&](int) {
        return [&](int i) {
            openmp::parallel_for(threads, 10, 1, [&](int) { return [&, i](int k) { sum += i * 10 + k; }; });
        };
    });
    CHECK(sum == 9999L * 10000 / 2);
}

TEST_CASE("a loop has no more threads than it asks for, whatever loops before it had")
{
    for (int const threads : {5, 2, 3, 1, 2}) {
        std::atomic<int> largest = 0;
        openmp::parallel_for(threads, 1000, 1, [&](int thread) {
            if (thread >= threads) largest = thread;
            return [](int) {};
        });
        CHECK(largest == 0);
    }
    CHECK(openmp::threads_for(0, 4) == 1);
    CHECK(openmp::threads_for(openmp::items_per_thread, 4) == 1);
    CHECK(openmp::threads_for(2 * openmp::items_per_thread, 4) == 2);
    CHECK(openmp::threads_for(1000 * openmp::items_per_thread, 4) == 4);
}

TEST_CASE("a loop within a parallel region of the host's own has one thread, as OpenMP's would have")
{
    std::atomic<int> others = 0, sum = 0;
#pragma omp parallel num_threads(3)
    openmp::parallel_for(4, 1000, 1, [&](int thread) {
        if (thread > 0) ++others;
        return [&](int) { ++sum; };
    });
    CHECK(others == 0);
    CHECK(sum % 1000 == 0);
    CHECK(sum > 0);
}

TEST_CASE("a child of fork() has threads of its own, and a program may end within a loop")
{
    // a child of fork() has none of its parent's threads, and makes its own
    std::atomic<int> sum = 0;
    auto const count = [&] {
        openmp::parallel_for(4, 1000, 1, [&](int) { return [&](int) { ++sum; }; });
        return sum.exchange(0);
    };
    REQUIRE(count() == 1000);
    auto const status_of = [](auto const& work) { // of a child that does it; SIGKILL if it hangs
        pid_t const child = fork();
        REQUIRE(child >= 0);
        if (child == 0) _exit(work());
        int status = -1;
        for (int waits = 0; waits < 5000 && waitpid(child, &status, WNOHANG) == 0; ++waits)
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        if (status == -1) kill(child, SIGKILL), waitpid(child, &status, 0);
        return status;
    };
    CHECK(status_of([&] { return count() == 1000 && count() == 1000 ? 0 : 1; }) == 0);
    CHECK(WEXITSTATUS(status_of([&] { // while others are at work
              openmp::parallel_for(4, 1000, 1, [&](int thread) {
                  return [thread](int) {
                      if (thread == 0) std::exit(7);
                      std::this_thread::sleep_for(std::chrono::milliseconds(1));
                  };
              });
              return 0;
          })) == 7);
    CHECK(count() == 1000);
}

TEST_CASE("threads that others wait for are left out where loops are slower for it, and only there")
{
    using openmp::detail::Efficiency;
    constexpr double us = 1e-6, ms = 1e-3; // in s
    Efficiency of_two;
    CHECK_FALSE(of_two.is_low());
    for (int i = 0; i < 100; ++i) of_two.add(2, 100 * us, 5 * us, 0.5); // as it should be
    CHECK_FALSE(of_two.is_low());
    of_two.add(2, 100 * us, 1 * ms, 0.5); // something came between, once
    CHECK_FALSE(of_two.is_low());
    of_two.add(2, 100 * us, 4 * ms, 0.5);
    of_two.add(2, 150 * us, 4 * ms, 0.75);
    CHECK(of_two.is_low());

    Efficiency of_large_loops; // a thread that lost its core: the leader does what it would have done
    for (int i = 0; i < 5; ++i) of_large_loops.add(2, 60 * ms, 4 * ms, 0.75);
    CHECK_FALSE(of_large_loops.is_low());

    Efficiency of_sixteen;
    for (int i = 0; i < 100; ++i) of_sixteen.add(16, 100 * us, 10 * us, 1.0 / 16);
    CHECK_FALSE(of_sixteen.is_low());
    for (int i = 0; i < 4; ++i) of_sixteen.add(16, 100 * us, 2 * ms, 1.0 / 16);
    CHECK(of_sixteen.is_low());
}

TEST_CASE("a thread that lost its core tries again after a pause, which doubles while that goes wrong")
{
    using openmp::detail::Bench;
    Bench bench;
    double now = openmp::detail::clock_time();
    CHECK_FALSE(bench.is_on());
    CHECK_FALSE(bench.is_to_try(now));
    bench.sit(now);
    CHECK(bench.is_on());
    for (auto pause = Bench::shortest; pause < Bench::longest; pause *= 2) {
        CHECK_FALSE(bench.is_to_try(now + pause - pause / 100));
        CHECK(bench.is_to_try(now += pause));
        CHECK_FALSE(bench.is_to_try(now));
    }
    CHECK(bench.is_to_try(now += Bench::longest));
    CHECK_FALSE(bench.is_to_try(now + Bench::longest / 2)); // it grows no further
    bench.leave(now);
    CHECK_FALSE(bench.is_on());
    bench.sit(now += Bench::longest); // it failed soon: the long pause
    CHECK_FALSE(bench.is_to_try(now + Bench::longest / 2));
    bench.leave(now += Bench::longest);
    bench.sit(now += 10 * Bench::longest); // it went well for long: a short one
    CHECK(bench.is_to_try(now + Bench::shortest));
}

TEST_CASE("a host's own threads do the loops in place of OpenMP's, in whatever order they do jobs")
{
    std::vector<std::thread::id> of_jobs;
    std::mutex mutex;
    auto const on_threads = [&](int count, auto const& job) { // a thread for each job
        std::vector<std::thread> threads;
        for (int i = 0; i < count; ++i)
            threads.emplace_back([&, i] {
                job(i);
                std::scoped_lock const lock(mutex);
                of_jobs.push_back(std::this_thread::get_id());
            });
        for (auto& thread : threads) thread.join();
    };
    auto const backwards = [](int count, auto const& job) {
        for (int i = count - 1; i >= 0; --i) job(i);
    };
    for (Executor const& executor : {Executor(on_threads), Executor(backwards)}) {
        openmp::Threads const threads(3, executor);
        std::vector<std::atomic<int>> visits(1000);
        openmp::parallel_for(threads, 1000, 7, [&](int) {
            return [&](int i) {
                ++visits[std::size_t(i)];
                openmp::parallel_for(threads, 1, 1, [&](int) { return [](int) {}; }); // one within it
            };
        });
        for (auto const& visit : visits) CHECK(visit == 1);
        CHECK_THROWS_WITH(openmp::parallel_for(threads, 100, 1,
                                               [](int) {
                                                   return [](int i) {
                                                       if (i == 57) throw std::runtime_error("index 57");
                                                   };
                                               }),
                          "index 57");
    }
    CHECK(of_jobs.size() == 6);

    auto const forgetful = [](int count, auto const& job) {
        for (int i = 0; i + 1 < count; ++i) job(i);
    };
    CHECK_THROWS_AS(
        openmp::parallel_for(openmp::Threads(3, forgetful), 100, 1, [](int) { return [](int) {}; }), Error);
    CHECK_FALSE(Executor());
    CHECK_FALSE(Executor(std::function<void(int, Executor::Job const&)>())); // none, too
}

TEST_CASE("a solver comes to the same bits on OpenMP's threads and on the host's")
{
    std::atomic<int> loops = 0;
    auto const last = [&](OpenMP const& backend) {
        Solver<OpenMP, NeoHookean<Space<2, float>>> solver(lattice(0.1), {}, {}, {}, backend);
        std::vector<Eigen::Vector2d> points;
        for (int i = 0; i < 4000; ++i) points.emplace_back(0.05 * (i % 80), 0.05 * (i / 80) + 0.02);
        solver.add(points, 0.0025, {0, -1});
        solver.steps(20, 1e-3, Gravity{}, Obstacle<HalfSpace>{});
        return solver.positions();
    };
    auto const alone = last({.threads = 1});
    CHECK((last({.threads = 3}) == alone)); // not to be printed
    CHECK((last({.threads = 3, .executor = [&](int count, auto const& job) {
                     ++loops;
                     std::vector<std::thread> threads;
                     for (int i = 0; i < count; ++i) threads.emplace_back([&, i] { job(i); });
                     for (auto& thread : threads) thread.join();
                 }}) == alone));
    CHECK(loops > 40);
}

TEST_CASE("what a thread works with is its own, one object of each type, and the same in the next loop")
{
    openmp::Workspace workspace;
    workspace.for_threads(2);
    auto& first = workspace.of<std::vector<int>>(0);
    first.push_back(7);
    workspace.of<std::vector<long>>(0);
    CHECK(workspace.of<std::vector<int>>(1).empty());
    workspace.for_threads(3);
    CHECK(&workspace.of<std::vector<int>>(0) == &first);
    CHECK(workspace.of<std::vector<int>>(0) == std::vector<int>{7});
    CHECK(workspace.of<std::vector<long>>(0).empty());
}

TEMPLATE_TEST_CASE_SIG("the key of a block is that of no other, in the order of coordinates, and leads back",
                       "", ((int d), d), 2, 3)
{
    long const end = d == 3 ? 1L << 20 : 1L << 31;
    std::vector<int> places;
    for (long const place : {-end, -end + 1, -2L, -1L, 0L, 1L, 2L, 77L, end - 1})
        places.push_back(int(place));
    std::vector<Coordinates<d>> blocks; // in the order of coordinates
    for (int const x : places)
        for (int const y : places)
            if constexpr (d == 2)
                blocks.push_back({x, y});
            else
                for (int const z : places) blocks.push_back({x, y, z});
    for (std::size_t b = 0; b < blocks.size(); ++b) {
        std::uint64_t const key = block_key<d>(blocks[b]);
        CHECK(block_of_key<d>(key) == blocks[b]);
        CHECK(openmp::is_same_block<d>(block_of_key<d>(key), blocks[b]));
        if (b == 0) continue;
        CHECK(block_key<d>(blocks[b - 1]) < key);
        CHECK_FALSE(openmp::is_same_block<d>(blocks[b - 1], blocks[b]));
    }
}
