// SPDX-License-Identifier: MIT
#include "blocks.hpp"
#include "compare.hpp"
#include "encounters.hpp"

#include <firn/reference.hpp>

namespace firn::test::detail
{

/// Two bodies of two materials that slide into a corner of walls, and into one another.
template <class SceneType>
Outcome two_in_a_corner()
{
    using Body = Jelly<SceneType>;
    typename SceneType::Solver solver(lattice(Body::h));
    double const volume = std::pow(Body::h / 2, Body::d);
    solver.template add<Material<0>>(Body::points(0.1, 0.1), volume, Body::velocity());
    solver.template add<Material<1>>(Body::points(0.1, 4.6), volume, Body::velocity());
    Received<typename SceneType::Solver> received;
    for (int i = 0; i < Body::steps; ++i)
        received.add(solver.step(Body::dt, Gravity{}, ReflectingWall{.axis = 1}, ReflectingWall{.axis = 0}));
    auto result = outcome(solver, Body::rounding);
    received.tell(solver, result);
    auto const tell = [&](auto const& velocities) { // which are gathered once more after the step
        for (auto const& v : velocities)
            for (int a = 0; a < Body::d; ++a) result.x.push_back(0.01 * v[a] / Body::h);
    };
    tell(solver.template download<Velocity, Material<0>>());
    tell(solver.template download<Velocity, Material<1>>());
    return result;
}

/// Few scenes in which each loop of a backend, and each part of it, is needed.
template <class Backend>
std::vector<AgreementCase> reference_cases()
{
    using Two = Materials<NeoHookean<Plane>, FixedCorotated<Plane>>;
    using Touching = Bodies<NeoHookean<Plane>, FixedCorotated<Plane>>;
    return {
        {"disk, 3D float, neo-Hookean, quadratic, MLS",
         rotating_disk<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls, Backend>>},
        {"two materials in a corner, 2D double, cubic, FLIP",
         two_in_a_corner<Scene<Two, CubicBSpline, Flip, Backend>>},
        {"two bodies, 2D double, quadratic, MLS", collision<Scene<Touching, QuadraticBSpline, Mls, Backend>>},
        {"block, 2D double, neo-Hookean, quadratic, XPIC",
         vibrating_block<Scene<NeoHookean<Plane>, QuadraticBSpline, Xpic, Backend>>},
        {"block, 2D double, neo-Hookean, linear, APIC",
         vibrating_block<Scene<NeoHookean<Plane>, Linear, Apic, Backend>>}};
}

} // namespace firn::test::detail

TEST_CASE("plain loops take a scene to where threads and packs take it")
{
    using namespace firn::test;
    check_agreement(detail::reference_cases<firn::OpenMP>(), detail::reference_cases<firn::Reference>());
}
