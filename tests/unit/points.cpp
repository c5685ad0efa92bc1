// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/threads.hpp"

#include <firn/sampling/points.hpp>

#include <limits>
#include <map>
#include <numbers>

using Eigen::Vector3d;
using firn::Count;
using firn::Radius;
using firn::Spacing;

namespace
{

/// A host engine's own solid: whatever a function says.
struct Solid
{
    bool (*inside)(Vector3d const&);
    double size;
    Eigen::AlignedBox3d box;

    template <class Loop>
    std::vector<char> contains(std::span<Vector3d const> points, Loop const& loop) const
    {
        std::vector<char> result(points.size());
        loop.for_each(points.size(), [&](std::size_t i) { result[i] = inside(points[i]); });
        return result;
    }
    double volume() const { return size; }
    Eigen::AlignedBox3d bounding_box() const { return box; }
};

static_assert(firn::Interior<Solid>);
static_assert(!firn::Interior<int>);

Solid ball()
{
    return {[](Vector3d const& x) { return x.norm() < 1; },
            4.0 / 3 * std::numbers::pi,
            {Vector3d::Constant(-1), Vector3d::Constant(1)}};
}

Solid cube()
{
    return {[](Vector3d const& x) { return (x.array() > 0).all() && (x.array() < 1).all(); },
            1,
            {Vector3d::Zero(), Vector3d::Ones()}};
}

/// Two cubes, a gap between them and most of their box empty.
Solid far_cubes()
{
    return {[](Vector3d const& x) {
                Vector3d const y = x.x() > 2 ? Vector3d{x - Vector3d::Constant(3)} : x;
                return (y.array() > 0).all() && (y.array() < 1).all();
            },
            2,
            {Vector3d::Zero(), Vector3d::Constant(4)}};
}

/// A plate thinner than the points are apart.
Solid plate()
{
    return {[](Vector3d const& x) {
                return x.z() > 0 && x.z() < 0.02 && x.x() > 0 && x.x() < 1 && x.y() > 0 && x.y() < 1;
            },
            0.02,
            {Vector3d::Zero(), Vector3d{1, 1, 0.02}}};
}

double least_distance(std::vector<Vector3d> points)
{
    std::ranges::sort(points, {}, [](Vector3d const& x) { return x.x(); });
    double least = std::numeric_limits<double>::max();
    for (std::size_t i = 0; i < points.size(); ++i)
        for (std::size_t j = i + 1; j < points.size() && points[j].x() - points[i].x() < least; ++j)
            least = std::min(least, (points[j] - points[i]).norm());
    return least;
}

/// How far `points` are from an even spread: the largest gap in a half's share of the points, in all 7
/// halves.
double unevenness(std::vector<Vector3d> const& points, Vector3d const& centre)
{
    double worst = 0;
    for (int halves = 1; halves < 8; ++halves) {
        double here = 0;
        for (auto const& x : points) {
            int side = 0;
            for (int i = 0; i < 3; ++i) side += (halves >> i & 1) && x[i] > centre[i];
            here += side % 2;
        }
        worst = std::max(worst, std::abs(here / double(points.size()) - 0.5));
    }
    return worst;
}

template <class Sampler>
void check_sampler(Sampler const& sample)
{
    for (auto const& solid : {ball(), cube(), far_cubes(), plate()})
        for (std::int64_t const count : {1, 2, 7, 100, 3000}) {
            CAPTURE(count, solid.size);
            auto const result = sample(solid, Count{count}, 4, firn::Serial{});
            REQUIRE(std::int64_t(result.points.size()) == count);
            CHECK(result.volume_per_point == solid.volume() / double(count));
            CHECK(std::ranges::all_of(result.points, solid.inside));
        }
    auto const once = sample(ball(), Count{3000}, 4, firn::Serial{});
    CHECK(sample(ball(), Count{3000}, 4, firn::Serial{}).points == once.points);
    CHECK(sample(ball(), Count{3000}, 4, TwoThreads{}).points == once.points);
    CHECK(sample(ball(), Count{3000}, 5, firn::Serial{}).points != once.points);
    auto const many = sample(ball(), Count{20000}, 4, firn::Serial{}).points;
    CHECK(unevenness(many, Vector3d::Zero()) < 4 * 0.5 / std::sqrt(20000.0));
    double second_moment = 0;
    for (auto const& x : many) second_moment += x.squaredNorm() / double(many.size());
    CHECK(second_moment == Approx(0.6).epsilon(0.015)); // 3/5 R²
}

} // namespace

template <class Number>
concept MakesCount = requires(Number number)
{
    Count{number};
};
static_assert(MakesCount<std::size_t> && MakesCount<int> && MakesCount<std::int64_t> && !MakesCount<double>);

TEST_CASE("lattice points: as many as asked, inside, even, and the same again")
{
    check_sampler([](auto const& solid, Count count, std::uint64_t seed, auto const& loop) {
        return firn::lattice_points(solid, count, 0.5, seed, loop);
    });
}

TEST_CASE("uniform points: as many as asked, inside, even, and the same again")
{
    check_sampler([](auto const& solid, Count count, std::uint64_t seed, auto const& loop) {
        return firn::uniform_points(solid, count, seed, loop);
    });
}

TEST_CASE("Poisson-disk points: as many as asked, inside, even, and the same again")
{
    check_sampler([](auto const& solid, Count count, std::uint64_t seed, auto const& loop) {
        return firn::poisson_disk_points(solid, count, seed, loop);
    });
}

TEST_CASE("the same seed gives these very points on every machine")
{
    auto const first = firn::uniform_points(cube(), Count{2}, 42).points;
    // std::mt19937_64 of seed 42 begins 13930160852258120406, 11788048577503494824, 13874630024467741450.
    CHECK(first[0].x() == double(13930160852258120406u >> 11) * 0x1p-53);
    CHECK(first[0].y() == double(11788048577503494824u >> 11) * 0x1p-53);
    CHECK(first[0].z() == double(13874630024467741450u >> 11) * 0x1p-53);
}

TEST_CASE("a box that is a whole number of spacings wide gets its whole lattice")
{
    auto const by_count = firn::lattice_points(cube(), Count{8000});
    auto const by_spacing = firn::lattice_points(cube(), Spacing{0.05});
    REQUIRE(by_count.points.size() == 8000);
    REQUIRE(by_spacing.points.size() == 8000);
    for (auto const& points : {by_count.points, by_spacing.points}) {
        CHECK((points.front() - Vector3d::Constant(0.025)).norm() < 1e-12);
        CHECK((points.back() - Vector3d::Constant(0.975)).norm() < 1e-12);
        CHECK((points[1] - points[0] - Vector3d{0.05, 0, 0}).norm() < 1e-12);
    }
}

TEST_CASE("jitter moves lattice points by up to half its fraction of a spacing")
{
    auto const still = firn::lattice_points(cube(), Spacing{0.1});
    auto const moved = firn::lattice_points(cube(), Spacing{0.1}, 0.5, 9);
    REQUIRE(still.points.size() == moved.points.size());
    double furthest = 0;
    for (std::size_t i = 0; i < still.points.size(); ++i)
        furthest = std::max(furthest, (still.points[i] - moved.points[i]).cwiseAbs().maxCoeff());
    CHECK(furthest <= 0.025);
    CHECK(furthest > 0.024);
}

TEST_CASE("a lattice of a given spacing holds the volume by the cube of the spacing")
{
    auto const sample = firn::lattice_points(ball(), Spacing{0.05});
    CHECK(sample.volume_per_point == Approx(0.05 * 0.05 * 0.05).epsilon(0.01));
    CHECK(sample.volume_per_point * double(sample.points.size()) == Approx(ball().volume()).epsilon(1e-12));
    CHECK(least_distance(sample.points) == Approx(0.05));
}

TEST_CASE("uniform points are independent: cells hold as many as chance gives")
{
    // 1000 cells of 20 points in the mean: the variance of a cell is 20.
    std::map<int, int> cells;
    for (auto const& x : firn::uniform_points(cube(), Count{20000}, 3).points)
        ++cells[int(x.x() * 10) + 10 * int(x.y() * 10) + 100 * int(x.z() * 10)];
    double variance = 0;
    for (int cell = 0; cell < 1000; ++cell) variance += (cells[cell] - 20) * (cells[cell] - 20) / 1000.0;
    CHECK(variance == Approx(20).epsilon(0.2));
}

TEST_CASE("Poisson-disk points are no closer than the radius, and nearly as dense as that allows")
{
    for (double const radius : {0.2, 0.1, 0.05}) {
        auto const sample = firn::poisson_disk_points(ball(), Radius{radius}, 7);
        CHECK(least_distance(sample.points) >= radius);
        // A maximal sample holds about 0.7 points in the cube of the radius.
        double const density = radius * radius * radius / sample.volume_per_point;
        CHECK(density > 0.55);
        CHECK(density < 0.70);
        CHECK(sample.volume_per_point * double(sample.points.size()) ==
              Approx(ball().volume()).epsilon(1e-12));
    }
}

TEST_CASE("Poisson-disk points leave no hole of twice their radius")
{
    auto const points = firn::poisson_disk_points(cube(), Radius{0.1}, 7).points;
    int holes = 0;
    for (auto const& x : firn::uniform_points(cube(), Count{5000}).points)
        holes += std::ranges::none_of(points, [&](Vector3d const& p) { return (p - x).norm() < 0.15; });
    CHECK(holes == 0);
}

TEST_CASE("Poisson-disk points by number keep the distance that is promised")
{
    for (std::int64_t const count : {1000, 20000}) {
        auto const sample = firn::poisson_disk_points(ball(), Count{count}, 7);
        CHECK(least_distance(sample.points) > 0.82 * std::cbrt(sample.volume_per_point));
    }
}

TEST_CASE("a sheet much thinner than its points are apart is one layer of them")
{
    Solid const sheet{[](Vector3d const& x) { return std::abs(x.z()) < 1e-9; },
                      2e-9,
                      {Vector3d{0, 0, -1e-9}, Vector3d{1, 1, 1e-9}}};
    CHECK(firn::detail::spacing_for(sheet, 900) == Approx(1.0 / 30));
    CHECK(firn::lattice_points(sheet, Count{900}).points.size() == 900);
    auto const disks = firn::poisson_disk_points(sheet, Count{900}).points;
    CHECK(disks.size() == 900);
    CHECK(least_distance(disks) > 0.5 / 30);
}

TEST_CASE("samplers reach every part of a solid")
{
    auto const right = [](std::vector<Vector3d> const& points) {
        return double(std::ranges::count_if(points, [](auto const& x) { return x.x() > 2; })) /
               double(points.size());
    };
    CHECK(right(firn::lattice_points(far_cubes(), Count{2000}).points) == Approx(0.5).margin(0.05));
    CHECK(right(firn::uniform_points(far_cubes(), Count{2000}).points) == Approx(0.5).margin(0.05));
    CHECK(right(firn::poisson_disk_points(far_cubes(), Count{2000}).points) == Approx(0.5).margin(0.05));
}

TEST_CASE("samplers refuse what cannot be sampled")
{
    auto const nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
    for (std::int64_t const count : {std::int64_t(0), std::int64_t(-5), std::int64_t(1) << 40}) {
        CHECK_THROWS_AS(firn::lattice_points(ball(), Count{count}), firn::Error);
        CHECK_THROWS_AS(firn::uniform_points(ball(), Count{count}), firn::Error);
        CHECK_THROWS_AS(firn::poisson_disk_points(ball(), Count{count}), firn::Error);
    }
    for (double const length : {0.0, -1.0, nan, infinity, 1e-9}) {
        CHECK_THROWS_AS(firn::lattice_points(ball(), Spacing{length}), firn::Error);
        CHECK_THROWS_AS(firn::poisson_disk_points(ball(), Radius{length}), firn::Error);
    }
    for (double const jitter : {-0.1, 1.1, nan})
        CHECK_THROWS_AS(firn::lattice_points(ball(), Count{10}, jitter), firn::Error);
    // Two spacings to a box leave eight points in its corners, none in the ball.
    CHECK_THROWS_WITH(firn::lattice_points(ball(), Spacing{1.9}), Contains("no point falls inside"));

    auto nothing = ball();
    nothing.inside = [](Vector3d const&) { return false; };
    CHECK_THROWS_AS(firn::lattice_points(nothing, Count{10}), firn::Error);
    CHECK_THROWS_AS(firn::uniform_points(nothing, Count{10}), firn::Error);
    CHECK_THROWS_AS(firn::poisson_disk_points(nothing, Count{10}), firn::Error);
    for (double const volume : {0.0, -1.0, nan, infinity}) {
        auto empty = ball();
        empty.size = volume;
        CHECK_THROWS_AS(firn::lattice_points(empty, Spacing{0.1}), firn::Error);
        CHECK_THROWS_AS(firn::uniform_points(empty, Count{10}), firn::Error);
        CHECK_THROWS_AS(firn::poisson_disk_points(empty, Radius{0.1}), firn::Error);
    }
}
