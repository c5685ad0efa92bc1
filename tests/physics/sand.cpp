// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

// At which angles and heights sand stands, and how fast it flows where it does not.
namespace
{

using SandScene = Scene<Sand<Plane>, QuadraticBSpline, Mls>;
using Points = std::vector<Vector<double, 2>>;
constexpr double g = 9.81, degrees = M_PI / 180;

Obstacle<HalfSpace> rough_floor() { return {.contact = Contact::sticky()}; }

/// Gravity on a plane inclined by an angle [rad], in its own axes.
Gravity inclined(double angle, double along = 1)
{
    return {.acceleration = {along * g * std::sin(angle), -g * std::cos(angle), 0}};
}

/// How far the furthest particle of a body beside a smooth wall moves in half a second after its weight came
/// on [m].
double moved(Sand<Plane> const& sand, Points const& points, double h)
{
    SandScene::Solver solver(lattice(h), sand);
    solver.add(points, h * h / 4);
    ReflectingWall const wall{.axis = 0};
    int const parts = 20;
    for (int i = 0; i < parts; ++i)
        solver.advance(0.5 / parts, Gravity{.acceleration = {0, -g * (i + 0.5) / parts, 0}}, rough_floor(),
                       wall);
    auto const before = solver.positions();
    solver.advance(0.5, Gravity{}, rough_floor(), wall);
    auto const after = solver.positions();
    double most = 0;
    for (std::size_t i = 0; i < after.size(); ++i) most = std::max(most, (after[i] - before[i]).norm());
    return most;
}

/// A wedge of sand on a rough floor.
double moved_of_wedge(Sand<Plane> const& sand, double slope)
{
    double const h = 0.04, height = 0.52, top = 0.2;
    Points points;
    for (auto const& x : box_of_points<2>({0, 0}, {2, height}, h))
        if (x.y() < height - std::max(0.0, x.x() - top) * std::tan(slope)) points.push_back(x);
    return moved(sand, points, h);
}

/// The acceleration [m/s^2] of the middle of a long layer on a rough incline, without its lower half. Its
/// ends are free, and too far away to be felt so soon.
Vector<double, 2> acceleration_of_layer(Sand<Plane> const& sand, double angle)
{
    double const h = 0.025, length = 2, depth = 0.1;
    SandScene::Solver solver(lattice(h), sand);
    solver.add(box_of_points<2>({0, 0}, {length, depth}, h), h * h / 4);
    int const parts = 10;
    for (int i = 0; i < parts; ++i) {
        Gravity const part{.acceleration = inclined(angle, 0).acceleration * (i + 0.5) / parts};
        solver.advance(0.3 / parts, part, rough_floor());
    }
    for (int i = 0; i < parts; ++i)
        solver.advance(0.1 / parts, inclined(angle, (i + 0.5) / parts), rough_floor());
    auto const velocity = [&] {
        Vector<double, 2> sum = Vector<double, 2>::Zero();
        int count = 0;
        auto const x = solver.positions();
        auto const v = solver.download<Velocity>();
        for (std::size_t i = 0; i < x.size(); ++i)
            if (std::abs(x[i].x() - length / 2) < 0.1 * length && x[i].y() > depth / 2) sum += v[i], ++count;
        return Vector<double, 2>(sum / count);
    };
    solver.advance(0.05, inclined(angle), rough_floor());
    auto const before = velocity();
    double const duration = 0.1;
    solver.advance(duration, inclined(angle), rough_floor());
    return (velocity() - before) / duration;
}

/// That of a block which rides on a thin band that bears the friction, and is lifted by its dilatancy: the
/// band carries rho (g cos a + tan(psi) a_x) per depth.
double acceleration_of_block(double angle, double friction, double dilatancy_angle)
{
    return g * (std::sin(angle) - friction * std::cos(angle)) / (1 + friction * std::tan(dilatancy_angle));
}

/// Davis' (1968) friction in a band: sin phi cos psi / (1 - sin phi sin psi).
double friction_of_band(double phi, double psi)
{
    return std::sin(phi) * std::cos(psi) / (1 - std::sin(phi) * std::sin(psi));
}

Sand<Plane> sand_of(double phi, double psi = 0, Friction measured_on = Friction::standing)
{
    auto sand = materials::dry_sand<Plane>();
    sand.cone = friction_cone(2, phi, measured_on, psi);
    sand.dilatancy = dilatancy_cone(2, psi);
    return sand;
}

} // namespace

TEST_CASE("a wedge of sand stands below its angle of friction, and flows above")
{
    CHECK(moved_of_wedge(sand_of(30 * degrees), 26 * degrees) <= 1e-3);
    CHECK(moved_of_wedge(sand_of(30 * degrees), 35 * degrees) >= 0.05);
    CHECK(moved_of_wedge(sand_of(40 * degrees), 35 * degrees) <= 1e-3);
}

TEST_CASE("a layer of sand flows from atan(sin phi) without dilatancy, and from phi with associated flow")
{
    double const phi = 30 * degrees;
    for (double psi : {0.0, 10 * degrees, phi}) {
        double const band = friction_of_band(phi, psi), angle = std::atan(band);
        CAPTURE(psi, angle / degrees);
        auto const flowing = acceleration_of_layer(sand_of(phi, psi), angle + 6 * degrees);
        double const expected = acceleration_of_block(angle + 6 * degrees, band, psi);
        CHECK(flowing.x() == Approx(expected).epsilon(0.03));
        CHECK(flowing.y() == Approx(expected * std::tan(psi)).margin(0.06 * expected));
        CHECK(acceleration_of_layer(sand_of(phi, psi), angle - 4 * degrees).norm() <= 0.05 * expected);
    }
}

TEST_CASE("a cone that is given by the angle of flow flows from there")
{
    for (double psi : {0.0, 10 * degrees}) {
        auto const sand = sand_of(30 * degrees, psi, Friction::flowing);
        CAPTURE(psi);
        CHECK(acceleration_of_layer(sand, 36 * degrees).x() ==
              Approx(acceleration_of_block(36 * degrees, std::tan(30 * degrees), psi)).epsilon(0.03));
        CHECK(acceleration_of_layer(sand, 26 * degrees).norm() <= 0.05);
    }
}

// The critical height of a vertical cut, 4 c tan(45 + phi/2) / (rho g), is that of a plane wedge which slides
// (Terzaghi 1943, *Theoretical Soil Mechanics*): an upper bound. Without tension a crack reduces it by a
// third.
TEST_CASE("a vertical cut stands with twice the cohesion of its critical height, and falls with half of it")
{
    double const height = 0.4, h = 0.04, phi = 30 * degrees;
    auto sand = sand_of(phi);
    double const critical = double(sand.density) * g * height / (4 * std::tan(M_PI / 4 + phi / 2));
    auto const points = box_of_points<2>({0, 0}, {0.6, height}, h);
    for (double cutoff : {sand.tension_cutoff, 0.0}) {
        sand.tension_cutoff = cutoff;
        sand.cohesion = 2 * critical;
        CHECK(moved(sand, points, h) <= 1e-3);
        sand.cohesion = 0.5 * critical;
        CHECK(moved(sand, points, h) >= 0.1);
    }
}
