// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/core/access_guard.hpp>

#include <atomic>

TEST_CASE("an error says what is wrong, where, and what to do about it")
{
    firn::Error const error{"the density is -1", "Solver::add", "Pass a density above 0."};
    CHECK(error.what() == std::string{"the density is -1 [Solver::add]. Pass a density above 0."});
    CHECK(error.what_is_wrong() == "the density is -1");
    CHECK(error.where() == "Solver::add");
    CHECK(error.remedy() == "Pass a density above 0.");
}

TEST_CASE("after a call that broke off in the middle all others are refused, and told why")
{
    firn::detail::AccessGuard<std::atomic<int>> entrance;
    CHECK_NOTHROW(entrance.write("Solver::step"));
    firn::Error const why{"memory is short", "cudaMalloc", "Free memory."};
    entrance.break_off(&why);
    CHECK_THROWS_WITH(entrance.write("Solver::step"), Contains("broke off") && Contains("memory is short") &&
                                                          Contains("Solver::step") &&
                                                          Contains("Free memory."));
    CHECK_THROWS_WITH(entrance.read("Solver::positions"), Contains("Solver::positions"));
    auto const moved = std::move(entrance);
    CHECK_THROWS_WITH(moved.read("Solver::positions"), Contains("memory is short"));
    CHECK_THROWS_WITH(entrance.read("Solver::positions"), Contains("moved to another"));
    entrance = {};
    CHECK_NOTHROW(entrance.read("Solver::positions"));
    firn::detail::AccessGuard<std::atomic<int>> unexplained;
    unexplained.break_off(nullptr);
    CHECK_THROWS_WITH(unexplained.read("Solver::positions"),
                      Contains("no memory left, or what it was given"));
}
