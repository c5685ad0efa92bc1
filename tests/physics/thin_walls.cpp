// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/tank.hpp"

#include <firn/contact_points.hpp>
#include <firn/models/fluids/keeps_volume.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

// Shells that act at their surface, by themselves and beside a list of solids.
using namespace firn;
using namespace firn::test;

namespace
{

using Kept = KeepsVolume<Fluid<Plane>>;
using Vessel = Tank<Kept>; // with walls of its own, in whose place these tests have others
using Solids = Obstacles<AnyShape<>, ActsOn::surface_and_particles>;
using Shells = Obstacles<Shell<AnyShape<>>, ActsOn::surface_and_particles>;

constexpr double thin = 1e-3; // [m]: a twentieth of a cell

/// The same walls as shells.
Shells as_shells(AtSurface const& walls)
{
    Shells shells;
    for (auto const& wall : walls.list)
        shells.list.push_back({.shape = {wall.shape, thin}, .motion = wall.motion});
    return shells;
}
Solids on_particles_too(AtSurface const& walls)
{
    Solids solids;
    for (auto const& wall : walls.list)
        solids.list.push_back({.shape = wall.shape, .motion = wall.motion, .on_particles = true});
    return solids;
}

struct Lies
{
    double degrees;
    Eigen::Vector2d offset; ///< [cells]
    Frame frame() const { return {degrees * M_PI / 180, offset * Vessel::h}; }
};
std::vector<Lies> const places{{0, {0, 0}}, {0, {0.5, 0.5}}, {17, {0.3, 0.21}}};

} // namespace

TEST_CASE("water rests in a tank of thin walls, and none gets through them", "[physics][surface]")
{
    for (auto const& place : places) {
        CAPTURE(place.degrees, place.offset.x());
        Vessel tank(place.frame(), 0, 3);
        auto const walls = as_shells(tank.walls);
        double const duration = 0.5, of_side = 0.5 * 1000 * g * Vessel::depth * Vessel::depth;
        tank.water.advance(0.5, Gravity{tank.pull()}, walls);
        auto const report = tank.water.advance(duration, Gravity{tank.pull()}, walls);
        CHECK(tank.rms_speed() < 0.01 * std::sqrt(g * Vessel::depth));
        CHECK(std::abs(tank.mean_height() - Vessel::depth / 2) < 0.01 * Vessel::depth / 2);
        CHECK(std::abs(tank.force(report, 0, {0, -1}, duration) / tank.weight() - 1) < 0.01);
        CHECK(std::abs(tank.force(report, 1, {-1, 0}, duration) / of_side - 1) < 0.02);
        CHECK(std::abs(tank.force(report, 2, {1, 0}, duration) / of_side - 1) < 0.02);
        for (auto const& x : tank.water.positions()) {
            Eigen::Vector2d const own = place.frame().own(x);
            CHECK((own.y() > 0 && std::abs(own.x()) < Vessel::width / 2));
        }
    }
}

TEST_CASE("a hollow disk of thin wall has the lift of Archimedes in water, and one that is full has none",
          "[physics][surface]")
{
    double const radius = 4 * Vessel::h, duration = 0.4, displaced = 1000 * g * M_PI * radius * radius;
    for (auto const& place : {places[1], places[2]})
        for (bool const is_full : {false, true}) {
            CAPTURE(place.degrees, place.offset.x(), is_full);
            Vessel tank(place.frame(), radius, 3);
            Shells disk;
            disk.list.push_back({.shape = {Sphere{radius}, thin}, .motion = tank.walls.list.back().motion});
            tank.walls.list.pop_back();
            auto const walls = on_particles_too(tank.walls);
            if (is_full) {
                Kept const water = tank.water.model();
                double const h = Vessel::h;
                std::vector<Eigen::Vector2d> points;
                for (auto const& x : box_of_points<2>({-radius, -radius}, {radius, radius}, h))
                    if (x.norm() < radius)
                        points.push_back(place.frame().place(x + Eigen::Vector2d(0, Vessel::depth / 2)));
                tank.water.add(points, h * h / 4);
                std::vector<double> log_J;
                for (auto const& x : tank.water.positions())
                    log_J.push_back(-std::log1p(water.exponent * water.density * g *
                                                (Vessel::depth - place.frame().own(x).y()) /
                                                water.bulk_modulus) /
                                    water.exponent);
                tank.water.upload<LogVolumeRatio>(log_J);
            }
            tank.water.advance(0.2, Gravity{tank.pull()}, walls, disk);
            auto const report = tank.water.advance(duration, Gravity{tank.pull()}, walls, disk);
            CHECK(std::abs(tank.force(report, 3, {0, 1}, duration) / displaced - (is_full ? 0 : 1)) < 0.04);
        }
}

TEST_CASE("a thin wall between deep and shallow water carries the difference of their forces",
          "[physics][surface]")
{
    for (auto const& place : places) {
        CAPTURE(place.degrees, place.offset.x());
        double const h = Vessel::h, deep = 0.3, shallow = 0.1, half = 0.2, duration = 0.4;
        auto const frame = place.frame();
        Kept const model = materials::water<Plane>(3);
        Vessel::Solver water(lattice(h), model);
        std::vector<Eigen::Vector2d> points;
        std::vector<double> log_J;
        for (auto const& x : box_of_points<2>({-half, 0}, {half, deep}, h)) {
            double const level = x.x() < 0 ? deep : shallow;
            if (x.y() > level) continue;
            points.push_back(frame.place(x));
            log_J.push_back(
                -std::log1p(model.exponent * model.density * g * (level - x.y()) / model.bulk_modulus) /
                model.exponent);
        }
        water.add(points, h * h / 4);
        water.upload<LogVolumeRatio>(log_J);
        Solids walls;
        auto const wall = [&](Eigen::Vector2d const& normal, double x) {
            return Obstacle<AnyShape<>>{.shape = HalfSpace{in_space(frame.direction(normal))},
                                        .motion = {.position = in_space(frame.place({x, 0}))},
                                        .on_particles = true};
        };
        walls.list = {wall({0, 1}, 0), wall({1, 0}, -half), wall({-1, 0}, half)};
        auto const between = wall({1, 0}, 0);
        Shells middle;
        middle.list.push_back({.shape = {between.shape, thin}, .motion = between.motion});
        Gravity const gravity{in_space(frame.direction({0, -g}))};
        water.advance(0.2, gravity, middle, walls);
        auto const report = water.advance(duration, gravity, middle, walls);
        double const force = report.reactions[0].impulse.head<2>().dot(frame.direction({1, 0})) / duration;
        CHECK(std::abs(force / (0.5 * 1000 * g * (deep * deep - shallow * shallow)) - 1) < 0.02);
        int on_the_left = 0;
        double level = 0;
        for (auto const& x : water.positions()) {
            Eigen::Vector2d const own = frame.own(x);
            if (own.x() < 0) ++on_the_left, level += own.y();
        }
        CHECK(on_the_left == std::lround(half / h * deep / h * 4));
        CHECK(std::abs(level / on_the_left - deep / 2) < 0.01 * deep);
    }
}

TEST_CASE("thin walls that move keep all momentum, with the same bits for any number of threads",
          "[physics][surface]")
{
    double const h = 0.05;
    auto const run = [&](auto const& backend, std::vector<Eigen::Vector2d>& bits) {
        typename Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver block(lattice(h), {}, {}, {},
                                                                               backend);
        block.add(box_of_points<2>({0.013, 0.1}, {0.413, 0.3}, h), h * h / 4, {0.5, -2});
        Solids floor;
        floor.list.push_back({.shape = HalfSpace{{0.6, 0.8, 0}}, .on_particles = true});
        Shells plates;
        plates.list.push_back({.shape = {Capsule{0.06, 0.2}, thin},
                               .contact = Contact::coulomb(0.4),
                               .motion = {.position = {0.6, 0.1, 0},
                                          .velocity = {-3, 1, 0},
                                          .angular_velocity = {0, 0, 4},
                                          .time = 0}});
        Eigen::Vector2d expected = Totals(block).momentum;
        double const mass = Totals(block).mass;
        auto const report = block.advance(0.1, floor, plates);
        for (auto const& received : report.reactions) expected -= received.impulse.head<2>();
        CHECK((Totals(block).momentum - expected).norm() < 1e-12 * mass);
        CHECK(report.reactions[1].impulse.norm() > 0.1 * mass); // it was hit
        auto const at = block.positions();
        bits.assign(at.begin(), at.end());
    };
    std::vector<Eigen::Vector2d> once, again;
    run(TestedBackend{}, once);
    run(TestedBackend{}, again);
    CHECK(once == again);
#if defined(FIRN_TESTS_ON_OPENMP)
    run(OpenMP{.threads = 1}, again);
    CHECK(once == again);
    run(OpenMP{.threads = 3}, again);
    CHECK(once == again);
#endif
}

TEST_CASE("lists that act at their surface have one surface, and the bits of one list", "[physics][surface]")
{
    double const h = 0.05;
    auto const wall = [](Eigen::Vector3d const& normal) {
        return Obstacle<AnyShape<>>{.shape = HalfSpace{normal}};
    };
    AtSurface all, first, second;
    all.list = {wall({0, 1, 0}), wall({0.8, 0.6, 0})};
    first.list = {all.list[0]}, second.list = {all.list[1]};
    auto const block = [&] {
        Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver solver(lattice(h, {0.013, 0.021, 0}));
        solver.add(box_of_points<2>({0, 0}, {0.4, 0.2}, h), h * h / 4, {-1, -1});
        return solver;
    };
    auto of_one = block(), of_two = block();
    auto const one = of_one.advance(0.1, Gravity{}, all), two = of_two.advance(0.1, Gravity{}, first, second);
    CHECK(of_one.positions() == of_two.positions());
    REQUIRE(two.reactions.size() == 2);
    for (std::size_t i = 0; i < 2; ++i) CHECK(one.reactions[i].impulse == two.reactions[i].impulse);
    auto const points = contact_points(of_two).points;
    CHECK(points.size() == contact_points(of_one).points.size());
    CHECK(std::any_of(points.begin(), points.end(), [](auto const& point) { return point.obstacle == 1; }));
}
