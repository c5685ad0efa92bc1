// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

/// A stiff block on a plane of 30 degrees: its acceleration along the plane, the ratio of wall forces, and
/// the creep.
struct Slide
{
    double acceleration; ///< from the momentum gained in 0.3 s [m/s^2]
    double friction;     ///< tangential over normal reaction
    double creep;        ///< displacement along the plane over h, per second
};

/// Gravity is tilted while the plane lies along the axes, or the plane is tilted and gravity hangs straight
/// down.
template <class SceneType>
Slide slide(double friction, bool tilted_plane)
{
    double const degrees = M_PI / 180, angle = 30 * degrees, g = 9.81, h = tilted_plane ? 0.02 : 0.04;
    typename SceneType::Model material;
    material.elasticity = lame<typename SceneType::Number>(1e6, 0.3);
    typename SceneType::Solver solver(
        lattice(h, tilted_plane ? Eigen::Vector3d(0.004, 0.007, 0) : Eigen::Vector3d::Zero()), material);

    Eigen::Vector2d const along =
        tilted_plane ? Eigen::Vector2d(std::cos(angle), -std::sin(angle)) : Eigen::Vector2d(1, 0);
    Eigen::Vector2d const normal(-along.y(), along.x());
    auto points = box_of_points<2>({0, 0}, {0.4, 0.2}, h);
    for (auto& x : points) x = along * x.x() + normal * (x.y() + 0.5 * h);
    solver.add(points, h * h / 4);
    Obstacle<HalfSpace> const plane{.shape = {{normal.x(), normal.y(), 0}},
                                    .contact = Contact::coulomb(friction)};
    Eigen::Vector3d const pull = tilted_plane ? Eigen::Vector3d(0, -g, 0)
                                              : Eigen::Vector3d(g * std::sin(angle), -g * std::cos(angle), 0);

    // The load comes on smoothly; then the block slides until no node sticks any more.
    int const ramp = 20;
    for (int i = 1; i <= ramp; ++i) solver.advance(0.1 / ramp, Gravity{pull * (double(i) / ramp)}, plane);
    solver.advance(0.4, Gravity{pull}, plane);
    auto const velocity = [&] {
        Totals const now(solver);
        return now.momentum.dot(along) / now.mass;
    };
    auto const place = [&] { return Totals(solver).centre.dot(along); };
    double const v0 = velocity(), x0 = place(), duration = 0.3;
    auto const report = solver.advance(duration, Gravity{pull}, plane);
    Eigen::Vector2d const impulse = report.reactions[0].impulse.template head<2>();
    return {(velocity() - v0) / duration, impulse.dot(along) / -impulse.dot(normal),
            (place() - x0) / h / duration};
}

double expected(double friction)
{
    double const angle = M_PI / 6;
    return std::max(0.0, 9.81 * (std::sin(angle) - friction * std::cos(angle)));
}

} // namespace

// PIC, because an undamped elastic block that rubs on a rigid plane is set flapping by friction itself
// (measured here with APIC, MLS and FLIP: the normal force then swings by a tenth, and with it the
// acceleration); the rule is what is tested.
using Cases = Combinations<Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>,
                           More<Scene<NeoHookean<Plane>, CubicBSpline, Pic>,
                                Scene<SplitNeoHookean<PlaneFloat>, QuadraticBSpline, Pic>>>;

TEMPLATE_LIST_TEST_CASE("a block on an incline slides with g (sin - mu cos), and sticks above tan 30", "",
                        Cases)
{
    for (double mu : {0.0, 0.3, 0.5}) {
        auto const aligned = slide<TestType>(mu, false);
        CAPTURE(mu);
        CHECK(std::abs(aligned.acceleration - expected(mu)) <= 0.01 * expected(mu));
        CHECK(std::abs(aligned.friction - mu) <= 1e-3);
    }
    auto const stuck = slide<TestType>(0.6, false);
    CHECK(std::abs(stuck.creep) <= 1e-4);
}

TEMPLATE_LIST_TEST_CASE("so does a block on a plane that cuts the cells at an angle", "", Cases)
{
    for (double mu : {0.0, 0.3, 0.5}) {
        auto const tilted = slide<TestType>(mu, true);
        CAPTURE(mu);
        CHECK(std::abs(tilted.acceleration - expected(mu)) <= 0.03 * expected(mu));
        CHECK(std::abs(tilted.friction - mu) <= 1e-3);
    }
}
