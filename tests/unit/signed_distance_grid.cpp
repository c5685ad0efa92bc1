// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/effects/shapes/inside.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>

#include <cmath>
#include <random>

namespace
{

using Grid2 = firn::SignedDistanceGrid<float, 2>;
using Grid3 = firn::SignedDistanceGrid<double, 3>;
static_assert(firn::Shape<Grid2, float, 2> && firn::Shape<Grid3, double, 3>);
static_assert(firn::Shape<firn::SignedDistanceGridView<float, 3>, float, 3>);

/// The grid of a function on [-1.5, 1.5]^d with cells of size h.
template <class Real, int d, class Distance>
firn::SignedDistanceGrid<Real, d> grid_of(Real h, Distance const& distance)
{
    int const nodes = int(std::lround(3 / h)) + 1;
    firn::Vector<Real, d> const origin = firn::Vector<Real, d>::Constant(Real(-1.5));
    std::vector<Real> values(std::size_t(std::pow(nodes, d) + 0.5));
    for (std::size_t at = 0; at < values.size(); ++at) {
        firn::Vector<Real, d> x = origin;
        std::size_t rest = at;
        for (int i = 0; i < d; ++i, rest /= std::size_t(nodes)) x[i] += h * Real(rest % std::size_t(nodes));
        values[at] = distance(x);
    }
    return {origin, h, Eigen::Array<int, d, 1>::Constant(nodes), std::move(values)};
}

double worst_of_sphere(double h)
{
    auto const grid = grid_of<double, 3>(h, [](auto const& x) { return x.norm() - 1; });
    std::mt19937 random(1);
    double worst = 0;
    for (int i = 0; i < 5000; ++i) {
        Eigen::Vector3d x;
        for (double& xi : x) xi = 2.8 * (random() / 4294967296.0) - 1.4;
        if (x.norm() < 0.4) continue;
        worst = std::max(worst, std::abs(grid.surface(x).distance - (x.norm() - 1)));
    }
    return worst;
}

} // namespace

TEST_CASE("the distance of a sphere is exact to the square of the cell size")
{
    CHECK(worst_of_sphere(0.1) < 0.1 * 0.1 / (4 * 0.4));
    CHECK(worst_of_sphere(0.1) / worst_of_sphere(0.05) == Approx(4).epsilon(0.25));
}

TEST_CASE("a plane is exact, in both dimensions and precisions")
{
    Eigen::Vector2f const normal2 = Eigen::Vector2f{3, 4} / 5;
    auto const plane2 = grid_of<float, 2>(0.25f, [&](auto const& x) { return normal2.dot(x) - 0.2f; });
    Eigen::Vector3d const normal3 = Eigen::Vector3d{1, -2, 2} / 3;
    auto const plane3 = grid_of<double, 3>(0.25, [&](auto const& x) { return normal3.dot(x) - 0.2; });
    std::mt19937 random(2);
    for (int i = 0; i < 1000; ++i) {
        Eigen::Vector3d x;
        for (double& xi : x) xi = 3 * (random() / 4294967296.0) - 1.5;
        auto const three = plane3.surface(x);
        REQUIRE(three.distance == Approx(normal3.dot(x) - 0.2).margin(1e-12));
        REQUIRE((three.normal - normal3).norm() < 1e-12);
        Eigen::Vector2f const flat = x.head<2>().cast<float>();
        auto const two = plane2.surface(flat);
        REQUIRE(two.distance == Approx(normal2.dot(flat) - 0.2f).margin(1e-5));
        REQUIRE((two.normal - normal2).norm() < 1e-4f);
    }
}

TEST_CASE("beyond the grid the distance is positive, continuous, never too large, and its normal points away")
{
    auto const grid = grid_of<double, 3>(0.1, [](auto const& x) { return x.norm() - 1; });
    for (Eigen::Vector3d const& x : {Eigen::Vector3d{5, 0, 0}, {0, -1.6, 0}, {2, 2, 2}, {1.6, 0.3, -9}}) {
        auto const [distance, normal] = grid.surface(x);
        CHECK(distance > 0);
        CHECK(distance <= x.norm() - 1 + 0.01);
        CHECK(distance > 0.6 * (x.norm() - 1));
        CHECK(normal.norm() == Approx(1));
        CHECK(normal.dot(x.normalized()) > 0.8);
    }
    Eigen::Vector3d const border{1.5, 0.2, 0.1};
    Eigen::Vector3d const step{1e-9, 0, 0};
    CHECK(grid.surface(border + step).distance == Approx(grid.surface(border - step).distance).margin(1e-6));

    // A solid that fills the grid.
    auto const full = grid_of<double, 3>(0.5, [](auto const&) { return -1.0; });
    CHECK(full.surface({3.5, 0, 0}).distance == Approx(1));
    CHECK(full.surface({3.5, 0, 0}).normal.x() == Approx(1));
}

TEST_CASE("where the gradient vanishes the normal is still a unit vector")
{
    auto const symmetric = grid_of<double, 3>(0.5, [](auto const& x) { return std::abs(x[2] - 0.25) - 1; });
    CHECK(symmetric.surface({0.1, 0.1, 0.25}).normal == Eigen::Vector3d::UnitZ());
    auto const level = grid_of<float, 2>(0.5f, [](auto const&) { return 1.0f; });
    CHECK(level.surface({0.1f, 0.1f}).normal == Eigen::Vector2f::UnitY());
    // A point that is no number reads no memory that is not the grid's.
    CHECK(std::isnan(level.surface({std::nanf(""), 0}).distance) == false);
}

TEST_CASE("copies of a grid share its values")
{
    auto const grid = grid_of<float, 2>(0.5f, [](auto const& x) { return x.norm() - 1; });
    auto const copy = grid;
    CHECK(copy.view().values == grid.view().values);
}

TEST_CASE("a grid that does not fit its values is refused")
{
    std::vector<float> const four(4, 1.0f);
    CHECK_NOTHROW(Grid2({0, 0}, 1, {2, 2}, four));
    CHECK_THROWS_AS(Grid2({0, 0}, 0, {2, 2}, four), firn::Error);
    CHECK_THROWS_AS(Grid2({0, 0}, std::nanf(""), {2, 2}, four), firn::Error);
    CHECK_THROWS_AS(Grid2({0, 0}, 1, {4, 1}, four), firn::Error);
    CHECK_THROWS_AS(Grid2({0, 0}, 1, {2, 3}, four), firn::Error);
    CHECK_THROWS_AS(Grid2({0, std::nanf("")}, 1, {2, 2}, four), firn::Error);
    CHECK_THROWS_AS(Grid3({0, 0, 0}, 1, {1 << 22, 1 << 21, 1 << 21}, {}), firn::Error); // 2^64 nodes
    CHECK_THROWS_AS(Grid2({0, 0}, 1, {2, 2}, {1, 2, 3, std::nanf("")}), firn::Error);
    CHECK_THROWS_AS(Grid2({0, 0}, 1, {2, 2}, {1, 2, 3, -3e38f}), firn::Error);
}

TEST_CASE("a grid whose cells are lost to rounding, far from its frame's origin, is refused")
{
    auto const two_by_two = []<class Real>(Real x, Real cell) {
        return firn::SignedDistanceGrid<Real, 2>({x, 0}, cell, {2, 2}, std::vector<Real>(4, Real(1)));
    };
    CHECK_NOTHROW(two_by_two(1000.0f, 0.01f));             // a kilometre
    CHECK_THROWS_AS(two_by_two(5e5f, 0.05f), firn::Error); // where maps begin
    CHECK_THROWS_AS(two_by_two(-5e5f, 0.05f), firn::Error);
    CHECK_NOTHROW(two_by_two(5e5, 0.05));
}

TEST_CASE("a grid of distances knows how far its solid reaches, to a cell, also beyond its border")
{
    double const cell = 0.1, diagonal = std::sqrt(3.0) * cell;
    auto const off_centre = grid_of<double, 3>(cell, [](auto const& x) {
        return (x - Eigen::Vector3d{0.5, 0, 0}).norm() - 0.4;
    });
    CHECK(off_centre.reach() >= 0.9);
    CHECK(off_centre.reach() <= 0.9 + diagonal);
    CHECK(off_centre.view().reach() == off_centre.reach());
    auto const full = grid_of<double, 3>(0.5, [](auto const&) { return -1.0; }); // 1 m beyond all corners
    CHECK(full.reach() >= std::sqrt(3.0) * 1.5 + 1);
    CHECK(full.reach() <= std::sqrt(3.0) * 2 + 1);
    CHECK(grid_of<float, 2>(0.5f, [](auto const&) { return 1.0f; }).reach() == 0); // there is none
}

TEST_CASE("a grid of distances tells what is inside, too")
{
    auto const square = []<class Real>(Real) {
        std::vector<Real> distance; // to a circle of radius 1 about (2, 2)
        for (int j = 0; j < 41; ++j)
            for (int i = 0; i < 41; ++i) distance.push_back(Real(std::hypot(i * 0.1 - 2, j * 0.1 - 2) - 1));
        return firn::SignedDistanceGrid<Real, 2>({0, 0}, Real(0.1), {41, 41}, distance);
    };
    auto const check = [](auto const& grid) {
        firn::Inside<std::decay_t<decltype(grid)>> const inside{.shape = grid,
                                                                .pose = {.position = {3, 0, 0}}};
        firn::Outside<std::decay_t<decltype(grid)>> const outside{grid, inside.pose};
        for (double angle = 0; angle < 6; angle += 0.5) {
            Eigen::Vector2d const away(std::cos(angle), std::sin(angle)), centre(5, 2);
            CHECK(inside(Eigen::Vector2d(centre + 0.95 * away)));
            CHECK_FALSE(inside(Eigen::Vector2d(centre + 1.05 * away)));
            CHECK(outside(Eigen::Vector2d(centre + 1.05 * away)));
        }
    };
    check(square(1.0f));
    check(square(1.0));
}
