// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/column.hpp"
#include "problems/disks.hpp"

#include <algorithm>

using namespace firn;
using namespace firn::test;

namespace
{

/// What becomes of two disks that collide: cases 7.7 of the validation suite (after Sulsky et al. 1994).
struct Collision
{
    double kinetic = 0;          ///< kinetic energy at the end, of that at the start
    double least_kinetic = 1;    ///< the least on the way
    double least_at = 0;         ///< when [s]
    double largest_energy = 0;   ///< kinetic and elastic, of the kinetic one at the start
    double largest_momentum = 0; ///< [kg m/s per metre of depth]
    double angular_change = 0;   ///< largest, of the angular momentum, of that at the start
};

/// `aside` is a velocity across the diagonal, and back for the other disk: they meet off their centres [m/s].
template <class SceneType>
Collision collide(typename SceneType::Transfer const& transfer = {}, double aside = 0)
{
    CollidingDisks<SceneType> disks(40, 2, transfer);
    auto v = disks.solver.template download<Velocity>();
    for (auto& of : v) of += Eigen::Vector2d(aside, -aside) * (of.x() > 0 ? 1 : -1);
    disks.solver.template upload<Velocity>(v);
    Eigen::Vector2d momentum;
    double const start = disks.kinetic_energy(momentum), turning = Totals(disks.solver).angular_momentum;
    Collision result;
    for (int frame = 0; frame < 72; ++frame) {
        disks.solver.advance(0.05);
        result.kinetic = disks.kinetic_energy(momentum) / start;
        result.largest_energy =
            std::max(result.largest_energy, result.kinetic + disks.elastic_energy() / start);
        result.largest_momentum = std::max(result.largest_momentum, momentum.norm());
        if (aside != 0)
            result.angular_change = std::max(result.angular_change,
                                             std::abs(Totals(disks.solver).angular_momentum / turning - 1));
        if (result.kinetic < result.least_kinetic) {
            result.least_kinetic = result.kinetic;
            result.least_at = disks.solver.time();
        }
    }
    return result;
}

/// How far the top of a column sinks under its own weight [m], and the error of its stress.
template <class SceneType>
std::pair<double, double> settle(int cells)
{
    Column<SceneType> column(cells);
    column.advance(0);
    column.observe(0);
    return {column.tip(), column.error()};
}

} // namespace

TEST_CASE("two elastic disks collide and part with most of their energy, and with their momentum")
{
    using Fast = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    using Affine = Scene<NeoHookean<Plane>, QuadraticBSpline, Apic>;
    using Lively = Scene<NeoHookean<Plane>, QuadraticBSpline, Flip>;
    auto const check = [](Collision const& disks, double kept) {
        CHECK(disks.kinetic == Approx(kept).margin(0.03));
        CHECK(disks.least_kinetic < 0.5);
        CHECK(disks.least_at > 1.5); // they touch at about 1 s
        CHECK(disks.least_at < 2.5);
        CHECK(disks.largest_energy <= 1.01);
        CHECK(disks.largest_momentum <= 1e-12);
    };
    check(collide<Fast>(), 0.87);
    check(collide<Affine>(), 0.86);
    check(collide<Lively>(Flip{.fraction = 1}), 0.90);
    using Lossy = Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>;
    CHECK(collide<Lossy>().kinetic < 0.65); // it loses what it should keep

    // off their centres they turn about one another
    for (auto const& disks : {collide<Fast>({}, 0.02), collide<Affine>({}, 0.02)}) {
        CHECK(disks.angular_change <= 1e-12);
        CHECK(disks.largest_momentum <= 1e-12);
    }
    CHECK(collide<Lively>(Flip{.fraction = 1}, 0.02).angular_change > 1e-6);
    CHECK(collide<Lossy>({}, 0.02).angular_change > 0.01);
}

TEST_CASE("an elastic column under its own weight has the stress of equilibrium and the height of its law")
{
    using Mild = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
    auto const [tip, error] = settle<Mild>(16);
    CHECK(tip == Approx(-0.03485531).epsilon(1e-3));
    CHECK(error <= 0.01);
    CHECK(settle<Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>>(16).first ==
          Approx(-0.03643714).epsilon(1e-3));
    CHECK(settle<Scene<Hencky<Plane>, QuadraticBSpline, Mls>>(16).first == Approx(-0.03401370).epsilon(1e-3));
    // the error of stress falls with the cell size
    CHECK(settle<Mild>(8).second > 1.5 * error);
}
