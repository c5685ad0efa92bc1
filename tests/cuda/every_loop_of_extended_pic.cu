// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

TEST_CASE("a few steps through the loops of extended PIC and of two materials")
{
    using Solver = Scene<Materials<NeoHookean<Plane>, FixedCorotated<Plane>>, QuadraticBSpline, Xpic>::Solver;
    double const h = 0.05;
    Solver solver(lattice(h), {}, Xpic{.order = 3});
    Obstacle<HalfSpace> const floor{.contact = Contact::coulomb(0.4)};
    solver.add<Material<0>>(ball_of_points<2>({0.213, 0.213}, 0.2, h), h * h / 4, {0, -20});
    for (int i = 0; i < 5; ++i) solver.step(5e-5, Gravity{}, floor);
    solver.add<Material<1>>(ball_of_points<2>({0.813, 0.213}, 0.2, h), h * h / 4, {-20, 0});
    std::size_t const all = solver.size();
    solver.steps(20, 5e-5, Gravity{}, floor);
    CHECK(solver.advance(1e-3, Gravity{}, floor).substeps > 0);
    auto const x = solver.positions();
    CHECK(x.size() == all);
    for (auto const& each : x) CHECK(each.allFinite());
}
