// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/driven.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

constexpr int driven_count = 2000;

/// Drives particles into the corner of three walls that mirror.
template <class Number>
Driven drive_into_corner(int count, int steps)
{
    ReflectingWall const walls[]{{.axis = 0, .node = -10, .side = 1},
                                 {.axis = 1, .node = 10, .side = -1},
                                 {.axis = 2, .node = -10, .side = 1}};
    auto const surface = [&](double, Vector<double, 3> const& x) {
        std::pair nearest(1e9, Vector<double, 3>(Vector<double, 3>::Zero()));
        for (auto const& wall : walls) {
            double const distance = wall.side * (x[wall.axis] - wall.node * cell);
            if (distance < nearest.first)
                nearest = {distance, wall.side * Vector<double, 3>::Unit(wall.axis)};
        }
        return nearest;
    };
    return drive_at<Number, 3>(count, steps, false, surface, [&](auto& solver, double frame) {
        return solver.advance(frame, walls[0], walls[1], walls[2]);
    });
}

/// A ball with a dent, as a grid of distances.
template <class Number>
SignedDistanceGrid<Number, 3> dented_ball()
{
    int const nodes = 41;
    std::vector<Number> values;
    Vector<double, 3> const dent(0, 0.5, 0);
    for (int k = 0; k < nodes; ++k)
        for (int j = 0; j < nodes; ++j)
            for (int i = 0; i < nodes; ++i) {
                Vector<double, 3> const x =
                    Vector<double, 3>(i, j, k) * 0.03 - Vector<double, 3>::Constant(0.6);
                values.push_back(Number(std::max(x.norm() - 0.45, 0.25 - (x - dent).norm())));
            }
    return {
        Vector<Number, 3>::Constant(Number(-0.6)), Number(0.03), {nodes, nodes, nodes}, std::move(values)};
}

template <class Number>
HeightField<Number, 3> hills()
{
    std::vector<Number> heights;
    for (int k = 0; k < 21; ++k)
        for (int i = 0; i < 21; ++i) heights.push_back(Number(0.15 * std::sin(0.7 * i) * std::cos(0.5 * k)));
    return {{-1, -1}, Number(0.1), {21, 21}, std::move(heights)};
}

/// In place of an obstacle of a shape that is not tried.
struct NotTried
{};

/// Drives particles at every shape of which `wrap` makes an obstacle: `use(name, driven)`. A half-space turns
/// so slowly that its surface is not much faster than the particles where they are; terrain stays upright.
template <class Number, class Wrap, class Use>
void for_each_shape(int count, int steps, Wrap const& wrap, Use const& use)
{
    auto const run = [&](char const* name, auto const& shape, Swing const& swing) {
        auto const there = [&] {
            if constexpr (requires { shape.on(TestedBackend{}); })
                return shape.on(TestedBackend{});
            else
                return shape;
        }();
        if constexpr (!std::is_same_v<decltype(wrap(there)), NotTried>)
            use(name, drive<Number, 3>(count, steps, shape, wrap(there), swing));
    };
    Eigen::Vector3d const turn(1, -2, 3);
    run("half-space", HalfSpace{Eigen::Vector3d(0.6, 0.64, 0.48)}, {.reach = 0.2});
    run("turning half-space", HalfSpace{}, {.reach = 0.1, .turn = {1, 0, 2}});
    run("box", Box{{0.3, 0.4, 0.35}}, {.reach = 0.2, .turn = turn});
    run("box at rest", Box{{0.3, 0.4, 0.35}}, {});
    run("sphere", Sphere{0.4}, {.reach = 0.2, .turn = turn});
    run("capsule", Capsule{0.25, 0.2}, {.reach = 0.2, .turn = turn});
    run("distance grid", dented_ball<Number>(), {.reach = 0.2, .turn = turn});
    run("height field", hills<Number>(), {.reach = 0.2});
}

template <class Number>
void check_solids(int count, int steps, bool on_particles)
{
    // Nodes alone stop what they move: a particle is free of nodes outside once its kernel is inside, at the
    // latest where a corner of it is, 1.5 cells along each axis away. Behind an edge that holds only because
    // nothing slides deep inside (see Obstacle): else a box at rest is pierced to its middle, 6 cells deep.
    double const reach = 1.5 * std::sqrt(3.0);
    // Particles are pushed out at once, as exactly as the distance is. On the rim of the dent the normals of
    // both sides are 94 degrees apart; where samples lie on both, the distance rises by cos 47 = 0.68 of the
    // way along the normal only, and a push, of a quarter of a cell at most, falls short by that much.
    double const rounding = 1e-5, sampled = 0.25 * (1 - 0.68);
    for_each_shape<Number>(
        count, steps,
        [&](auto const& shape) {
            return Obstacle<std::decay_t<decltype(shape)>>{.shape = shape, .on_particles = on_particles};
        },
        [&](char const* name, Driven const& driven) {
            CAPTURE(name, driven.steps, driven.longest, driven.mean);
            bool const is_sampled = std::string(name) == "distance grid";
            CHECK(driven.deepest <= (!on_particles ? reach : is_sampled ? sampled : rounding));
            if (on_particles) CHECK(driven.last <= 1e-3);
            CHECK(driven.mean < 1); // they are at the obstacle
        });
}

/// Whether particles are driven at a shell of a shape, which takes time to compile. Of those without edges a
/// plane is enough.
template <class Shape>
constexpr bool is_shell_tried =
#if defined(FIRN_TESTS_ALL)
    true;
#else
    !(std::is_same_v<Shape, Sphere> || std::is_same_v<Shape, Capsule>);
#endif

template <class Number>
void check_shells(int count, int steps)
{
    for_each_shape<Number>(
        count, steps,
        [&]<class Shape>(Shape const& shape) {
            // nvcc forgets what a lambda requires when the host's code is compiled, not that of the device
            if constexpr (is_shell_tried<Shape>)
                return Obstacle<Shell<Shape>>{.shape = {shape, 0.05 * cell}};
            else
                return NotTried{};
        },
        [&](char const* name, Driven const& driven) {
            CAPTURE(name, driven.steps, driven.longest, driven.mean);
            CHECK(driven.deepest <= 0);
            CHECK(driven.mean < 1);
        });
}

void check_walls(int count, int steps)
{
    // They move with the grid. Its velocity across the wall is zero there.
    auto const driven = drive_into_corner<float>(count, steps);
    CAPTURE(driven.steps, driven.longest, driven.mean);
    CHECK(driven.deepest <= 1e-6);
    CHECK(driven.mean < 1);
}

} // namespace

TEST_CASE("nothing passes into a moving solid by more than the reach of the kernel, whatever drives it")
{
    check_solids<float>(driven_count, 200, false);
}

TEST_CASE("with contact of the particles too nothing is inside a moving solid")
{
    check_solids<float>(driven_count, 200, true);
}

// The first step after it was passed, too: nothing has touched it yet, so no step before has found its speed.
TEST_CASE("how fast a solid made of distances turns bounds steps before anything touches it")
{
    auto const shape = dented_ball<float>();
    auto const there = shape.on(TestedBackend{});
    Solver<TestedBackend, Dust<SolidFloat>, QuadraticBSpline, Mls> solver(lattice(cell));
    solver.add(std::vector<Eigen::Vector3d>{{3, 0, 0}}, 1e-3);
    double const turns = 50; // [rad/s]
    Obstacle<std::decay_t<decltype(there)>> const wheel{
        .shape = there, .motion = {.angular_velocity = {0, 0, turns}, .time = 0}};
    auto const report = solver.advance(0.05, wheel);
    double const fastest = 0.45 * turns; // of its surface
    CHECK(report.usual_limit() == StepLimit::obstacle);
    CHECK(report.largest_dt * fastest <= 0.5 * cell);
    CHECK(report.largest_dt * fastest >= 0.3 * cell); // and not by more than it has to
}

// Pairs of particles in one place: their own velocities cancel on the grid, which moves both alike.
TEST_CASE("what flies at an obstacle by a velocity of its own, but moves with the grid, is not pushed away")
{
    for (double slide : {0.0, 1.0}) {
        Scene<Dust<Plane>, QuadraticBSpline, Flip>::Solver solver(lattice(cell), {}, Flip{.fraction = 1});
        double const depth = 1e-3 * cell, dt = 1e-3;
        std::vector<Eigen::Vector2d> points, velocities;
        for (double x : {0.1, 0.52, 1.17})
            for (double way : {1.0, -1.0}) {
                points.emplace_back(x, -depth);
                velocities.emplace_back(slide + 0.5 * speed * way, speed * way);
            }
        solver.add(points, 1e-3);
        solver.upload<Velocity>(velocities);
        Obstacle<HalfSpace> const floor{.contact = Contact::slip(), .on_particles = true};
        solver.step(dt, floor);
        auto const moved = solver.positions();
        auto const left = solver.download<Velocity>();
        for (std::size_t i = 0; i < points.size(); ++i) {
            CHECK(moved[i].x() == Approx(points[i].x() + slide * dt).epsilon(1e-12));
            CHECK(std::abs(moved[i].y()) <= 1e-9 * cell); // by its depth, and no more
            CHECK(left[i].y() == Approx(std::max(velocities[i].y(), 0.0)));
        }
    }
}

TEST_CASE("nothing passes through a shell a twentieth of a cell thick, from either side, however it moves")
{
    check_shells<float>(driven_count, 200);
#if defined(FIRN_TESTS_ALL) // corners.cpp has shells in double precision
    check_shells<double>(500, 200);
#endif
}

TEST_CASE("nothing passes through reflecting walls, or out of the corner between them")
{
    check_walls(2000, 200);
}

TEST_CASE("1e5 particles do not pass into a solid in 2 000 steps", "[.full]")
{
    check_solids<float>(100000, 2000, false);
}

TEST_CASE("nor do they with contact of their own", "[.full]") { check_solids<float>(100000, 2000, true); }

TEST_CASE("1e5 particles do not pass through a shell in 2 000 steps", "[.full]")
{
    check_shells<float>(100000, 2000);
}

TEST_CASE("1e5 particles do not pass through reflecting walls in 2 000 steps", "[.full]")
{
    check_walls(100000, 2000);
}
