// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/openmp.hpp>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <new>
#include <stdexcept>
#include <vector>

using namespace firn;

TEST_CASE("a team works on each index once, whatever its size and that of the chunks")
{
    int const threads = GENERATE(1, 2, 3, 16, 100), chunk = GENERATE(1, 4, 1000);
    for (int const count : {0, 1, 2, 5, 1000}) {
        std::vector<std::atomic<int>> visits(std::size_t(count) + 1);
        std::atomic<int> made = 0;
        openmp::share(threads, count, chunk, [&](int thread) {
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
    CHECK(order == std::vector<int>{4, 3, 2, 1, 0}); // whose part is empty helps the next one

    int const threads = GENERATE(1, 2, 3, 100), count = GENERATE(4, 5, 6);
    std::vector<std::atomic<int>> visits(8);
    openmp::share(threads, count, bounds, [&](int) { return [&](int i) { ++visits[std::size_t(i)]; }; });
    for (int i = 0; i < 8; ++i) CHECK(visits[std::size_t(i)] == (i < count ? 1 : 0));
}

TEST_CASE("threads have equal numbers of items, as nearly as blocks allow")
{
    int const threads = GENERATE(1, 2, 3, 7), crowd = GENERATE(0, 5000);
    openmp::Cells<float, 2, 4> cells(OpenMP{threads});
    std::vector<Coordinates<2>> places;
    for (int i = 0; i < 600; ++i) // 8 in each block
        for (int k = 0; k < 8; ++k) places.push_back({i / 20 * 8, i % 20 * 8 + k});
    for (int i = 0; i < crowd; ++i) places.push_back({80, 80}); // in one of them
    cells.insert(places, 0);
    auto const parts = cells.parts();
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
        openmp::share(threads, 100, 1, [&](int) { return [list = no_memory()](int) { (void)list; }; }),
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
    CHECK_THROWS_WITH(openmp::share(threads, 100, 3, make), "index 57");
    CHECK(alive == 0);
}

TEST_CASE("a team that stays together does one loop after another, and what is thrown leaves it whole")
{
    int const threads = GENERATE(1, 2, 5);
    std::atomic<long> sum = 0;
    auto const add = [&](int count) {
        openmp::share(threads, count, 1, [&](int) { return [&](int i) { sum += i; }; });
    };
    openmp::detail::Team::together(threads, [&] {
        for (int loop = 0; loop < 1000; ++loop) add(loop % 10);
        openmp::detail::Team::together(threads, [&] { add(10); }); // one within another is the same one
        CHECK_THROWS_WITH(openmp::share(threads, 100, 1,
                                        [&](int) {
                                            return [](int i) {
                                                if (i == 57) throw std::runtime_error("index 57");
                                            };
                                        }),
                          "index 57");
        add(10);
    });
    CHECK(sum == 100 * (0 + 0 + 1 + 3 + 6 + 10 + 15 + 21 + 28 + 36) + 45 + 45);
    CHECK_THROWS_WITH(openmp::detail::Team::together(threads,
                                                     [&] {
                                                         add(3);
                                                         throw std::runtime_error("between loops");
                                                     }),
                      "between loops");
    sum = 0;
    add(10); // without a team that stays
    CHECK(sum == 45);
}

TEST_CASE("a loop within a loop is done by the thread that comes to it")
{
    int const threads = GENERATE(1, 2, 5);
    std::atomic<long> sum = 0;
    openmp::share(threads, 1000, 1, [&](int) {
        return [&](int i) {
            openmp::share(threads, 10, 1, [&](int) { return [&, i](int k) { sum += i * 10 + k; }; });
        };
    });
    CHECK(sum == 9999L * 10000 / 2);
}

TEST_CASE("a loop within a team has no more threads than it asks for")
{
    openmp::detail::Team::together(5, [&] {
        std::atomic<int> largest = 0;
        openmp::share(2, 1000, 1, [&](int thread) {
            if (thread >= 2) largest = thread;
            return [](int) {};
        });
        CHECK(largest == 0);
        CHECK(OpenMP{}.thread_count() == 5); // whatever OpenMP would give to a region within
    });
    CHECK(openmp::threads_for(0, 4) == 1);
    CHECK(openmp::threads_for(openmp::items_per_thread, 4) == 1);
    CHECK(openmp::threads_for(2 * openmp::items_per_thread, 4) == 2);
    CHECK(openmp::threads_for(1000 * openmp::items_per_thread, 4) == 4);
}

TEST_CASE("what a thread works with is its own, one object of each type, and the same in the next loop")
{
    openmp::Kept kept;
    kept.for_threads(2);
    auto& first = kept.of<std::vector<int>>(0);
    first.push_back(7);
    kept.of<std::vector<long>>(0);
    CHECK(kept.of<std::vector<int>>(1).empty());
    kept.for_threads(3);
    CHECK(&kept.of<std::vector<int>>(0) == &first);
    CHECK(kept.of<std::vector<int>>(0) == std::vector<int>{7});
    CHECK(kept.of<std::vector<long>>(0).empty());
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
