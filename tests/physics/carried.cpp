// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

// Bodies that obstacles carry which are told their poses frame by frame, and nothing else, as a host engine
// tells them that has keyframes.

namespace
{

using Rubber = Scene<FixedCorotated<Plane>, QuadraticBSpline, Mls>::Solver;
constexpr double h = 0.05, side = 6 * h, frame = 1.0 / 48; ///< of a cell, of the block [m], of a frame [s]

/// A block around a place.
Rubber block(Eigen::Vector2d const& middle)
{
    FixedCorotated<Plane> rubber;
    rubber.density = 400;
    rubber.elasticity = lame<double>(1e6, 0.3);
    Rubber solver(lattice(h), rubber);
    Eigen::Vector2d const half = Eigen::Vector2d::Constant(side / 2);
    solver.add(box_of_points<2>(middle - half, middle + half, h), h * h / 4);
    return solver;
}

Motion pose(Eigen::Vector2d const& position, double angle = 0)
{
    return {.position = {position.x(), position.y(), 0},
            .orientation = Eigen::Quaterniond(Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ()))};
}

/// A slab that goes from one pose to the next.
Obstacle<Box> slab(Eigen::Vector3d const& half_extents, Motion const& now, Motion const& next)
{
    return {
        .shape = {half_extents}, .contact = Contact::coulomb(1), .motion = Motion::between(now, next, frame)};
}

/// From 0 to 1 as its argument does, with no jerk at the ends.
double eased(double share)
{
    share = std::clamp(share, 0.0, 1.0);
    return share - std::sin(2 * M_PI * share) / (2 * M_PI);
}

/// Where a gripper is at a time [s], and how far apart its plates are: it closes, and then lifts, moves aside
/// and turns.
struct Gripper
{
    static constexpr double closed_at = 0.3, lifts_at = 0.6, arrived_at = 1.6,
                            thickness = 0.1; ///< [s], [s], [m]
    Eigen::Vector2d middle;
    double angle, opening;

    explicit Gripper(double time)
        : middle(eased(time - lifts_at) * Eigen::Vector2d(-0.5, 0.6)), angle(0.6 * eased(time - lifts_at)),
          opening(side + (2 - 3 * eased(time / closed_at)) * h)
    {}

    Motion plate(int which) const
    {
        double const away = (which == 0 ? -0.5 : 0.5) * (opening + thickness);
        return pose(middle + away * Eigen::Vector2d(std::cos(angle), std::sin(angle)), angle);
    }
    /// A place as one sees it that goes along [m].
    Eigen::Vector2d seen(Eigen::Vector2d const& x) const { return Eigen::Rotation2Dd(-angle) * (x - middle); }
};

} // namespace

TEST_CASE("a gripper given by poses alone lifts, moves and turns a block, which does not slip")
{
    auto solver = block({0, 0});
    Eigen::Vector3d const half(Gripper::thickness / 2, side, 1);
    std::vector<Eigen::Vector2d> held;
    double way = 0;
    for (double t = 0; t < Gripper::arrived_at + 0.2; t = solver.time()) {
        Gripper const now(t), next(t + frame);
        if (held.empty() && t > Gripper::lifts_at)
            for (auto const& x : solver.positions()) held.push_back(now.seen(x));
        way += (next.middle - now.middle).norm();
        double const pull = 9.81 * eased(t / Gripper::closed_at - 1); // what lies nowhere would fall
        solver.advance(frame, Gravity{{0, -pull, 0}}, slab(half, now.plate(0), next.plate(0)),
                       slab(half, now.plate(1), next.plate(1)));
    }
    Gripper const there(solver.time());
    CHECK(way > 0.75);
    Eigen::Vector2d slip = Eigen::Vector2d::Zero();
    double turn = 0, inertia = 0;
    auto const x = solver.positions();
    for (std::size_t i = 0; i < x.size(); ++i) {
        Eigen::Vector2d const at = there.seen(x[i]);
        slip += (at - held[i]) / double(x.size());
        turn += held[i].x() * at.y() - held[i].y() * at.x();
        inertia += held[i].squaredNorm();
    }
    CHECK(slip.norm() < 0.01 * way);
    CHECK(std::abs(turn / inertia) * side / 2 < 0.01 * way);
}

TEST_CASE("a belt given by poses alone carries a block along, and one without velocities does not")
{
    double const top = 0.5 * h, way = 0.6;
    for (bool const between : {true, false}) {
        auto solver = block({0, side / 2 + top});
        Eigen::Vector3d const half(3, 0.2, 1);
        auto const belt = [&](double t) { return pose({way * eased(t - 0.5), -0.2}); };
        double start = 0;
        for (double t = 0; t < 1.6; t = solver.time()) {
            if (t < 0.5) start = Totals(solver).centre.x();
            auto carries = slab(half, belt(t), belt(t + frame));
            if (!between) carries.motion = belt(t);
            solver.advance(frame, Gravity{{0, -9.81 * eased(2 * t), 0}}, carries,
                           slab(half, pose({0, 9}), pose({0, 9})));
        }
        double const carried = (Totals(solver).centre.x() - start) / way;
        CHECK(carried == Approx(between ? 1.0 : 0.0).margin(0.01));
    }
}
