// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

bool tests_need_a_device = false; // see main.cpp

using namespace firn;
using namespace firn::test;

using Jelly = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;

TEST_CASE("a device that is not there is refused when a solver is made, with a driver and without")
{
    for (int device : {-1, 1000}) {
        try {
            Jelly const solver(lattice(0.1), {}, {}, {}, Cuda{.device = device});
            FAIL("device " << device << " was not refused");
        }
        catch (Error const& error) {
            CHECK(!error.what_is_wrong().empty());
            CHECK(error.where() == "Cuda");
            CHECK(!error.remedy().empty());
        }
    }
}

TEST_CASE("what there is fits in a sentence") { CHECK_THAT(cuda_info(), StartsWith("CUDA ")); }
