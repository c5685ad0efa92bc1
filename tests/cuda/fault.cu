// SPDX-License-Identifier: MIT
// In a program of its own: after a fault the device serves the process no more.
#include "catch.hpp"
#include "support/policies.hpp"

bool tests_need_a_device = true; // see main.cpp

using namespace firn;
using namespace firn::test;

/// An effect with a mistake in it.
struct Astray
{
    void validate() const {}

    template <class Number>
    struct Action
    {
        Number* nowhere;

        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const&,
                                                 Vector<Real, d> const& velocity) const
        {
            return velocity * *nowhere;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number> over(Interval const&) const
    {
        return {reinterpret_cast<Number*>(16)};
    }
};

TEST_CASE("a fault in a loop is an error with the call's name, and so is every step after it")
{
    Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver solver(lattice(0.05));
    solver.add(box_of_points<3>({0, 0, 0}, {0.2, 0.2, 0.2}, 0.05), std::pow(0.025, 3));
    solver.step(1e-4);
    for (int i = 0; i < 2; ++i) {
        try {
            if (i == 0)
                solver.step(1e-4, Astray{});
            else
                solver.step(1e-4);
            FAIL("nothing was refused");
        }
        catch (Error const& error) {
            std::string const what = error.what_is_wrong();
            CHECK(what.find(" failed: ") != std::string::npos);
            CHECK(what.find(" failed: ") > 0); // before it the call's name
            if (i == 1) CHECK_THAT(what, StartsWith("a call before broke off in the middle: "));
            CHECK_THAT(error.remedy(), Contains("new process"));
        }
    }
}
