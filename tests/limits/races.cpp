// SPDX-License-Identifier: MIT
// All that threads do together, in one short scene: for thread_sanitize.sh.
#include "catch.hpp"
#include "support/policies.hpp"

using namespace firn;
using namespace firn::test;

namespace
{

using Jelly = NeoHookean<Plane>;
using Rubber = FixedCorotated<Plane>;
using Pair = Solver<OpenMP, Materials<Rubber, Jelly>, QuadraticBSpline, Asflip>;

/// All that is told of a scene in the end.
struct Outcome
{
    std::vector<std::uint32_t> ids, isolated;
    std::vector<Eigen::Vector2d> positions, velocities;
    Eigen::Vector3d ball;
    std::size_t pieces = 0, removed = 0;

    bool operator==(Outcome const&) const = default;
};

/// A ball that particles push falls on two materials upon a floor, between a wall and a box that comes
/// nearer; a source above, a drain beside, two failing particles, and a state that is restored.
Outcome run(int threads)
{
    double const cell = 0.025, dt = 2e-3;
    OpenMP backend;
    backend.threads = threads;
    Pair solver(lattice(cell), {}, {}, {}, backend);
    solver.add<Rubber>(box_of_points<2>({0, 0}, {0.6, 0.4}, cell), cell * cell / 4);
    solver.add<Jelly>(box_of_points<2>({0.6, 0}, {1.2, 0.4}, cell), cell * cell / 4, {0, -1});
    solver.quarantine(2);
    RigidBody body =
        RigidBody::ball(0.15, 40, {.position = {0.6, 0.56, 0}, .velocity = {0.5, -3, 0}, .time = 0});
    Outcome end;
    for (int i = 0; i < 12; ++i) {
        Obstacle<Sphere> const ball{
            .shape = {0.15}, .contact = Contact::coulomb(0.4), .motion = body.motion, .on_particles = true};
        Obstacle<Box> const pusher{.shape = {{0.1, 1, 1}},
                                   .contact = Contact::sticky(),
                                   .motion = {.position = {1.32 - dt * i, 0.5, 0}, .velocity = {-1, 0, 0}}};
        auto const report =
            solver.advance(dt, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::coulomb(0.5)}, pusher, ball,
                           ReflectingWall{.axis = 0, .node = 0});
        body.advance(report.reactions[2], dt, Gravity{}.acceleration);
        if (i % 4 == 1)
            solver.add<Jelly>(box_of_points<2>({0.2, 0.8}, {0.5, 0.85}, cell), cell * cell / 4, {0, -2});
        if (i % 4 == 2) end.removed += solver.remove_if(Outside<Box>{.shape = {{1.15, 5, 5}}});
        if (i == 5 || i == 9) { // det F = -0.5
            auto H = solver.download<DisplacementGradient, Jelly>();
            H[40](1, 1) = -1.5;
            solver.upload<DisplacementGradient, Jelly>(H);
        }
        if (i == 7) {
            auto const saved = solver.snapshot();
            solver.remove_if(OnTheLeft{0.5});
            solver.restore(saved);
        }
    }
    end.ids = solver.ids();
    for (auto const& failure : solver.isolated()) end.isolated.push_back(failure.particle);
    end.positions = solver.positions();
    end.velocities = solver.download<Velocity>();
    end.ball = body.motion.position;
    end.pieces = solver.occupancy().pieces;
    return end;
}

} // namespace

TEST_CASE("three threads come to the same bits as one, whatever is asked of them")
{
    Outcome const alone = run(1);
    CHECK(alone.isolated.size() == 2);
    CHECK(alone.removed > 0);
    CHECK((run(3) == alone)); // not to be printed
}
