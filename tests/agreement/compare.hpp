// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"
#include "scenes.hpp"

// How the outcomes of two backends are compared.
namespace firn::test
{

inline void check_agreement(std::string const& name, Outcome const& a, Outcome const& b)
{
    REQUIRE(a.x.size() == b.x.size());
    REQUIRE(!a.x.empty());
    REQUIRE(a.per_point == b.per_point);
    double sum = 0;
    for (std::size_t k = 0; k < a.x.size(); ++k) sum += (a.x[k] - b.x[k]) * (a.x[k] - b.x[k]);
    double const difference = std::sqrt(sum * a.per_point / double(a.x.size()));
    CAPTURE(name, difference);
    CHECK(difference <= a.tolerance);
}

inline void check_agreement(std::vector<AgreementCase> const& here, std::vector<AgreementCase> const& there)
{
    REQUIRE(here.size() == there.size());
    for (std::size_t i = 0; i < here.size(); ++i)
        check_agreement(here[i].name, here[i].run(), there[i].run());
}

} // namespace firn::test
