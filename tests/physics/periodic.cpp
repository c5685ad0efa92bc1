// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"

#include <firn/assign.hpp>
#include <firn/effects/force.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/shapes/any_shape.hpp>
#include <firn/effects/shapes/cylinder.hpp>
#include <firn/effects/shapes/union.hpp>
#include <firn/io/checkpoint.hpp>
#include <firn/mark_face.hpp>
#include <firn/transfer/loaded_surfaces.hpp>
#include <firn/transfer/marks.hpp>

#include <cmath>
#include <sstream>
#include <vector>

using namespace firn;
using namespace firn::test;

namespace
{

double const h = 0.05, pi = 3.14159265358979323846;

using InPlane = Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver;
using InSpace = Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>::Solver;

/// What lies between the reference point and a length along an axis: a region of a user's own.
struct Ahead
{
    int axis;
    double length;

    double reach() const { return length; }
    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        SurfaceSample<Real, d> sample;
        for (int a = 0; a < d; ++a) sample.normal[a] = Real(a == axis ? 1 : 0);
        sample.distance = max(x[axis] - Real(length), -x[axis]);
        return sample;
    }
};

/// The same, but it says that its images do not part it.
struct Fitting : Ahead
{
    AlongAxis along(Eigen::Vector3d const&) const { return {length, true}; }
};

/// A shape whose values are where the tested backend reads them.
template <class ShapeType>
auto where_it_is_read(ShapeType const& shape)
{
    if constexpr (TestedBackend::reaches_host_memory)
        return shape;
    else
        return shape.on(TestedBackend{});
}

/// The distance between two points where the nearest images of x are meant.
double apart(double one, double other, double period) { return std::remainder(one - other, period); }

} // namespace

TEMPLATE_TEST_CASE("what leaves a period comes in at its other end", "[physics][periodic]", InPlane, InSpace)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    int const axis = GENERATE(0, d - 1);
    int const cells = 16;
    double const period = cells * h, dt = 5e-4;
    double const rounding = std::is_same_v<typename TestType::Number, float> ? 2e-5 : 1e-10;
    Vec low = Vec::Constant(0.1), velocity = Vec::Constant(0.3);
    velocity[axis] = -8; // several times through
    auto const points = box_of_points<d>(low, low + Vec::Constant(0.25), h);
    TestType around(lattice(h).periodic(axis, cells)), unbounded(lattice(h));
    // a ball meets the block at the end of the period: it and its image are one
    Obstacles<> ball{{{.shape = Sphere{0.065}, .contact = Contact::slip()}}};
    ball.list[0].motion.position.template head<d>() = low + Vec::Constant(0.113);
    ball.list[0].motion.position[axis] = low[axis] - 0.413; // not on a node, where normals have no direction
    ball.list[0].motion.velocity[axis] = -5;
    ball.list[0].motion.time = 0.0;
    Obstacles<> images = ball;
    for (int k = -2; k < 5; ++k) {
        if (k == 0) continue;
        images.list.push_back(ball.list[0]);
        images.list.back().motion.position[axis] -= k * period;
    }
    ball.list[0].motion.position[axis] += 7 * period;
    around.add(points, std::pow(h / 2, d), velocity);
    unbounded.add(points, std::pow(h / 2, d), velocity);
    Reaction received, with_images;
    for (int call = 0; call < 4; ++call) {
        for (auto const& report : around.steps(100, dt, ball)) received += report.reactions[0];
        for (auto const& report : unbounded.steps(100, dt, images))
            for (auto const& reaction : report.reactions) with_images += reaction;
        if (call == 1) { // to a stream and back
            std::stringstream stream;
            write_checkpoint(stream, around);
            TestType other(lattice(h).periodic(axis, cells));
            read_checkpoint(stream, other);
            around = std::move(other);
        }
    }
    auto const x = around.positions(), y = unbounded.positions();
    double most = 0;
    for (std::size_t i = 0; i < x.size(); ++i) {
        REQUIRE(x[i][axis] >= 0);
        REQUIRE(x[i][axis] < period);
        for (int a = 0; a < d; ++a)
            most = std::max(most, std::abs(a == axis ? apart(x[i][a], y[i][a], period) : x[i][a] - y[i][a]));
    }
    CHECK(most < rounding);
    CHECK(std::abs(y[0][axis]) > period); // it did go around
    CHECK(with_images.impulse.norm() > 0);
    CHECK((received.impulse - with_images.impulse).norm() < 100 * rounding * with_images.impulse.norm());
    CHECK(around.occupancy().pieces == 1);
    CHECK(around.occupancy().cells_with == unbounded.occupancy().cells_with);
    CHECK(around.occupancy().per_cell == Approx(unbounded.occupancy().per_cell));
}

TEST_CASE("a shear wave in a periodic box swings in its period, and the box is one piece without a border",
          "[physics][periodic]")
{
    int const cells = 32;
    double const length = cells * h, amplitude = 1e-3;
    InPlane solver(lattice(h).periodic(0, cells).periodic(1, 16));
    auto const points = box_of_points<2>({0, 0}, {length, 16 * h}, h);
    solver.add(points, h * h / 4);
    std::vector<Eigen::Vector2d> velocities;
    for (auto const& x : points) velocities.push_back({0, amplitude * std::cos(2 * pi * x[0] / length)});
    solver.upload<Velocity>(velocities);
    auto const& model = solver.model();
    double const wave = length / std::sqrt(model.elasticity.mu / model.density);
    CHECK(solver.occupancy().pieces == 1);
    CHECK(solver.occupancy().per_cell == 4);
    CHECK(solver.totals().mass == Approx(model.density * length * 16 * h));
    auto const momentum = solver.totals().momentum;
    // the share of the first mode in the velocities: it is 0 after a quarter of a period, and -1 after a half
    auto const mode = [&] {
        auto const v = solver.download<Velocity>();
        double sum = 0;
        for (std::size_t i = 0; i < v.size(); ++i) sum += v[i][1] * std::cos(2 * pi * points[i][0] / length);
        return 2 * sum / (amplitude * double(v.size()));
    };
    int const steps = 100; // of a quarter, so that velocities are hardly half a step behind
    solver.steps(steps, wave / 4 / steps);
    CHECK(std::abs(mode()) < 0.02);
    solver.steps(steps, wave / 4 / steps);
    CHECK(mode() == Approx(-1).epsilon(0.02));
    solver.steps(2 * steps, wave / 4 / steps);
    CHECK(mode() == Approx(1).epsilon(0.02));
    CHECK((solver.totals().momentum - momentum).norm() < 1e-12 * amplitude * solver.totals().mass);
    auto const x = solver.positions();
    auto const sampled =
        solver.sample(std::vector<Eigen::Vector2d>{{0, 0.1}, {length - 1e-6, 0.1}, {0.3, 0.1}});
    for (auto const& at : sampled) CHECK(at.density == Approx(model.density).epsilon(0.01));
}

TEST_CASE("cells at the corner of two periods are neighbours", "[physics][periodic]")
{
    InPlane solver(lattice(h).periodic(0, 32).periodic(1, 16));
    solver.add(box_of_points<2>({0, 0}, {32 * h, 16 * h}, h), h * h / 4);
    solver.add(std::vector<Eigen::Vector2d>(4, {0.1 * h, 15.1 * h}), h * h / 4); // in the cell (0, 15)
    CHECK(solver.occupancy().per_cell == Approx(4 + 4.0 / (32 * 16)).epsilon(1e-9));
    CHECK(solver.occupancy().cells == 32 * 16);
}

TEMPLATE_TEST_CASE("a region across the end of a period has the particles of both ends",
                   "[physics][periodic]", InPlane, InSpace)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    int const axis = GENERATE(0, d - 1);
    double const period = 16 * h;
    TestType solver(lattice(h).periodic(axis, 16));
    Vec high = Vec::Constant(0.2);
    high[axis] = period;
    solver.add(box_of_points<d>(Vec::Zero(), high, h), std::pow(h / 2, d));
    auto const all = solver.size(), of_row = all / 32; // rows are h / 2 apart
    Eigen::Vector3d half(1, 1, 1), at(0, 0, 0);
    half[axis] = 2 * h;
    // it reaches from two cells below the border to two above it, wherever its reference point is counted
    for (int const around : {0, 1, -3}) {
        at[axis] = around * period;
        auto const region = Inside<Box>{{half}, {.position = at}};
        auto const count = [&](auto const& predicate) {
            auto copy = solver.snapshot();
            auto const removed = solver.remove_if(predicate);
            solver.restore(copy);
            return removed;
        };
        CHECK(count(region) == 8 * of_row);
        CHECK(count(Outside<Box>{{half}, {.position = at}}) == all - 8 * of_row);
        // longer than half a period, and seen from its middle; across the axis all particles are in it
        Eigen::Vector3d long_one = half;
        long_one[axis] = 6 * h;
        CHECK(count(Inside<Box>{{long_one}, {.position = at}}) == 24 * of_row);
        // seen from its end, so that its nearest image has a part of it alone
        CHECK(count(Inside<Ahead>{{axis, 12 * h}, {.position = at}}) == 24 * of_row);
        CHECK(count(Inside<Ahead>{{axis, 40 * h}, {.position = at}}) == all);
        if (axis == 0) CHECK(count(Inside<HalfSpace>{{{0, 1, 0}}, {.position = {0, 2 * h, 0}}}) == all / 2);
    }
    Eigen::Vector3d along = Eigen::Vector3d::Zero();
    along[axis] = 1;
    auto const error = refused([&] { solver.remove_if(Inside<HalfSpace>{{along}}); });
    CHECK_THAT(error.what_is_wrong(), Contains("unbounded"));
    along[axis] = 0.6;
    along[axis == 0 ? 1 : 0] = 0.8;
    refused([&] { solver.remove_if(Outside<HalfSpace>{{along}}); });
    CHECK(solver.size() == all);
}

TEST_CASE("fields are assigned, and faces marked, on both sides of a border", "[physics][periodic]")
{
    using Loaded = Scene<NeoHookean<Plane>, QuadraticBSpline, Carrying<Mls, LoadedSurfaces, Marks<Mark>>>;
    Loaded::Solver solver(lattice(h).periodic(0, 16));
    solver.add(box_of_points<2>({0, 0}, {16 * h, 4 * h}, h), h * h / 4);
    Inside<Box> const corner{{{2 * h, h / 2, 1}}, {.position = {0, 4 * h, 0}}};
    CHECK(assign<Mark>(solver, corner, 1) == 8);
    CHECK(mark_face(solver, corner, {0, 4 * h}) == 8);
    auto const x = solver.positions();
    auto const marks = solver.download<Mark>();
    for (std::size_t i = 0; i < x.size(); ++i)
        CHECK((marks[i] > 0) == (x[i][1] > 3.5 * h && (x[i][0] < 2 * h || x[i][0] > 14 * h)));
    refused([&] { assign<Mark>(solver, Inside<HalfSpace>{{{1, 0, 0}}}, 1); });
    refused([&] { mark_face(solver, Inside<HalfSpace>{{{1, 0, 0}}}, {1, 0}); });
    // regions of several parts, or of a kind that is chosen at run time
    Union<Box, Sphere> const parts{{{.shape = corner.shape}, {.shape = {1e-3}, .position = {h, 0, 0}}}};
    CHECK(assign<Mark>(solver, Inside<Union<Box, Sphere>>{parts, corner.pose}, 0.5) == 8);
    CHECK(mark_face(solver, Inside<AnyShape<>>{corner.shape, corner.pose}, {0, h}) == 8);
    auto const saved = solver.snapshot();
    CHECK(solver.remove_if(Inside<Union<Box, Sphere>>{parts, corner.pose}) == 8);
    CHECK(solver.remove_if(Outside<AnyShape<>>{Box{{9, h, 1}}, {.position = {0, h, 0}}}) == x.size() / 2 - 8);
    solver.restore(saved);
    // held by a region across the border: they all move
    Held<Box> const held{
        .shape = {{2 * h, 10, 1}}, .motion = {.time = 0.0}, .velocity = Eigen::Vector3d(0, 0.1, 0)};
    solver.advance(0.01, held);
    auto const v = solver.download<Velocity>();
    for (std::size_t i = 0; i < x.size(); ++i)
        if (x[i][0] < h / 2 || x[i][0] > 15.5 * h) CHECK(v[i][1] == Approx(0.1));
}

TEST_CASE("shapes that a period would part are refused, and others are not", "[physics][periodic][refusal]")
{
    double const period = 16 * h, c = std::sqrt(0.5);
    InSpace solver(lattice(h).periodic(0, 16));
    solver.add(box_of_points<3>({0.1, 0.1, 0.1}, {0.3, 0.3, 0.3}, h), h * h * h / 8);
    auto const step = [&](auto const& effect) { solver.step(1e-5, effect); };
    auto const is_refused = [&](auto const& effect, char const* what) {
        double const time = solver.time();
        auto const error = refused([&] { step(effect); });
        CHECK_THAT(error.what_is_wrong(), Contains(what));
        CHECK_THAT(error.where(), Contains("effect 1 of Solver::step"));
        CHECK(solver.time() == time);
    };
    Eigen::Quaterniond const about_x(c, c, 0, 0), tilted(std::cos(0.3), 0, 0, std::sin(0.3));
    Motion const turning{.angular_velocity = {0, 0, 1}}, rolling{.angular_velocity = {2, 0, 0}};
    using Floor = Obstacle<HalfSpace>;
    step(Floor{});
    step(Floor{.motion = {.position = {0, -1, 0}, .orientation = about_x}});
    step(Floor{.motion = rolling});
    is_refused(Floor{.shape = {{1, 0, 0}}, .motion = {.position = {-9, 0, 0}}}, "unbounded");
    is_refused(Floor{.shape = {{c, c, 0}}, .motion = {.position = {-9, 0, 0}}}, "unbounded");
    is_refused(Floor{.motion = {.position = {0, -9, 0}, .orientation = tilted}}, "unbounded");
    is_refused(Floor{.motion = {.position = {0, -9, 0}, .angular_velocity = {0, 0, 1e-3}}}, "unbounded");
    is_refused(Held<HalfSpace>{.shape = {{1, 0, 0}}}, "unbounded");
    is_refused(Force<HalfSpace>{.shape = {{1, 0, 0}}}, "unbounded");
    using Long = Obstacle<Box>;
    Motion const below{.position = {0, -30, 0}};
    auto turned = below;
    turned.orientation = tilted;
    step(Long{.shape = {{10, 0.1, 10}}, .motion = below}); // as a floor: it is mirrored
    step(Long{.shape = {{0.3, 0.1, 10}}, .motion = turned});
    is_refused(Long{.shape = {{0.4, 0.4, 10}}, .motion = turned}, "half a period along x");
    is_refused(Long{.shape = {{10, 0.1, 10}}, .motion = turning}, "half a period along x");
    step(Obstacle<Capsule>{.shape = {0.1, 10}, .motion = below});
    turned.orientation = {c, 0, 0, c};
    step(Obstacle<Cylinder>{.shape = {0.1, 10}, .motion = turned}); // along the axis
    turned.orientation = tilted;
    is_refused(Obstacle<Capsule>{.shape = {0.1, 10}, .motion = turned}, "half a period along x");
    step(Obstacle<Sphere>{.shape = {3}, .motion = below});
    step(Obstacle<Ahead>{.shape = {0, 0.39}, .motion = below});
    is_refused(Obstacle<Ahead>{.shape = {0, 0.41}, .motion = below}, "half a period along x");
    step(Obstacle<Fitting>{.shape = {{0, 0.41}}, .motion = below});
    // a union with a part that is an image away, in a list of any shapes, too
    using Two = Union<Sphere, Box>;
    Two const fine{{{.shape = {0.1}, .position = {0.2, 0, 0}}, {.shape = {{10, 0.1, 10}}}}},
        wide{{{.shape = {0.1}, .position = {0.35, 0, 0}}, {.shape = {{0.1, 0.1, 0.1}}}}};
    step(Obstacle<Two>{.shape = fine, .motion = below});
    is_refused(Obstacle<Two>{.shape = wide, .motion = below}, "half a period along x");
    Obstacles<AnyShape<Two>> list{{{.shape = fine, .motion = below}}};
    step(list);
    list.list.push_back({.shape = wide, .motion = below});
    auto const error = refused([&] { step(list); });
    CHECK_THAT(error.where(), Contains("number 1 of Obstacles"));
    list.list[1] = {.shape = HalfSpace{{0.6, 0.8, 0}}, .motion = below};
    is_refused(list, "unbounded");
    is_refused(Obstacle<Shell<Box>>{.shape = {{{0.4, 0.4, 10}}, 0.01}, .motion = turned}, "half a period");
    // a mesh may go on from image to image
    SignedDistanceGrid<float, 3> const mesh({-0.5f, -0.5f, -0.5f}, 0.5f, {3, 3, 3},
                                            std::vector<float>(27, -1.f));
    CHECK(mesh.reach() > period / 2);
    auto const read = where_it_is_read(mesh);
    step(Obstacle<std::remove_const_t<decltype(read)>>{.shape = read, .motion = below});
    // an unbounded lattice knows none of this
    InSpace free(lattice(h));
    free.add(box_of_points<3>({0.1, 0.1, 0.1}, {0.3, 0.3, 0.3}, h), h * h * h / 8);
    free.step(1e-5, Floor{.shape = {{1, 0, 0}}, .motion = {.position = {-9, 0, 0}}});
    free.step(1e-5, Obstacle<Two>{.shape = wide, .motion = below});
}

TEST_CASE("the energy of height is refused along a periodic axis, and given across it", "[physics][periodic]")
{
    InPlane solver(lattice(h).periodic(0, 16));
    solver.add(box_of_points<2>({0, 0}, {16 * h, 4 * h}, h), h * h / 4);
    auto const totals = solver.totals();
    CHECK(solver.energy(Gravity{{0, -10, 0}}).gravitational ==
          Approx(10 * totals.mass * totals.centre_of_mass[1]));
    CHECK(solver.energy().total() == 0);
    auto const error = refused([&] { (void)solver.energy(Gravity{{1e-3, -10, 0}}); });
    CHECK_THAT(error.what_is_wrong(), Contains("no potential"));
}

TEST_CASE("periods that cannot be are refused", "[physics][periodic][refusal]")
{
    auto const what = [](auto const& call) { return refused(call).what_is_wrong(); };
    CHECK_THAT(what([] { lattice(h).periodic(3, 16); }), Contains("no such axis"));
    CHECK_THAT(what([] { lattice(h).periodic(0, 0); }), Contains("the period is not"));
    CHECK_THAT(what([] { InPlane{lattice(h).periodic(2, 16)}; }), Contains("two dimensions"));
    if (InPlane::MaterialTraits<>::Table::CellOrder::extent(0) > 1)
        CHECK_THAT(what([] { InPlane{lattice(h).periodic(0, 17)}; }), Contains("a multiple of"));
    Lattice made = lattice(h);
    made.periods = {-16, 0, 0};
    CHECK_THAT(what([&] { InPlane{made}; }), Contains("the period is not"));
    made = lattice(h);
    made.half_world = 3;
    CHECK_THAT(what([&] { InPlane{made}; }), Contains("half_world"));
    InPlane solver(lattice(h).periodic(0, 16));
    solver.add(box_of_points<2>({0.1, 0.1}, {0.2, 0.2}, h), h * h / 4);
    CHECK_THAT(what([&] { solver.advance(0.01, ReflectingWall{.axis = 0}); }), Contains("periodic"));
    auto const snapshot = solver.snapshot();
    InPlane other(lattice(h));
    CHECK_THAT(what([&] { other.restore(snapshot); }), Contains("a period in cells along x"));
    solver.advance(0.01, ReflectingWall{.axis = 1});
}
