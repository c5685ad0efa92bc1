// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "encounters.hpp"

bool tests_need_a_device = true; // see main.cpp

using namespace firn::test;

namespace
{

void check_agreement(std::vector<AgreementCase> const& here, std::vector<AgreementCase> const& there)
{
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

} // namespace

TEST_CASE("a device takes a scene to where the processor takes it")
{
    check_agreement(openmp_cases(), cuda_cases());
}

TEST_CASE("so it does where bodies meet walls, shells, terrain, a body that they push, and one another")
{
    check_agreement(openmp_encounters(), cuda_encounters());
}
