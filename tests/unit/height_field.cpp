// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include "support/test_lane.hpp"

#include <firn/effects/obstacle.hpp>
#include <firn/effects/shapes/half_space.hpp>
#include <firn/effects/shapes/height_field.hpp>

#include <random>

namespace
{

using Field2 = firn::HeightField<float, 2>;
using Field3 = firn::HeightField<double, 3>;
static_assert(firn::Shape<Field2, float, 2> && firn::Shape<Field3, double, 3>);
static_assert(firn::Shape<firn::HeightFieldView<float, 3>, float, 3>);

/// The terrain of a function of (x, z) on [-1, 1]².
template <class Height>
Field3 terrain(double spacing, Height const& height)
{
    int const count = int(std::lround(2 / spacing)) + 1;
    std::vector<double> heights;
    for (int k = 0; k < count; ++k)
        for (int i = 0; i < count; ++i) heights.push_back(height(-1 + i * spacing, -1 + k * spacing));
    return {{-1, -1}, spacing, {count, count}, std::move(heights)};
}

Eigen::Vector3d random_point(std::mt19937& random, double reach)
{
    std::uniform_real_distribution<double> within(-reach, reach);
    double const x = within(random), y = within(random), z = within(random);
    return {x, y, z};
}

double bumpy(double x, double z) { return 0.2 * std::sin(2 * x) * std::cos(3 * z); }

Eigen::Vector3d bumpy_normal(double x, double z)
{
    double const by_x = 0.4 * std::cos(2 * x) * std::cos(3 * z),
                 by_z = -0.6 * std::sin(2 * x) * std::sin(3 * z);
    return Eigen::Vector3d(-by_x, 1, -by_z).normalized();
}

/// The largest errors of height and normal on a bumpy terrain.
std::pair<double, double> worst_of_bumps(double spacing)
{
    auto const field = terrain(spacing, bumpy);
    std::mt19937 random(1);
    double height = 0, normal = 0;
    for (int i = 0; i < 4000; ++i) {
        Eigen::Vector3d x = random_point(random, 0.7);
        x.y() = bumpy(x.x(), x.z());
        auto const here = field.surface(x);
        height = std::max(height, std::abs(here.distance));
        normal = std::max(normal, (here.normal - bumpy_normal(x.x(), x.z())).norm());
    }
    return {height, normal};
}

} // namespace

TEST_CASE("a terrain that is a plane is a half-space, slopes along both axes and its border included")
{
    double const a = 0.7, b = -1.3, c = 0.2;
    auto const plane = terrain(0.25, [&](double x, double z) { return a * x + b * z + c; });
    Eigen::Vector3d const normal = Eigen::Vector3d(-a, 1, -b).normalized();
    firn::HalfSpace const same{normal};
    std::mt19937 random(2);
    for (int i = 0; i < 2000; ++i) {
        Eigen::Vector3d const x = random_point(random, 1);
        auto const here = plane.surface(x);
        auto const there = same.surface<double, 3>(Eigen::Vector3d(x - Eigen::Vector3d(0, c, 0)));
        REQUIRE(here.distance == Approx(there.distance).margin(1e-14));
        REQUIRE((here.normal - there.normal).norm() <= 1e-13);
    }
}

TEST_CASE("in the plane of two dimensions the ground is the x axis")
{
    Field2 const slope({-1}, 0.5f, {5}, {0, 1, 2, 3, 4}); // y = 2 (x + 1)
    auto const here = slope.surface({0.3f, 2.6f + std::sqrt(5.0f)});
    CHECK(here.distance == Approx(1).epsilon(1e-6));
    CHECK((here.normal - Eigen::Vector2f(-2, 1).normalized()).norm() <= 1e-6f);
}

TEST_CASE("a terrain is as high as its samples, and exact to the cube of their spacing between them")
{
    auto const field = terrain(0.2, bumpy);
    for (int i = 0; i < 11; ++i)
        for (int k = 0; k < 11; ++k) {
            double const x = -1 + 0.2 * i, z = -1 + 0.2 * k;
            CHECK(std::abs(field.surface({x, bumpy(x, z), z}).distance) <= 1e-15);
        }
    auto const coarse = worst_of_bumps(0.1), fine = worst_of_bumps(0.05);
    CHECK(coarse.first < 1e-3);
    CHECK(coarse.first / fine.first > 6.5);
    CHECK(coarse.second < 2e-2);
    CHECK(coarse.second / fine.second > 3.3);
}

TEST_CASE("normals of a terrain are continuous, and its distance is never of the wrong sign")
{
    std::mt19937 random(3);
    std::vector<double> heights(81);
    for (double& h : heights) h = std::normal_distribution<double>(0, 0.3)(random);
    Field3 const rough({-1, -1}, 0.25, {9, 9}, heights);
    for (int i = 0; i < 2000; ++i) {
        Eigen::Vector3d x = random_point(random, 1), y = x;
        // across the border of a piece
        x.x() = std::floor(4 * x.x()) / 4 - 1e-9, y.x() = x.x() + 2e-9;
        if (x.x() < -1 || y.x() > 1) continue;
        CHECK((rough.surface(x).normal - rough.surface(y).normal).norm() <= 1e-6);
    }
    for (int i = 0; i < 2000; ++i) {
        Eigen::Vector3d x = random_point(random, 1.5);
        Eigen::Vector2d slope;
        double const height = rough.view().height(x, slope);
        CHECK((rough.surface(x).distance > 0) == (x.y() > height));
        CHECK(std::abs(rough.surface(x).normal.norm() - 1) <= 1e-14);
    }
}

TEST_CASE("beyond its samples a terrain goes on level")
{
    auto const plane = terrain(0.25, [](double x, double z) { return x + z; });
    auto const far = plane.surface({30, 5, -40});
    CHECK(far.distance == Approx(5).epsilon(1e-14));
    CHECK((far.normal - Eigen::Vector3d::UnitY()).norm() <= 1e-14);
    auto const side = plane.surface({30, 1.25, 0.25}); // still sloping along z
    CHECK(side.distance == Approx(0).margin(1e-14));
    CHECK(side.normal.z() == Approx(-std::sqrt(0.5)));
    // A point that is no number reads no height that is not the field's.
    CHECK(std::isfinite(plane.surface({std::nan(""), 0, 0}).distance));
}

TEST_CASE("an obstacle of a terrain touches packs of velocities as it touches each")
{
    using Pack = firn::test::TestLane<double>;
    firn::Obstacle<Field3> const ground{.shape = terrain(0.2, bumpy), .contact = firn::Contact::coulomb(0.4)};
    auto const action = ground.plain(0).over<double, 3>({0, 0.01});
    std::mt19937 random(4);
    int touched = 0;
    for (int i = 0; i < 500; ++i) {
        double x[3][4], v[3][4];
        for (int lane = 0; lane < 4; ++lane) {
            Eigen::Vector3d const at = random_point(random, 5), speed = random_point(random, 1);
            for (int a = 0; a < 3; ++a) x[a][lane] = at[a], v[a][lane] = speed[a];
        }
        firn::LanePosition<Pack, 3> packed{firn::lattice(0.2), {0, 0, 0}, {}};
        firn::Vector<Pack, 3> velocity;
        for (int a = 0; a < 3; ++a) {
            packed.offset[a] = firn::LaneTraits<Pack>::load(x[a]);
            velocity[a] = firn::LaneTraits<Pack>::load(v[a]);
        }
        auto const many = action.touch<Pack>(packed, velocity, ground.contact);
        for (int lane = 0; lane < 4; ++lane) {
            firn::LanePosition<double, 3> const place{
                firn::lattice(0.2), {0, 0, 0}, {x[0][lane], x[1][lane], x[2][lane]}};
            auto const one = action.touch<double>(place, Eigen::Vector3d(v[0][lane], v[1][lane], v[2][lane]),
                                                  ground.contact);
            touched += one.inside;
            for (int a = 0; a < 3; ++a) {
                double after[4];
                firn::LaneTraits<Pack>::store(many.velocity[a], after);
                CHECK(std::abs(after[lane] - one.velocity[a]) <= 1e-14);
            }
        }
    }
    CHECK(touched > 500);
}

TEST_CASE("heights that do not fit their samples are refused")
{
    std::vector<double> const four(4, 1.0);
    CHECK_NOTHROW(Field3({0, 0}, 1, {2, 2}, four));
    CHECK_THROWS_AS(Field3({0, 0}, 0, {2, 2}, four), firn::Error);
    CHECK_THROWS_AS(Field3({0, 0}, std::nan(""), {2, 2}, four), firn::Error);
    CHECK_THROWS_AS(Field3({0, 0}, 1, {4, 1}, four), firn::Error);
    CHECK_THROWS_AS(Field3({0, 0}, 1, {2, 3}, four), firn::Error);
    CHECK_THROWS_AS(Field3({std::nan(""), 0}, 1, {2, 2}, four), firn::Error);
    CHECK_THROWS_AS(Field3({0, 0}, 1, {2, 2}, {1, 2, 3, std::nan("")}), firn::Error);
    CHECK_THROWS_AS(Field3({0, 0}, 1, {2, 2}, {1, 2, 3, 1e308}), firn::Error);
    CHECK_THROWS_AS(Field3({0, 0}, 1e-300, {2, 2}, four), firn::Error); // slopes overflow
    // far from the origin of its frame, where single precision does not tell its samples apart
    CHECK_THROWS_AS(Field2({5e5f}, 0.1f, {2}, {0, 0}), firn::Error);
    CHECK_NOTHROW(Field3({5e5, 5e6}, 0.1, {2, 2}, four));
}
