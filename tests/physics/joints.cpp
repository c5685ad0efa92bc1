// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/dust.hpp"
#include "support/policies.hpp"

#include <firn/contact_points.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/shapes/union.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

// Boxes that only touch: they have a face in common, or no more than an edge.
using namespace firn;
using namespace firn::test;

namespace
{

constexpr double cell = 0.05, speed = 3; // [m], [m/s]
#if defined(__CUDACC__)
constexpr int dust = 300; // a device handles the particles of a cell one after another
#else
constexpr int dust = sample_of(300, 1000);
#endif

using OneBox = Union<Box>;

/// Boxes that meet at the origin, around what is open: all that lies before these faces.
struct Joint
{
    char const* name;
    std::vector<Placed<Box>> boxes;
    std::vector<Eigen::Vector3d> normals; ///< of the open faces
};

Placed<Box> between(Eigen::Vector3d const& low, Eigen::Vector3d const& high)
{
    return {.shape = {0.5 * (high - low)}, .position = 0.5 * (low + high)};
}

/// Two boards that lean against each other, at this angle [radians], and have their lower edges in common.
Joint boards_at(double angle)
{
    Joint joint{"leaning", {}, {}};
    for (double const side : {-1.0, 1.0}) {
        Eigen::Vector3d const up(side * std::sin(angle / 2), std::cos(angle / 2), 0),
            normal(-side * up.y(), side * up.x(), 0);
        joint.boxes.push_back({.shape = {{0.25, 0.6, 2}},
                               .position = 0.6 * up - 0.25 * normal,
                               .orientation = Eigen::Quaterniond(
                                   Eigen::AngleAxisd(-side * angle / 2, Eigen::Vector3d::UnitZ()))});
        joint.normals.push_back(normal);
    }
    return joint;
}

template <int d>
std::vector<Joint> joints()
{
    double const far = 1, thick = 0.5;
    auto const floor = [&](double from, double to) { return between({from, -thick, -far}, {to, 0, far}); };
    std::vector<Eigen::Vector3d> const corner{{1, 0, 0}, {0, 1, 0}};
    auto const wall = [&](double from) { return between({-thick, from, -far}, {0, far, far}); };
    std::vector<Joint> all{{"a wall on a floor", {floor(-far, far), wall(0)}, corner},
                           {"a wall beside a floor", {floor(0, far), wall(-thick)}, corner},
                           {"a wall with an edge of a floor", {floor(0, far), wall(0)}, corner},
                           {"tiles side by side", {floor(-far, 0), floor(0, far)}, {{0, 1, 0}}},
                           boards_at(M_PI / 3),
                           boards_at(M_PI / 6)};
    if (d == 3) {
        auto with_end = corner;
        with_end.push_back({0, 0, 1});
        auto const end = [&](double from_x, double from_y) {
            return between({from_x, from_y, -far}, {far, far, 0});
        };
        all.push_back({"a corner on a floor", {floor(-far, far), wall(0), end(0, 0)}, with_end});
        all.push_back({"a corner beside a floor",
                       {between({0, -thick, 0}, {far, 0, far}), wall(-thick), end(0, -thick)},
                       with_end});
    }
    return all;
}

/// Of the dust that is driven at a joint.
struct Outcome
{
    double deepest = -1e9; ///< behind one of the open faces [cells]
    double unbooked = 0;   ///< momentum, as a share of what there is
    double mean = 0;       ///< distance from the nearest of them at the end [cells]
};

/// Every few steps all particles get the speed again, towards the joint and a little beside it.
template <class Space, class Transfer, ActsOn acts_on>
Outcome drive(Joint const& joint, Motion const& motion, bool is_reversed, int count, int frames)
{
    using Number = typename Space::Scalar;
    constexpr int d = Space::dimension;
    typename Scene<Dust<Space>, QuadraticBSpline, Transfer>::Solver solver(lattice(cell));
    std::mt19937 random(6);
    std::uniform_real_distribution<double> unit(-1, 1);
    auto const own = [&](Vector<double, d> const& x) {
        Eigen::Vector3d away = Eigen::Vector3d::Zero();
        away.template head<d>() = x;
        Motion const now = motion.at(solver.time());
        return Eigen::Vector3d(now.orientation.inverse() * (away - now.position));
    };
    auto const before = [&](Vector<double, d> const& x) {
        double least = 1e9;
        for (auto const& normal : joint.normals) least = std::min(least, normal.dot(own(x)) / cell);
        return least;
    };
    std::vector<Vector<double, d>> points;
    while (int(points.size()) < count) {
        Vector<double, d> x;
        for (int a = 0; a < d; ++a) x[a] = 0.5 * unit(random);
        x += motion.position.template head<d>();
        if (before(x) > 0.1) points.push_back(x);
    }
    solver.add(points, 1.0 / count);
    Obstacles<AnyShape<OneBox>, acts_on> boxes;
    for (auto const& box : joint.boxes)
        boxes.list.push_back({.shape = OneBox{{box}}, .motion = motion, .on_particles = true});
    if (is_reversed) std::reverse(boxes.list.begin(), boxes.list.end());

    Outcome outcome;
    std::vector<Vector<Number, d>> velocities(points.size());
    for (int frame = 0; frame < frames; ++frame) {
        auto const at = solver.positions();
        Vector<double, d> const target = motion.at(solver.time()).position.template head<d>();
        for (std::size_t i = 0; i < at.size(); ++i) {
            Vector<double, d> towards = target - at[i];
            towards /= towards.norm() + 1e-6;
            for (int a = 0; a < d; ++a) towards[a] += 0.3 * unit(random);
            velocities[i] = (towards.normalized() * speed).template cast<Number>();
        }
        solver.template upload<Velocity>(velocities);
        Vector<double, d> expected = Totals(solver).momentum;
        auto const report = solver.advance(0.9 * cell / speed, boxes);
        for (auto const& received : report.reactions) expected -= received.impulse.template head<d>();
        Totals const now(solver);
        outcome.unbooked = std::max(outcome.unbooked, (now.momentum - expected).norm() / (now.mass * speed));
        outcome.mean = 0;
        for (auto const& x : solver.positions()) {
            outcome.deepest = std::max(outcome.deepest, -before(x));
            outcome.mean += before(x) / count;
        }
    }
    return outcome;
}

Motion turned(double angle)
{
    return {.position = {0.013, 0.021, 0},
            .orientation = Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())),
            .time = 0};
}

template <class Space, class Transfer, ActsOn acts_on>
void check(Joint const& joint, Motion const& motion, int count, int frames)
{
    bool const is_float = std::is_same_v<typename Space::Scalar, float>;
    for (bool const is_reversed : {false, true}) {
        auto const outcome = drive<Space, Transfer, acts_on>(joint, motion, is_reversed, count, frames);
        CAPTURE(joint.name, motion.orientation.w(), is_reversed, outcome.mean);
        CHECK(outcome.deepest <= 1e-4);
        CHECK(outcome.unbooked <= (is_float ? 1e-4 : 1e-10));
        CHECK(outcome.mean < 3);
    }
}

} // namespace

TEST_CASE("nothing that is driven at a joint of boxes that only touch gets into it")
{
    for (auto const& joint : joints<2>())
        for (double const angle : {0.0, 0.3, M_PI / 4}) {
            check<Plane, Mls, ActsOn::surface_and_particles>(joint, turned(angle), dust, 40);
            check<Plane, Apic, ActsOn::particles>(joint, turned(angle), dust, 40);
        }
}

TEST_CASE("nor does it where they move together")
{
    for (auto const& joint : joints<2>())
        for (double const direction : {-1.0, 1.0}) {
            Motion motion = turned(0.3);
            motion.velocity = {direction, 2 * direction, 0};
            motion.angular_velocity = {0, 0, 2 * direction};
            check<Plane, Mls, ActsOn::surface_and_particles>(joint, motion, dust, 20);
            check<Plane, Asflip, ActsOn::particles>(joint, motion, dust, 20);
        }
}

TEST_CASE("nor in space")
{
    for (auto const& joint : joints<3>()) {
        Motion motion = turned(0.3);
        motion.orientation =
            motion.orientation * Eigen::Quaterniond(Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitX()));
        check<SolidFloat, Mls, ActsOn::surface_and_particles>(joint, motion, dust, 20);
    }
}

TEST_CASE("tiles side by side act at the points of one floor")
{
    for (double const angle : {0.0, 0.3, M_PI / 4})
        for (double const edge : {0.0, 0.013, 0.025, 0.04}) {
            Motion const motion = turned(angle);
            auto const points_on = [&](std::vector<Placed<Box>> const& boxes) {
                Scene<NeoHookean<Plane>, QuadraticBSpline, Mls>::Solver block(lattice(cell));
                auto at = box_of_points<2>({-0.5, 0}, {0.5, 0.2}, cell);
                for (auto& x : at)
                    x = (motion.position + motion.orientation * Eigen::Vector3d(x.x(), x.y(), 0)).head<2>();
                block.add(at, cell * cell / 4, (motion.orientation * Eigen::Vector3d(0, -1, 0)).head<2>());
                Obstacles<AnyShape<OneBox>, ActsOn::surface> floor;
                for (auto const& box : boxes)
                    floor.list.push_back({.shape = OneBox{{box}}, .motion = motion});
                block.step(1e-4, floor);
                std::vector<double> along;
                for (auto const& point : contact_points(block).points) {
                    Eigen::Vector3d away = -motion.position;
                    away.head<2>() += point.position;
                    Eigen::Vector3d const own = motion.orientation.inverse() * away;
                    CHECK(std::abs(own.y()) < 1e-9);
                    along.push_back(own.x());
                }
                std::sort(along.begin(), along.end());
                return along;
            };
            auto const tile = [](double from, double to) { return between({from, -0.5, -1}, {to, 0, 1}); };
            auto const one = points_on({tile(-2, 2)}),
                       tiled = points_on({tile(-2, edge - 0.2), tile(edge - 0.2, edge), tile(edge, 2)});
            CAPTURE(angle, edge);
            REQUIRE(tiled.size() == one.size());
            double most = 0;
            for (std::size_t i = 0; i < one.size(); ++i) most = std::max(most, std::abs(tiled[i] - one[i]));
            CHECK(most < 1e-9);
        }
}
