// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/snow_block.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <cmath>

using namespace firn;
using namespace firn::test;

namespace
{

/// What a stiff block does on a plane of 30 degrees, in steps in which a wave goes through so many cells.
struct ImplicitSlide
{
    double acceleration; ///< along the plane, from the momentum gained [m/s^2]
    double friction;     ///< tangential over normal reaction
    double normal;       ///< reaction over what the weight presses with
    double way;          ///< along the plane in the time that is measured [cells]
};

ImplicitSlide slide_implicitly(double friction, double cells_of_wave)
{
    constexpr double angle = M_PI / 6, g = 9.81, h = 0.04, young = 1e8;
    Solver<TestedBackend, NeoHookean<Plane>, QuadraticBSpline, Apic, Implicit> block(
        lattice(h), {.density = 1000, .elasticity = lame<double>(young, 0.3)});
    auto points = box_of_points<2>({0, 0}, {0.4, 0.2}, h);
    for (auto& x : points) x.y() += h / 2;
    block.add(points, h * h / 4);
    Obstacle<HalfSpace> const plane{.contact = Contact::coulomb(friction)};
    Eigen::Vector3d const pull(g * std::sin(angle), -g * std::cos(angle), 0);
    double const dt = cells_of_wave * h / std::sqrt(block.model().elasticity.p_wave_modulus() / 1000);
    int const ramp = 10, then = 10, measured = 20;
    for (int i = 1; i <= ramp; ++i) block.step(dt, Gravity{pull * (double(i) / ramp)}, plane);
    block.steps(then, dt, Gravity{pull}, plane);
    Totals const before(block);
    Eigen::Vector3d received(0, 0, 0);
    for (auto const& report : block.steps(measured, dt, Gravity{pull}, plane))
        received += report.reactions[0].impulse;
    Totals const after(block);
    double const duration = measured * dt;
    return {(after.momentum.x() - before.momentum.x()) / after.mass / duration, received.x() / -received.y(),
            -received.y() / (after.mass * -pull.y() * duration), (after.centre.x() - before.centre.x()) / h};
}

/// A scene whose steps are implicit: see Scene.
struct ImplicitSnow
{
    using Model = Snow<Plane>;
    using Transfer = SteppedBy<Flip, ImplicitMidpoint>;
    using Backend = TestedBackend;
    using Space = Plane;
    using Solver = firn::Solver<Backend, Model, QuadraticBSpline, Flip, ImplicitMidpoint>;
};

/// Halves all velocities, which no contact does.
struct HalvesVelocities
{
    void validate() const {}
    template <class Number, int d>
    struct Action
    {
        template <Lane Real>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const&, Vector<Real, d> const& v) const
        {
            return v * Real(Number(0.5));
        }
    };
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const&) const
    {
        return {};
    }
};

} // namespace

// As in colliders, whose explicit block has to be one of PIC, since friction sets it flapping; implicit steps
// damp that.
TEST_CASE("a block on an incline slides and sticks by Coulomb's law in implicit steps of any length")
{
    for (double const cells_of_wave : {5.0, 30.0})
        for (double const mu : {0.0, 0.3, 0.5}) {
            CAPTURE(cells_of_wave, mu);
            auto const block = slide_implicitly(mu, cells_of_wave);
            double const exact = 9.81 * (std::sin(M_PI / 6) - mu * std::cos(M_PI / 6));
            CHECK(std::abs(block.acceleration - exact) <= 5e-3 * exact);
            CHECK(std::abs(block.friction - mu) <= 1e-4);
            CHECK(block.normal == Approx(1).epsilon(1e-3));
        }
    auto const stuck = slide_implicitly(0.7, 30);
    CHECK(std::abs(stuck.way) <= 1e-4);
    CHECK(stuck.friction == Approx(std::tan(M_PI / 6)).epsilon(2e-3));
}

// In 64 steps, in which it falls by 0.6 cells each at first, by the midpoint rule: backward Euler takes a
// part of the bounce (5 %), and a floor that held on to the snow would take all of it (9 %).
TEST_CASE("a block of snow bounces off a floor in implicit steps of 0.6 cells as in its fine run")
{
    SnowBlock<ImplicitSnow> block(32, 2, {Flip{0.95}, {}});
    double const dt = 0.6 * block.side / 32 / block.speed; // [s]
    for (int third = 0; third < 4; ++third) {
        block.solver.steps(16, dt, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::slip()});
        block.observe(3 * third + 2);
    }
    CHECK(block.solver.time() == Approx(block.duration));
    CHECK(block.error() * std::sqrt(3.0) <= 0.015); // four of twelve looks
    CHECK(block.most_gained() <= 0.01);
}

TEST_CASE("implicit steps refuse effects on velocities that are no contact, and settle those that let go")
{
    Solver<TestedBackend, NeoHookean<Plane>, QuadraticBSpline, Mls, Implicit> block(
        lattice(0.1), {.density = 1000, .elasticity = lame<double>(1e5, 0.3)});
    block.add(box_of_points<2>({0, 0}, {0.5, 0.5}, 0.1), 0.1 * 0.1 / 4);
    CHECK(refused([&] { block.step(1e-3, Gravity{}, HalvesVelocities{}); })
              .what_is_wrong()
              .find("touch as an obstacle does") != std::string::npos);
    CHECK(
        refused([&] { block.settle(Gravity{}, Obstacle<HalfSpace>{}); }).what_is_wrong().find("separates") !=
        std::string::npos);
}
