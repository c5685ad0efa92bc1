// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/refused.hpp"
#include "support/threads.hpp"

#include <firn/effects/shapes/cylinder.hpp>
#include <firn/effects/shapes/half_space.hpp>
#include <firn/effects/shapes/shell.hpp>
#include <firn/effects/shapes/union.hpp>
#include <firn/sampling/fill.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <span>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

constexpr std::array patterns{Pattern::lattice, Pattern::jittered, Pattern::poisson_disk};

/// A ball of which only the surface is known.
struct UnknownBall
{
    double reach() const { return 0.9; } // more than need be

    template <Lane Real, int d>
    SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        return Sphere{0.5}.surface<Real, d>(x);
    }
};

/// A solid with an inside-test of its own, as a mesh has.
struct Wedge
{
    template <class Loop>
    std::vector<char> contains(std::span<Eigen::Vector3d const> points, Loop const& loop) const
    {
        std::vector<char> inside(points.size());
        loop.for_each(points.size(), [&](std::size_t i) {
            auto const& x = points[i];
            inside[i] = (x.array() > 0).all() && (x.array() < 1).all() && x.x() + x.y() < 1;
        });
        return inside;
    }
    double volume() const { return 0.5; }
    Eigen::AlignedBox3d bounding_box() const { return {Eigen::Vector3d::Zero(), Eigen::Vector3d::Ones()}; }
};

/// Fills a shape by each pattern: all points are inside, their number is that of the volume, and volumes add
/// up.
template <int d, class ShapeType>
void check_filled(ShapeType const& shape, double volume, double spacing, double rounding = 1e-12)
{
    for (Pattern const pattern : patterns) {
        auto const filled = fill<d>(shape, {.spacing = spacing, .pattern = pattern});
        auto const count = double(filled.points.size());
        CHECK(count * filled.volume_per_point == Approx(volume).epsilon(rounding));
        CHECK(filled.volume_per_point == Approx(std::pow(spacing, d)).epsilon(0.06));
        for (auto const& x : filled.points)
            REQUIRE(firn::detail::distance_from<d>(firn::detail::plain(shape), x) < 0);
    }
}

} // namespace

TEST_CASE("shapes are filled in the plane and in space, and the volumes of the points are the shape's")
{
    using std::numbers::pi;
    check_filled<2>(Box{{0.5, 0.25, 1}}, 0.5, 0.02);
    check_filled<3>(Box{{0.5, 0.25, 0.3}}, 0.3, 0.04);
    check_filled<2>(Sphere{0.5}, pi / 4, 0.02);
    check_filled<3>(Sphere{0.5}, pi / 6, 0.04);
    check_filled<2>(Cylinder{0.2, 0.5}, 0.4, 0.02);
    check_filled<3>(Cylinder{0.2, 0.5}, pi * 0.04, 0.03);
    check_filled<2>(Capsule{0.2, 0.3}, 0.24 + pi * 0.04, 0.02);
    check_filled<3>(Capsule{0.2, 0.3}, pi * 0.04 * 0.6 + 4 * pi / 3 * 0.008, 0.03);
    check_filled<2>(UnknownBall{}, pi / 4, 0.02, 1e-4); // measured
    check_filled<3>(UnknownBall{}, pi / 6, 0.04, 1e-3);
    Union<Box, Box> const cross{{{.shape = {{0.5, 0.1, 0.1}}}, {.shape = {{0.1, 0.5, 0.1}}}}};
    check_filled<2>(cross, 0.36, 0.02, 2e-3);
    for (Pattern const pattern : patterns) {
        auto const wedge = fill<3>(
            Wedge{}, {.spacing = 0.05, .pattern = pattern, .pose = {.position = {2, 0, 0}}}, TwoThreads{});
        CHECK(double(wedge.points.size()) * wedge.volume_per_point == Approx(0.5).epsilon(1e-12));
        CHECK(wedge.volume_per_point == Approx(1.25e-4).epsilon(0.06));
        for (auto const& x : wedge.points) REQUIRE((x.x() > 2 && x.x() + x.y() < 3));
    }
}

TEST_CASE("a box whose sides are whole spacings is filled by its lattice alone, wherever it lies")
{
    auto const filled = fill<2>(Box{{0.5, 0.25, 1}}, {.spacing = 0.125, .pose = {.position = {3, 1, 0}}});
    REQUIRE(filled.points.size() == 32);
    CHECK(filled.volume_per_point == Approx(0.125 * 0.125).epsilon(1e-14));
    CHECK((filled.points.front() - Eigen::Vector2d(2.5625, 0.8125)).norm() <= 1e-14);
    CHECK((filled.points.back() - Eigen::Vector2d(3.4375, 1.1875)).norm() <= 1e-14);
    auto const turned = fill<3>(
        Box{{0.5, 0.25, 0.125}},
        {.spacing = 0.25,
         .pose = {.position = {0, 1, 0},
                  .orientation = Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()))}});
    REQUIRE(turned.points.size() == 8);
    CHECK((turned.points.front() - Eigen::Vector3d(0.125, 0.625, 0)).norm() <= 1e-14);
}

TEST_CASE(
    "jitter stays within its share of a cell, Poisson's points keep their distance, by one seed the same")
{
    Filling how{.spacing = 0.05, .pattern = Pattern::jittered, .jitter = 0.3, .seed = 5};
    Box const square{{0.5, 0.5, 1}};
    auto const jittered = fill<2>(square, how);
    how.pattern = Pattern::lattice;
    auto const regular = fill<2>(square, how);
    REQUIRE(jittered.points.size() == regular.points.size());
    double furthest = 0;
    for (std::size_t i = 0; i < regular.points.size(); ++i)
        furthest = std::max(furthest, (jittered.points[i] - regular.points[i]).cwiseAbs().maxCoeff());
    CHECK(furthest <= 0.15 * 0.05 * (1 + 1e-9));
    CHECK(furthest > 0.14 * 0.05);

    how.pattern = Pattern::poisson_disk;
    auto const apart = fill<2>(square, how);
    double closest = 1;
    for (std::size_t i = 0; i < apart.points.size(); ++i)
        for (std::size_t j = 0; j < i; ++j)
            closest = std::min(closest, (apart.points[i] - apart.points[j]).norm());
    CHECK(closest >= 0.81 * 0.05 * (1 - 1e-9));
    for (Pattern const pattern : patterns) {
        how.pattern = pattern;
        CHECK((fill<2>(square, how).points == fill<2>(square, how, TwoThreads{}).points));
        Filling other = how;
        other.seed = 6;
        CHECK((fill<2>(square, how).points == fill<2>(square, other).points) ==
              (pattern == Pattern::lattice));
    }
    // one of an earlier run, which all standard libraries must come to
    how = {.spacing = 0.25, .pattern = Pattern::jittered, .seed = 1};
    CHECK((fill<2>(square, how).points[3] - Eigen::Vector2d(0.391904, -0.426318)).norm() <= 2e-6);
}

TEST_CASE("a polygon is filled within its outline and around its holes")
{
    Polygon const frame({{0, 0}, {2, 0}, {2, 1}, {0, 1}},
                        {{{0.5, 0.25}, {0.5, 0.75}, {1.5, 0.75}, {1.5, 0.25}}});
    CHECK(frame.area() == Approx(1.5).epsilon(1e-15));
    CHECK(frame.contains({0.25, 0.5}));
    CHECK(!frame.contains({1, 0.5}));
    CHECK(!frame.contains({3, 0.5}));
    for (Pattern const pattern : patterns) {
        auto const filled = fill<2>(frame, {.spacing = 0.02, .pattern = pattern});
        CHECK(double(filled.points.size()) * filled.volume_per_point == Approx(1.5).epsilon(1e-12));
        CHECK(filled.volume_per_point == Approx(4e-4).epsilon(0.06));
        for (auto const& x : filled.points) REQUIRE(frame.contains(x));
    }
    // a star with reflex corners, far away: to the left or right of each edge
    Polygon::Loop star;
    for (int i = 0; i < 10; ++i)
        star.push_back({1000 + (i % 2 ? 0.4 : 1.0) * std::cos(i * M_PI / 5),
                        (i % 2 ? 0.4 : 1.0) * std::sin(i * M_PI / 5)});
    CHECK(Polygon(star).area() == Approx(10 * 0.5 * 0.4 * std::sin(M_PI / 5)).epsilon(1e-12));
    CHECK(Polygon(star).contains({1000, 0}));
    CHECK(!Polygon(star).contains({1000 + 0.6 * std::cos(M_PI / 5), 0.6 * std::sin(M_PI / 5)}));

    double const nan = std::numeric_limits<double>::quiet_NaN();
    refused([&] { Polygon(Polygon::Loop{{0, 0}, {1, 0}}); });
    refused([&] { Polygon(Polygon::Loop{{0, 0}, {1, nan}, {1, 1}}); });
    refused([&] { Polygon(Polygon::Loop{{0, 0}, {1, 1}, {1, 0}, {0, 1}}); });         // a bow tie
    refused([&] { Polygon(Polygon::Loop{{0, 0}, {2, 0}, {2, 2}, {1, 0}, {0, 2}}); }); // touches
    refused([&] { Polygon(Polygon::Loop{{0, 0}, {1, 0}, {0, 1}}, {{{1, 1}, {2, 1}}}); });
    refused([&] {
        Polygon(Polygon::Loop{{0, 0}, {1, 0}, {0, 1}}, {{{-1, -1}, {2, -1}, {2, 2}, {0.2, 0.2}}});
    });
}

TEST_CASE(
    "the surface of a cylinder is at its mantle and its ends, and its normal is the distance's gradient")
{
    Cylinder const cylinder{0.5, 1};
    CHECK(cylinder.surface<double, 3>({2, 0.5, 0}).distance == Approx(1.5));
    CHECK(cylinder.surface<double, 3>({0.1, 3, 0}).distance == Approx(2));
    CHECK(cylinder.surface<double, 3>({0, 0, 0.4}).distance == Approx(-0.1));
    CHECK(cylinder.surface<double, 3>({0, -0.95, 0}).distance == Approx(-0.05));
    CHECK(cylinder.surface<double, 3>({0, 2, 0}).normal.isApprox(Eigen::Vector3d(0, 1, 0)));
    CHECK(cylinder.surface<double, 2>({-0.7, 0}).normal.isApprox(Eigen::Vector2d(-1, 0)));
    std::mt19937 random(1);
    std::uniform_real_distribution<double> within(-1.5, 1.5);
    for (int i = 0; i < 300; ++i) {
        Eigen::Vector3d const x(within(random), within(random), within(random));
        auto const here = cylinder.surface<double, 3>(x);
        CHECK(here.normal.norm() == Approx(1));
        double const step = 1e-6;
        double const beyond = cylinder.surface<double, 3>(Eigen::Vector3d(x + step * here.normal)).distance;
        CHECK(beyond - here.distance == Approx(step).epsilon(1e-3));
    }
}

TEST_CASE("what cannot be filled is refused")
{
    double const nan = std::numeric_limits<double>::quiet_NaN();
    Box const box{{1, 1, 1}};
    for (double const spacing : {0.0, -1.0, nan, std::numeric_limits<double>::infinity()})
        refused([&] { (void)fill<2>(box, {.spacing = spacing}); });
    refused([&] { (void)fill<3>(box, {.spacing = 0.1, .pattern = Pattern::jittered, .jitter = 2}); });
    refused([&] { (void)fill<3>(box, {.spacing = 0.1, .pose = {.position = {nan, 0, 0}}}); });
    refused([&] { (void)fill<2>(box, {.spacing = 0.1, .pose = {.velocity = {0, 0, 1}}}); });
    refused([&] { (void)fill<3>(HalfSpace{}, {.spacing = 0.1}); });
    refused([&] { (void)fill<3>(Sphere{-1}, {.spacing = 0.1}); });
    refused([&] { (void)fill<3>(Cylinder{1, nan}, {.spacing = 0.1}); });
    refused([&] { (void)fill<3>(Cylinder{0, 1}, {.spacing = 0.1}); });
    refused([&] { (void)fill<3>(box, {.spacing = 1e-5}); });
}
