// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/core/error.hpp>

TEST_CASE("an error says what is wrong, where, and what to do about it")
{
    firn::Error const error{"the density is -1", "Solver::add", "Pass a density above 0."};
    CHECK(error.what() == std::string{"the density is -1 [Solver::add]. Pass a density above 0."});
    CHECK(error.what_is_wrong() == "the density is -1");
    CHECK(error.where() == "Solver::add");
    CHECK(error.remedy() == "Pass a density above 0.");
}
