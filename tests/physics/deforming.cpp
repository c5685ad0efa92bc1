// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/effects/shapes/deforming_grid.hpp>

#include <algorithm>
#include <functional>
#include <limits>

using namespace firn;
using namespace firn::test;

// Obstacles that change their form.
namespace
{

using Jelly = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>;
using Point = Vector<double, 2>;
Point const first_node(-1.0071, -1.0033);

/// What a function says at the nodes of a grid over some [-1, 2]^2. No node of a scene lies on its lines,
/// where normals jump and roundings would decide.
template <class Value>
std::vector<Value> on_nodes(std::function<Value(Point const&)> const& tell)
{
    std::vector<Value> values;
    for (int j = 0; j <= 60; ++j)
        for (int i = 0; i <= 60; ++i) values.push_back(tell(first_node + 0.05 * Point(i, j)));
    return values;
}
SignedDistanceGrid<double, 2> distances(std::function<double(Point const&)> const& distance)
{
    return {first_node, 0.05, {61, 61}, on_nodes<double>(distance)};
}
SignedDistanceGrid<double, 2> disk(Point const& centre, double radius)
{
    return distances([=](Point const& x) { return (x - centre).norm() - radius; });
}

/// How far points are from those of another list, one by one, at most.
template <class Points, class Others>
double most_apart(Points const& points, Others const& others)
{
    double most = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        most = std::max(most, (points[i].template cast<double>() - others[i].template cast<double>()).norm());
    return most;
}

/// A shape whose values are where the tested backend reads them.
template <class ShapeType>
auto there(ShapeType const& shape)
{
    if constexpr (TestedBackend::reaches_host_memory)
        return shape;
    else
        return shape.on(TestedBackend{});
}

} // namespace

TEST_CASE("a disk that deforms by moving on is where the disk is that moves on")
{
    double const h = 0.05, duration = 0.2;
    Point const way(0.5, 0.1); // farther than its radius
    auto const rigid = there(disk({0, 0}, 0.2037));
    auto const soft =
        there(DeformingGrid<double, 2>(disk({0, 0}, 0.2037), disk(way, 0.2037),
                                       on_nodes<Point>([&](Point const&) { return way; }), 0, duration));
    Motion motion{.velocity = {way[0] / duration, way[1] / duration, 0}, .time = 0};
    Jelly::Solver with_rigid(lattice(h)), with_soft(lattice(h)), with_group(lattice(h));
    auto const points = box_of_points<2>({0.25, -0.2}, {0.65, 0.4}, h);
    with_rigid.add(points, h * h / 4);
    with_soft.add(points, h * h / 4);
    with_group.add(points, h * h / 4);
    Obstacle<std::decay_t<decltype(rigid)>> const pushed{.shape = rigid, .motion = motion};
    Obstacle<std::decay_t<decltype(soft)>> const deformed{.shape = soft};
    Obstacles<std::decay_t<decltype(soft)>> const group{{deformed}};
    Eigen::Vector3d of_rigid(0, 0, 0), of_soft(0, 0, 0), of_group(0, 0, 0);
    for (int i = 0; i < 200; ++i) {
        of_group += with_group.step(duration / 200, group).reactions[0].impulse;
        of_rigid += with_rigid.step(duration / 200, pushed).reactions[0].impulse;
        of_soft += with_soft.step(duration / 200, deformed).reactions[0].impulse;
    }
    auto const x = with_rigid.positions(), y = with_soft.positions();
    CHECK(most_apart(x, points) > h); // it has been pushed
    CHECK(most_apart(x, y) <= 1e-6 * h);
    CHECK((of_rigid - of_soft).norm() <= 1e-6 * of_rigid.norm());
    // as one of any number it is the same
    CHECK(most_apart(y, with_group.positions()) <= 1e-9 * h);
    CHECK((of_group - of_soft).norm() <= 1e-9 * of_soft.norm());
}

TEST_CASE("a disk that grows pushes what surrounds it outwards at the speed of its surface")
{
    double const h = 0.05, duration = 0.1, growth = 0.1;
    Point const centre(0.5, 0.5);
    auto const grows = there(DeformingGrid<double, 2>(disk(centre, 0.2037), disk(centre, 0.2037 + growth),
                                                      on_nodes<Point>([&](Point const& x) {
                                                          Point const away = x - centre;
                                                          double const r = away.norm();
                                                          return Point(away * (growth / std::max(r, 0.1)));
                                                      }),
                                                      1, duration));
    Obstacle<std::decay_t<decltype(grows)>> const obstacle{.shape = grows, .on_particles = true};
    CHECK(obstacle.largest_speed(2) == Approx(growth / duration).epsilon(1e-9));
    Jelly::Solver solver(lattice(h));
    auto points = box_of_points<2>({0, 0}, {1, 1}, h);
    std::erase_if(points, [&](Point const& x) { return (x - centre).norm() < 0.2; });
    solver.add(points, h * h / 4);
    solver.advance(1, obstacle); // the interval begins later: it is at rest
    auto const before = solver.positions();
    double moved = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
        moved = std::max(moved, (before[i].cast<double>() - points[i]).norm());
    CHECK(moved < 0.1 * h); // what lay inside it is out
    auto const report = solver.advance(duration, obstacle);
    auto const after = solver.positions();
    double inwards = 0, nearest = 1, first = 1;
    for (std::size_t i = 0; i < after.size(); ++i) {
        double const r = (before[i].cast<double>() - centre).norm(),
                     now = (after[i].cast<double>() - centre).norm();
        first = std::min(first, r);
        nearest = std::min(nearest, now);
        inwards = std::min(inwards, now - r);
    }
    CHECK(nearest >= 0.2037 + growth - 0.02 * h);
    CHECK(nearest <= first + growth + 0.2 * h); // it has not been thrown off
    CHECK(inwards > -0.05 * h);
    // nearly the same to all sides
    CHECK(report.reactions[0].impulse.norm() < 0.02 * solver.totals().mass * growth / duration);
    solver.advance(0.01, obstacle); // the interval is over: it has its last form
    double last = 1;
    for (auto const& x : solver.positions()) last = std::min(last, (x.cast<double>() - centre).norm());
    CHECK(last >= 0.2037 + growth - 0.02 * h);
}

TEST_CASE("at its surface a disk that deforms by moving on acts as one that moves on", "[surface]")
{
    double const h = 0.05, duration = 0.2;
    Point const way(0.5, 0.1);
    auto const rigid = there(disk({0, 0}, 0.2037));
    auto const soft =
        there(DeformingGrid<double, 2>(disk({0, 0}, 0.2037), disk(way, 0.2037),
                                       on_nodes<Point>([&](Point const&) { return way; }), 0, duration));
    Jelly::Solver with_rigid(lattice(h)), with_soft(lattice(h));
    auto const points = box_of_points<2>({0.25, -0.2}, {0.65, 0.4}, h);
    with_rigid.add(points, h * h / 4);
    with_soft.add(points, h * h / 4);
    Obstacles<std::decay_t<decltype(rigid)>, ActsOn::surface> moves;
    moves.list.push_back(
        {.shape = rigid, .motion = {.velocity = {way[0] / duration, way[1] / duration, 0}, .time = 0}});
    Obstacles<std::decay_t<decltype(soft)>, ActsOn::surface> deforms;
    deforms.list.push_back({.shape = soft});
    Eigen::Vector3d of_rigid(0, 0, 0), of_soft(0, 0, 0);
    for (auto const& report : with_rigid.steps(200, duration / 200, moves))
        of_rigid += report.reactions[0].impulse;
    for (auto const& report : with_soft.steps(200, duration / 200, deforms))
        of_soft += report.reactions[0].impulse;
    auto const x = with_rigid.positions(), y = with_soft.positions();
    CHECK(most_apart(x, points) > h); // it has been pushed
    CHECK(most_apart(x, y) <= 1e-6 * h);
    CHECK((of_rigid - of_soft).norm() <= 1e-6 * of_rigid.norm());
}

// It rises by one and a half cells, between nodes. At the middle of the block nothing but the rise moves it.
TEST_CASE("a block lies on the surface of a floor that deforms by rising, and weighs on it", "[surface]")
{
    double const h = 0.05, duration = 0.2, low = -0.0171, rise = 0.0749, g = 9.81;
    auto const level = [](double height) { return distances([=](Point const& x) { return x[1] - height; }); };
    auto const floor = there(
        DeformingGrid<double, 2>(level(low), level(low + rise),
                                 on_nodes<Point>([&](Point const&) { return Point(0, rise); }), 0, duration));
    Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>::Solver block(lattice(h));
    block.add(box_of_points<2>({0.1, low}, {0.5, low + 0.2}, h), h * h / 4, {0, rise / duration});
    Obstacles<std::decay_t<decltype(floor)>, ActsOn::surface> floors;
    floors.list.push_back({.shape = floor});
    auto const lowest = [&] {
        double least = 1;
        for (auto const& x : block.positions()) least = std::min(least, double(x.y()));
        return least;
    };
    double const weight = block.totals().mass * g, above = h / 4;
    block.advance(duration / 2, Gravity{}, floors); // it sags, and comes to rest relative to the floor
    CHECK(std::abs(lowest() - (low + rise / 2 + above)) < 0.05 * h);
    auto const report = block.advance(duration / 2, Gravity{}, floors);
    CHECK(std::abs(lowest() - (low + rise + above)) < 0.05 * h);
    CHECK(std::abs(-report.reactions[0].impulse.y() / (weight * duration / 2) - 1) < 0.02);
}

TEST_CASE("a shape that changes its form is refused if its numbers make no sense")
{
    double const no_number = std::numeric_limits<double>::quiet_NaN();
    auto const form = disk({0, 0}, 0.2037);
    auto ways = on_nodes<Point>([](Point const&) { return Point(0, 0); });
    auto const refuse = [&](auto const& other, double begin, double duration, char const* what) {
        CHECK_THAT(refused([&] { DeformingGrid<double, 2>(form, other, ways, begin, duration); }).what(),
                   Contains(what));
    };
    refuse(form, no_number, 1, "begin or duration");
    refuse(form, 0, 0, "begin or duration");
    refuse(form, 0, no_number, "begin or duration");
    refuse(SignedDistanceGrid<double, 2>(first_node, 0.06, {61, 61}, form.values()), 0, 1, "different nodes");
    ways[7][1] = no_number;
    refuse(form, 0, 1, "way of the surface");
    ways.pop_back();
    refuse(form, 0, 1, "number of ways");
}
