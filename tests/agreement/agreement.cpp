// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "scenes.hpp"

bool tests_need_a_device = true; // see main.cpp

using namespace firn::test;

TEST_CASE("a device takes a scene to where the processor takes it")
{
    auto const here = openmp_cases(), there = cuda_cases();
    REQUIRE(here.size() == there.size());
    for (std::size_t i = 0; i < here.size(); ++i) {
        auto const a = here[i].run(), b = there[i].run();
        REQUIRE(a.x.size() == b.x.size());
        REQUIRE(!a.x.empty());
        double sum = 0;
        for (std::size_t k = 0; k < a.x.size(); ++k) sum += (a.x[k] - b.x[k]) * (a.x[k] - b.x[k]);
        double const difference = std::sqrt(sum / double(a.x.size()));
        CAPTURE(here[i].name, difference);
        CHECK(difference <= a.tolerance);
    }
}
