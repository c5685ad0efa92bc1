// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/floating.hpp"
#include "support/policies.hpp"
#include "support/refused.hpp"
#include "support/tank.hpp"

#include <firn/contact_points.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/phases/find_candidates.hpp>
#include <firn/phases/points_of_nodes.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <random>
#include <vector>

// Obstacles that act by impulses at their surface, wherever that lies between nodes.
using namespace firn;
using namespace firn::test;

namespace
{

using Water = Scene<Fluid<Plane>, QuadraticBSpline, Mls>;
using Block = Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>;

using StillWater = Tank<Fluid<Plane>>;

/// What FindCandidates asks of a list of obstacles that has one, a solid below y = 0.
struct FloorOfList
{
    static constexpr bool is_group = true, acts_at_surface = true;

    struct Floor
    {
        Contact contact = Contact::slip();

        template <class Real>
        FIRN_HOST_DEVICE SurfaceAt<Real, 2> surface_at(LanePosition<Real, 2> const& place,
                                                       Vector<Real, 2> const& shift) const
        {
            return {shift, place.relative_to({0, 0, 0})[1] + shift[1], {0, 1}};
        }
        FIRN_HOST_DEVICE bool is_thin(Lattice const&) const { return false; }
    } floor;
    struct
    {
        std::uint32_t obstacles = 1;
    } sums;

    template <class Real, class Use>
    FIRN_HOST_DEVICE void for_each_within(LanePosition<Real, 2> const&, Real, Use const& use) const
    {
        use(0u, floor);
    }
};

/// A node with a mass [kg].
struct NodeWithMass
{
    using Real = double;
    static constexpr bool has_index = true;
    std::size_t number;
    double mass;
    Coordinates<2> at;

    FIRN_HOST_DEVICE std::size_t index() const { return number; }
    FIRN_HOST_DEVICE double sum(int) const { return mass; }
    FIRN_HOST_DEVICE Coordinates<2> first() const { return at; }
    FIRN_HOST_DEVICE Vector<double, 2> offset() const { return {0, 0}; }
};

} // namespace

TEST_CASE("still water stays at rest in a tank whose walls lie on nodes, or between them",
          "[physics][surface]")
{
    for (Eigen::Vector2d const& offset :
         {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.5, 0.35), Eigen::Vector2d(0.5, 0.5)}) {
        CAPTURE(offset.x(), offset.y());
        StillWater tank({0, offset * StillWater::h});
        check_rest(tank, 0.5);
    }
}

TEST_CASE("a tank that is tilted against the cells carries the weight of the water", "[physics][surface]")
{
    for (double const degrees : {17.0, 30.0}) {
        CAPTURE(degrees);
        StillWater tank({degrees * M_PI / 180, Eigen::Vector2d(0.3, 0.21) * StillWater::h});
        double const duration = 0.2;
        tank.advance(0.3); // it begins with sound, since particles lie across the cells
        auto const report = tank.advance(duration);
        CHECK(tank.rms_speed() < 0.01 * std::sqrt(g * StillWater::depth));
        CHECK(std::abs(tank.force(report, 0, {0, -1}, duration) / tank.weight() - 1) < 0.01);
    }
}

TEST_CASE("a held disk has the lift of Archimedes", "[physics][surface]")
{
    for (double const degrees : {0.0, 17.0}) {
        CAPTURE(degrees);
        double const radius = 3 * StillWater::h;
        StillWater tank({degrees * M_PI / 180, Eigen::Vector2d(0.1, 0.07) * StillWater::h}, radius, 3);
        tank.advance(0.15);
        double const duration = 0.45;
        auto const report = tank.advance(duration);
        double const lift = tank.force(report, 3, {0, 1}, duration) / (1000 * g * M_PI * radius * radius);
        CHECK(std::abs(lift - 1) < 0.04);
    }
}

TEST_CASE("a disk floats as deep as Archimedes says", "[physics][surface]")
{
    double const radius = 4 * StillWater::h, whole = M_PI * radius * radius;
    for (double const density : {0.3, 0.8}) { // of the water's
        CAPTURE(density);
        Frame const upright{0, Eigen::Vector2d(0.3, 0.21) * StillWater::h};
        double const height = StillWater::depth + height_of_floating_disk(density, radius);
        StillWater tank(upright, radius, 2, height);
        double const mass = density * 1000 * whole, flat = mass * radius * radius / 4;
        RigidBody disk{.mass = mass, .motion = tank.walls.list[3].motion};
        disk.inertia = Eigen::Vector3d(flat, flat, 2 * flat).asDiagonal();
        double sum = 0;
        int const calls = 250;
        double const of_call = 0.002;
        for (int i = 0; i < calls; ++i) {
            tank.walls.list[3].motion = disk.motion;
            auto const report = tank.advance(of_call);
            disk.advance(report.reactions[3], of_call, tank.pull());
            if (2 * i >= calls) sum += upright.own(disk.motion.position.head<2>()).y() / (calls / 2.0);
        }
        CHECK(std::abs(sum - height) < 0.05 * 2 * radius);
    }
}

namespace
{
/// A plane of 30 degrees, rough by `mu`, that acts at its surface and lies at an angle to the cells.
struct Incline
{
    static constexpr double slope = M_PI / 6;

    Incline(double degrees, double mu_) : plane{-degrees * M_PI / 180, {0.004, 0.007}}, mu(mu_)
    {
        pull = in_space(plane.direction(g * Eigen::Vector2d(std::sin(slope), -std::cos(slope))));
        floor.list.push_back({.shape = HalfSpace{in_space(plane.direction({0, 1}))},
                              .contact = Contact::coulomb(mu),
                              .motion = {.position = in_space(plane.origin)}});
    }
    /// By Coulomb's law [m/s^2].
    double acceleration() const { return std::max(0.0, g * (std::sin(slope) - mu * std::cos(slope))); }
    /// Particles of a block that is 0.4 m long, from one height above the plane to another.
    std::vector<Eigen::Vector2d> layer(double low, double high, double h) const
    {
        auto points = box_of_points<2>({0, low}, {0.4, high}, h);
        for (auto& x : points) x = plane.place(x);
        return points;
    }
    /// Lets the load come on smoothly, and the block come to slide.
    template <class Block>
    void load(Block& block) const
    {
        int const ramp = 20;
        for (int i = 1; i <= ramp; ++i) block.advance(0.1 / ramp, Gravity{pull * i / ramp}, floor);
        block.advance(0.4, Gravity{pull}, floor);
    }
    /// Down the plane [m/s]; `of` is the Totals of a block.
    double speed(auto const& of) const { return plane.direction({1, 0}).dot(of.momentum) / of.mass; }

    Frame plane;
    double mu;
    AtSurface floor;
    Eigen::Vector3d pull; ///< gravity [m/s^2]
};
} // namespace

TEST_CASE("a block slides down a plane by Coulomb's law, whatever its angle to the cells",
          "[physics][surface]")
{
    auto const slides = [&](double h, double degrees, double mu, double of_acceleration, double of_ratio) {
        CAPTURE(h, degrees, mu);
        Incline const incline(degrees, mu);
        Block::Model material;
        material.elasticity = lame<double>(1e6, 0.3);
        Block::Solver block(lattice(h), material);
        block.add(incline.layer(0, 0.2, h), h * h / 4);
        incline.load(block);
        double const before = incline.speed(Totals(block)), duration = 0.3;
        auto const report = block.advance(duration, Gravity{incline.pull}, incline.floor);
        double const gained = incline.speed(Totals(block)) - before;
        CHECK(std::abs(gained / duration - incline.acceleration()) <= of_acceleration);
        Frame const& plane = incline.plane;
        Eigen::Vector2d const impulse = report.reactions[0].impulse.head<2>();
        double const ratio = impulse.dot(plane.direction({1, 0})) / -impulse.dot(plane.direction({0, 1}));
        CHECK(std::abs(ratio - std::min(mu, std::tan(Incline::slope))) <= of_ratio);
        for (auto const& x : block.positions()) // it lies on the plane, not above it
            if (plane.own(x).y() < 0.15 * h) FAIL("a particle is " << plane.own(x).y() / h << " h above");
    };
    for (double const degrees : {0.0, 11.25, 17.0, 22.5, 30.0, 37.0, 45.0, 60.0})
        for (double const mu : {0.0, 0.3, 0.5}) // within 1 % of the acceleration
            slides(0.04, degrees, mu, 0.01 * Incline(degrees, mu).acceleration(),
                   mu > 0 ? 5e-3 : 1e-9); // nothing drags where it slips
    for (double const degrees : {0.0, 17.0, 45.0})
        for (double const mu : {0.0, 0.3, 0.6}) // with 0.6 it sticks
            slides(0.02, degrees, mu, 0.01 * Incline(degrees, 0).acceleration(), mu > 0 ? 1e-3 : 1e-9);
}

TEST_CASE("a block of two materials, one on the other, slides down a plane by Coulomb's law",
          "[physics][surface]")
{
    using Layers = Materials<NeoHookean<Plane>, FixedCorotated<Plane>>;
    double const h = 0.04;
    NeoHookean<Plane> light;
    light.elasticity = lame<double>(1e6, 0.3);
    FixedCorotated<Plane> heavy;
    heavy.elasticity = lame<double>(2e6, 0.3);
    heavy.density = 2 * light.density;
    for (double const degrees : {0.0, 17.0})
        for (double const mu : {0.0, 0.3, 0.5}) {
            CAPTURE(degrees, mu);
            Incline const incline(degrees, mu);
            Scene<Layers, QuadraticBSpline, Pic>::Solver block(lattice(h), Layers{light, heavy});
            block.add<Material<0>>(incline.layer(0, 0.12, h), h * h / 4);
            block.add<Material<1>>(incline.layer(0.12, 0.2, h), h * h / 4);
            incline.load(block);
            Totals const before(block);
            double const duration = 0.3, expected = incline.acceleration();
            auto const report = block.advance(duration, Gravity{incline.pull}, incline.floor);
            Totals const after(block);
            CHECK(std::abs((incline.speed(after) - incline.speed(before)) / duration - expected) <=
                  0.01 * expected);
            Eigen::Vector2d const impulse = report.reactions[0].impulse.head<2>(),
                                  gained = after.momentum - before.momentum;
            CHECK((gained + impulse - after.mass * duration * incline.pull.head<2>()).norm() <
                  1e-4 * after.mass * duration * g);
        }
}

TEST_CASE("boards that stand side by side hold water", "[physics][surface]")
{
    double const h = 0.02;
    using OnAll = Obstacles<AnyShape<>, ActsOn::surface_and_particles>;
    for (double const offset : {0.25, 0.5, 0.75}) {
        CAPTURE(offset);
        Water::Solver water(lattice(h, Eigen::Vector3d(offset, offset, 0) * h), materials::water<Plane>());
        water.add(box_of_points<2>({-0.2, 0}, {0.2, 0.2}, h), h * h / 4);
        OnAll boards;
        auto const add = [&](double half_width, double half_height, double x, double y) {
            boards.list.push_back({.shape = Box{{half_width, half_height, 1}},
                                   .motion = {.position = {x, y, 0}},
                                   .on_particles = true});
        };
        add(0.28, 0.04, 0, -0.04); // the others stand on this one
        add(0.04, 1, -0.24, 1);
        add(0.04, 1, 0.24, 1);
        water.advance(0.5, Gravity{}, boards);
        int outside = 0;
        for (auto const& x : water.positions()) outside += std::abs(x.x()) > 0.24 || x.y() < -0.04;
        CHECK(outside == 0);
    }
}

TEST_CASE("obstacles with the same face have it once", "[physics][surface]")
{
    double const h = 0.05, duration = 0.3;
    auto const tile = [](double width, double x) {
        return Obstacle<AnyShape<>>{.shape = Box{{width, 0.1, 1}}, .motion = {.position = {x, -0.1, 0}}};
    };
    Obstacle<AnyShape<>> const ground{.shape = HalfSpace{}};
    std::vector<Obstacle<AnyShape<>>> const floors[]{
        {ground}, {ground, ground}, {ground, tile(0.1, 0)}, {tile(0.3, -0.1), tile(0.3, 0.1)}};
    for (auto const& floor : floors) {
        CAPTURE(&floor - floors);
        Block::Solver block(lattice(h));
        block.add(box_of_points<2>({-0.2, 0}, {0.2, 0.2}, h), h * h / 4);
        auto const report = block.advance(duration, Gravity{}, AtSurface{floor});
        double carried = 0;
        for (auto const& reaction : report.reactions) carried -= reaction.impulse.y();
        CHECK(std::abs(carried / (Totals(block).mass * g * duration) - 1) < 0.02);
    }
}

TEST_CASE("what obstacles receive at their surface is what the material loses", "[physics][surface]")
{
    double const h = 0.05, dt = 4e-4;
    for (auto const& contact : {Contact::slip(), Contact::coulomb(0.4), Contact::sticky()}) {
        Water::Solver block(lattice(h), materials::water<Plane>(3)); // Mls keeps angular momentum, too
        block.add(box_of_points<2>({0.02, 0.03}, {0.32, 0.23}, h), h * h / 4, {1, -2});
        AtSurface around;
        around.list.push_back({.shape = HalfSpace{}, .contact = contact});
        around.list.push_back({.shape = Sphere{0.1},
                               .contact = contact,
                               .motion = {.position = {0.4, 0.1, 0}, .angular_velocity = {0, 0, 8}}});
        Totals const before(block);
        Reaction floor, ball;
        for (auto const& report : block.steps(80, dt, around)) {
            floor += report.reactions[0];
            ball += report.reactions[1];
        }
        Totals const after(block);
        Eigen::Vector2d const lost = before.momentum - after.momentum,
                              received = floor.impulse.head<2>() + ball.impulse.head<2>();
        double const scale = before.momentum.norm();
        CHECK(floor.impulse.norm() > 0.05 * scale);
        CHECK(ball.impulse.norm() > 0.05 * scale);
        CHECK((lost - received).norm() < 1e-10 * scale);
        double const around_ball = 0.4 * ball.impulse.y() - 0.1 * ball.impulse.x();
        CHECK(std::abs(before.angular_momentum - after.angular_momentum -
                       (floor.angular_impulse.z() + ball.angular_impulse.z() + around_ball)) < 1e-9 * scale);
    }
}

TEST_CASE("momentum is kept where particles have hardly any weight at nodes that a surface acts on",
          "[physics][surface]")
{
    double const h = 0.05;
    AtSurface wedge; // in which lone drops come to rest, as their last nodes lose them
    wedge.list.push_back({.shape = HalfSpace{}, .contact = Contact::coulomb(0.3)});
    wedge.list.push_back(
        {.shape = Sphere{0.2}, .contact = Contact::sticky(), .motion = {.position = {0.3, 0.1, 0}}});
    double worst = 0;
    for (int i = 0; i < 60; ++i) {
        Block::Solver drop(lattice(h));
        drop.add(std::vector<Eigen::Vector2d>{{0.52 + 1e-3 * i, 1e-5}}, 1e-4, {-3, -1});
        Eigen::Vector2d left = Totals(drop).momentum;
        double const scale = left.norm();
        for (auto const& report : drop.steps(40, 2e-4, wedge)) // each goes on from the impulses before
            for (auto const& reaction : report.reactions) left -= reaction.impulse.head<2>();
        worst = std::max(worst, (Totals(drop).momentum - left).norm() / scale);
    }
    CHECK(worst < 1e-10);
}

TEST_CASE("points are found ahead of material where it may come, and elsewhere when it has come",
          "[physics][surface]")
{
    /// Candidates among nodes at heights of -6 to 2 cells: in one column of them that has mass from the
    /// first step on, and in one that gets it in the second.
    auto const heights = []<class Kernel>(Kernel, Contact const& contact, bool finds_ahead) {
        StepContext<double, Chain<FloorOfList>> now{};
        now.actions.first.floor.contact = contact;
        std::vector<SurfaceCandidate<2>> candidates(100);
        std::vector<std::uint32_t> seen(100), table(256);
        std::vector<CandidatesOfNode> noted(18);
        std::uint32_t count = 0;
        SurfacePoints<double, 2> of{};
        of.candidates = candidates.data(), of.seen = seen.data(), of.candidates_room = 100;
        of.of_nodes = finds_ahead ? noted.data() : nullptr;
        std::vector<std::vector<int>> found; // by step: seen, and not seen
        for (std::uint32_t step = 1; step <= 2; ++step) {
            of.known = {candidates.data(), table.data(), step > 1 ? 255u : 0, of.known.count + count};
            for (std::uint32_t i = 0; step > 1 && i < count; ++i)
                KnownCandidates<2>{candidates.data(), table.data(), 255, 0}(i);
            count = 0, of.new_candidates = &count, of.step = step;
            for (std::size_t i = 0; i < 18; ++i) {
                double const mass = i < 9 || step > 1 ? 1 : 0;
                NodeWithMass node{i, mass, {int(i / 9), int(i % 9) - 6}};
                NothingFound nothing;
                FindCandidates<Plane, Kernel, Mls, Chain<FloorOfList>>{
                    &now, lattice(1), 0, of, finds_ahead && step == 1}(node, nothing);
            }
            found.emplace_back(), found.emplace_back();
            for (std::uint32_t i = 0; i < of.known.count + count; ++i)
                if (candidates[i].node[0] == 1)
                    found[found.size() - (seen[i] == step ? 2 : 1)].push_back(candidates[i].node[1]);
        }
        for (auto& some : found) std::sort(some.begin(), some.end());
        return found;
    };
    using Found = std::vector<std::vector<int>>;
    std::vector<int> const none, surface{0};
    auto const quadratic = [&](Contact const& contact, bool finds_ahead) {
        return heights(QuadraticBSpline{}, contact, finds_ahead);
    };
    auto const cubic = [&](Contact const& contact, bool finds_ahead) {
        return heights(CubicBSpline{}, contact, finds_ahead);
    };
    std::vector<int> const held{-6, -5, -4, -3, -2, 0}, stuck{-6, -5, -4, -3, -2, -1, 0},
        held_by_cubic{-6, -5, -4, -3, 0};
    CHECK(quadratic(Contact::slip(), false) == Found{none, none, held, none});
    CHECK(quadratic(Contact::slip(), true) == Found{none, surface, held, none});
    CHECK(cubic(Contact::slip(), true) == Found{none, surface, held_by_cubic, none});
    // what sticks holds all nodes inside, and kernels reach so deep from outside
    CHECK(quadratic(Contact::sticky(), false) == Found{none, none, stuck, none});
    CHECK(quadratic(Contact::sticky(), true) == Found{none, {-1, 0}, stuck, none});
    CHECK(cubic(Contact::sticky(), true) == Found{none, {-2, -1, 0}, stuck, none});
}

TEST_CASE("the points of a node have one order, whatever their numbers and however they were listed",
          "[physics][surface]")
{
    using Loop = SortPoints<QuadraticBSpline, double, 2>;
    // which point, and the node's place in its stencil; some have the same place
    std::vector<SurfacePoint<double, 2>> kinds(12);
    auto const place_of = [](std::size_t kind) { return static_cast<int>(kind % 4 * 2); };
    for (std::size_t i = 0; i < kinds.size(); ++i) {
        kinds[i].node = {static_cast<int>(i % 4), static_cast<int>(i / 8)};
        kinds[i].obstacle = i / 4 % 2 == 0 ? 5 : 2;
        kinds[i].behind = i < 6 ? 1 : 0;
        kinds[i].is_deep = i == 3;
    }
    std::vector<std::size_t> numbers(kinds.size()), order; // numbers[p]: the kind of point p
    std::iota(numbers.begin(), numbers.end(), 0);
    std::mt19937 random(7);
    for (int i = 0; i < 50; ++i) {
        std::vector<SurfacePoint<double, 2>> points;
        for (std::size_t const kind : numbers) points.push_back(kinds[kind]);
        std::vector<PointOfNode<double>> list{PointOfNode<double>::of(8, 0, -1)}; // of another node
        std::vector<std::size_t> listed(kinds.size());
        std::iota(listed.begin(), listed.end(), 0);
        std::shuffle(listed.begin(), listed.end(), random);
        std::vector<std::uint32_t> ranks(32 * 9);
        for (std::size_t const p : listed) {
            int const place = place_of(numbers[p]);
            ranks[Loop::place(p, place)] = static_cast<std::uint32_t>(list.size()) - 1;
            list.push_back(PointOfNode<double>::of(place, p, double(numbers[p])));
        }
        NodeAtSurface<double, 2> node{};
        node.points = {1, static_cast<std::uint32_t>(kinds.size())};
        node.has_new_points = true;
        std::uint32_t nodes = 1, changes = 1;
        SurfacePoints<double, 2> of{};
        of.points = points.data(), of.points_of_nodes = list.data(), of.ranks = ranks.data();
        of.reached = &node, of.reached_nodes = &nodes, of.changes = &changes;
        Loop{{of}}(0);
        CHECK(exactly_equal(list[0].weight, -1.));
        std::vector<std::size_t> sorted;
        for (std::size_t n = 1; n < list.size(); ++n) {
            std::size_t const p = list[n].point();
            sorted.push_back(numbers[p]);
            CHECK(exactly_equal(list[n].weight, double(numbers[p])));
            CHECK(ranks[Loop::place(p, place_of(numbers[p]))] == n - 1);
        }
        if (i == 0) order = sorted;
        CHECK(sorted == order);
        std::shuffle(numbers.begin(), numbers.end(), random);
    }
}

TEST_CASE("obstacles tell where they were touched, and by what impulse", "[physics][surface]")
{
    double const h = 0.05;
    Block::Solver block(lattice(h, {0.013, 0.021, 0}));
    block.add(box_of_points<2>({-0.2, 0}, {0.2, 0.2}, h), h * h / 4, {0, -1});
    CHECK(contact_points(block).points.empty());
    AtSurface around;
    around.list.push_back({.shape = Sphere{0.1}, .motion = {.position = {0.7, 0, 0}}}); // far away
    around.list.push_back({.shape = HalfSpace{}, .contact = Contact::coulomb(0.3)});
    auto const reports = block.steps(5, 1e-4, around);
    auto const last = contact_points(block);
    CHECK(last.dt == reports.back().dt);
    CHECK(last.points.size() >= 8); // one in each cell along the block
    CHECK(last.points.size() <= 14);
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (auto const& point : last.points) {
        CHECK(point.obstacle == 1);
        CHECK(std::abs(point.position.y()) < 1e-12);
        CHECK(std::abs(point.position.x()) < 0.2 + 2 * h);
        CHECK((point.normal - Eigen::Vector2d(0, 1)).norm() < 1e-12);
        CHECK(point.impulse.y() < 0);
        sum += point.impulse;
    }
    CHECK((sum - reports.back().reactions[1].impulse.head<2>()).norm() < 1e-9 * sum.norm());
    block.steps(1, 1e-4);
    CHECK(contact_points(block).points.empty());
}

TEST_CASE("contact at the surface lets go, sticks and carries along", "[physics][surface]")
{
    double const h = 0.05;
    auto const block_with = [&](Eigen::Vector2d const& velocity) {
        Block::Model stiff;
        stiff.elasticity = lame<double>(1e6, 0.3);
        Block::Solver block(lattice(h), stiff);
        block.add(box_of_points<2>({0, 0}, {0.4, 0.2}, h), h * h / 4, velocity);
        return block;
    };
    AtSurface plane;
    plane.list.push_back({.shape = HalfSpace{}});
    SECTION("what leaves a surface is not held")
    {
        auto block = block_with({0, 2});
        auto const report = block.advance(0.05, plane);
        CHECK(report.reactions[0].impulse.norm() < 1e-12);
        CHECK(std::abs(Totals(block).momentum.y() / Totals(block).mass - 2) < 1e-12);
    }
    SECTION("unless it sticks: then it hangs")
    {
        plane.list[0].contact = Contact::sticky();
        auto block = block_with({0, 0});
        Gravity const up{{0, g, 0}};
        block.advance(0.2, up, plane);
        double const duration = 0.4;
        auto const report = block.advance(duration, up, plane);
        CHECK(std::abs(report.reactions[0].impulse.y() / (Totals(block).mass * g * duration) - 1) < 0.02);
    }
    SECTION("bound to it, it hangs and slides on")
    {
        plane.list[0].contact = Contact::bound_slip();
        auto block = block_with({1, 0});
        Gravity const up{{0, g, 0}};
        block.advance(0.2, up, plane);
        double const duration = 0.4;
        auto const report = block.advance(duration, up, plane);
        CHECK(std::abs(report.reactions[0].impulse.y() / (Totals(block).mass * g * duration) - 1) < 0.02);
        CHECK(std::abs(Totals(block).momentum.x() / Totals(block).mass - 1) < 1e-10);
        for (auto const& x : block.positions()) // it has not moved away
            if (x.y() > 0.23) FAIL("a particle is at " << x.y());
    }
    SECTION("a moving surface drags by its friction")
    {
        double const mu = 0.2;
        plane.list[0].contact = Contact::coulomb(mu);
        plane.list[0].motion.velocity = {1, 0, 0};
        auto block = block_with({0, 0});
        block.advance(0.2, Gravity{}, plane);
        auto const velocity = [&] { return Totals(block).momentum.x() / Totals(block).mass; };
        double const before = velocity();
        block.advance(0.2, Gravity{}, plane);
        CHECK(std::abs((velocity() - before) / 0.2 - mu * g) < 0.02 * mu * g);
        block.advance(0.4, Gravity{}, plane);
        CHECK(std::abs(velocity() - 1) < 1e-3); // and then it goes along
    }
}

TEST_CASE("a block comes to rest on a slanted plane with the tent kernel, too", "[physics][surface]")
{
    double const h = 0.05;
    Frame const plane{0.3, {0.013, 0.021}};
    Scene<NeoHookean<Plane>, Linear, Pic>::Solver block(lattice(h));
    auto points = box_of_points<2>({0, 0}, {0.3, 0.3}, h);
    for (auto& x : points) x = plane.place(x);
    block.add(points, h * h / 4);
    AtSurface floor;
    floor.list.push_back({.shape = HalfSpace{in_space(plane.direction({0, 1}))},
                          .motion = {.position = in_space(plane.origin)}});
    Gravity const pull{in_space(plane.direction({0, -g}))};
    block.advance(0.3, pull, floor);
    Totals const before(block);
    auto const report = block.advance(0.3, pull, floor);
    Totals const after(block);
    Eigen::Vector2d const received = report.reactions[0].impulse.head<2>(),
                          weight = before.mass * report.time_of_forces * pull.acceleration.head<2>();
    CHECK((after.momentum - before.momentum + received - weight).norm() < 1e-10 * weight.norm());
    CHECK((received - weight).norm() < 0.03 * weight.norm());
    double lowest = 1;
    for (auto const& x : block.positions()) lowest = std::min(lowest, plane.own(x).y() / h);
    CHECK(lowest > 0.15); // it began at a quarter
    CHECK(lowest < 0.35);
}

using Cases = Combinations<Block, More<Scene<NeoHookean<SolidFloat>, CubicBSpline, Flip>,
                                       Scene<Snow<SolidFloat>, QuadraticBSpline, Apic>,
                                       Scene<NeoHookean<Solid>, QuadraticBSpline, Xpic>>>;

TEMPLATE_LIST_TEST_CASE("a block lies on a slanted plane whatever the kernel and the transfer",
                        "[physics][surface]", Cases)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    double const h = 0.05, angle = 0.3;
    typename TestType::Solver block(lattice(h, {0.013, 0.021, 0.007}));
    Vec along = Vec::Zero(), normal = Vec::Zero();
    along[0] = normal[1] = std::cos(angle);
    normal[0] = -(along[1] = std::sin(angle));
    Vec high = Vec::Constant(0.3);
    auto points = box_of_points<d>(Vec::Zero(), high, h);
    for (auto& x : points) {
        Vec const own = x;
        x = own + along * own[0] + normal * own[1];
        for (int a = 0; a < 2; ++a) x[a] -= own[a];
    }
    block.add(points, std::pow(h / 2, d));
    AtSurface floor;
    floor.list.push_back({.shape = HalfSpace{{normal[0], normal[1], 0}}});
    Gravity const pull{Eigen::Vector3d(-g * normal[0], -g * normal[1], 0)};
    Totals const before(block);
    double const dt = 0.5 * block.stable_step(pull, floor);
    double duration = 0;
    Vec received = Vec::Zero();
    for (auto const& report : block.steps(static_cast<std::size_t>(0.1 / dt), dt, pull, floor)) {
        duration += report.time_of_forces;
        for (int a = 0; a < d; ++a) received[a] += report.reactions[0].impulse[a];
    }
    Totals const after(block);
    double const scale = before.mass * g * duration;
    CHECK((after.momentum - before.momentum + received + scale * normal).norm() < 1e-4 * scale);
    CHECK(received.dot(normal) < -0.5 * scale); // it is carried
    CHECK(std::abs(received.dot(along)) < 1e-6 * scale);
}

TEST_CASE("contact at the surface has the same bits from run to run, and for any number of threads",
          "[physics][surface]")
{
    double const speed = GENERATE(0.0, 0.7); // of the sphere [m/s]
    bool const is_of_two_lists = GENERATE(false, true);
    auto const run = [&](auto const& backend) {
        double const h = 0.05;
        Water::Solver water(lattice(h), materials::water<Plane>(2), {}, {}, backend);
        water.add(box_of_points<2>({0.01, 0.02}, {1.01, 0.62}, h), h * h / 4, {0.5, -1});
        AtSurface around, more;
        around.list.push_back({.shape = HalfSpace{{0.6, 0.8, 0}}});
        (is_of_two_lists ? more : around)
            .list.push_back(
                {.shape = Sphere{0.2}, .motion = {.position = {0.8, 0, 0}, .velocity = {0, speed, 0}}});
        auto const report = water.advance(0.1, Gravity{}, around, more);
        CHECK(report.reactions.size() == 2);
        std::vector<double> bits;
        for (auto const& x : water.positions()) bits.insert(bits.end(), {x.x(), x.y()});
        for (auto const& reaction : report.reactions)
            bits.insert(bits.end(), reaction.impulse.data(), reaction.impulse.data() + 3);
        return bits;
    };
    auto const once = run(TestedBackend{});
    CHECK(once == run(TestedBackend{}));
#if defined(FIRN_TESTS_ON_OPENMP)
    CHECK(once == run(OpenMP{.threads = 1}));
    CHECK(once == run(OpenMP{.threads = 3}));
#endif
    [&](auto backend) { // nor does it matter how many steps are queued at once
        if constexpr (requires { backend.batch; })
            for (std::size_t const batch : {1, 2, 7, 64}) {
                backend.batch = batch;
                CHECK(once == run(backend));
            }
    }(TestedBackend{});
}

TEST_CASE("obstacles of several lists have one surface, as those of one list", "[physics][surface]")
{
    double const h = 0.05;
    AtSurface floor, ball;
    floor.list.push_back({.shape = HalfSpace{{0.6, 0.8, 0}}, .contact = Contact::coulomb(0.3)});
    ball.list.push_back({.shape = Sphere{0.2}, .motion = {.position = {0.3, -0.1, 0}}});
    AtSurface both = floor;
    both.list.push_back(ball.list[0]);
    auto const run = [&](auto const&... around) {
        Water::Solver water(lattice(h), materials::water<Plane>(2));
        water.add(box_of_points<2>({0.01, 0.02}, {1.01, 0.62}, h), h * h / 4, {0.5, -1});
        auto const report = water.advance(0.05, Gravity{}, around...);
        std::vector<double> numbers;
        for (auto const& x : water.positions()) numbers.insert(numbers.end(), {x.x(), x.y()});
        for (auto const& reaction : report.reactions)
            numbers.insert(numbers.end(), reaction.impulse.data(), reaction.impulse.data() + 3);
        bool touched[2]{};
        for (auto const& point : contact_points(water).points) touched[point.obstacle] = true;
        CHECK(touched[0]);
        CHECK(touched[1]);
        return numbers;
    };
    auto const of_two = run(floor, ball), of_one = run(both);
    REQUIRE(of_two.size() == of_one.size());
    double worst = 0; // to rounding: a compiler may fuse other operations in loops over other lists
    for (std::size_t i = 0; i < of_one.size(); ++i) worst = std::max(worst, std::abs(of_two[i] - of_one[i]));
    CHECK(worst < 1e-9);
    // only one of their memories has points, so only that one says how many steps a device queues
    SurfaceMemory<TestedBackend, double, 2> first{TestedBackend{}}, second{TestedBackend{}};
    for (int call = 0; call < 2; ++call) {
        first.begin_call(1, true, 0, {});
        second.begin_call(1, true, 0, {});
        CHECK(second.most_steps() == 1); // alone: points are to be found
        first.join(second);
        CHECK(first.most_steps() == 1);
        CHECK(second.most_steps() >= 64);
        CHECK(!second.has_stopped());
    }
}

using Splashes = Combinations<Water, More<Scene<Fluid<SolidFloat>, QuadraticBSpline, Mls>>>;

TEMPLATE_LIST_TEST_CASE("walls at rest, whose points are kept, act as walls that hardly move, to the bit",
                        "[physics][surface]", Splashes)
{
    constexpr int d = TestType::d;
    using Vec = Vector<double, d>;
    double const h = 0.05;
    auto const run = [&](double speed, std::size_t steps_of_call) {
        typename TestType::Solver water(lattice(h), materials::water<typename TestType::Space>(3));
        Vec low = Vec::Constant(0.02), high = Vec::Constant(0.3), velocity = Vec::Zero();
        high[0] = 0.6, high[1] = 0.5, velocity[0] = 2, velocity[1] = -1;
        water.add(box_of_points<d>(low, high, h), std::pow(h / 2, d), velocity);
        AtSurface around;
        auto const add = [&](auto const& shape, Eigen::Vector3d const& at) {
            around.list.push_back({.shape = shape, .motion = {.position = at, .velocity = {speed, 0, 0}}});
        };
        add(HalfSpace{{0.28, 0.96, 0}}, {0, 0, 0});
        add(HalfSpace{{-1, 0, 0}}, {0.9, 0, 0});
        add(Sphere{0.15}, {0.5, 0.05, 0.1});
        add(Box{{0.1, 0.1, 0.5}}, {0.8, 0.1, 0.1});
        add(Box{{0.1, 0.1, 0.5}}, {0.8, 0.3, 0.1}); // on the other
        std::vector<double> bits;
        for (int call = 0; call < 4; ++call)
            for (auto const& report : water.steps(steps_of_call, 2e-4, Gravity{}, around))
                for (auto const& reaction : report.reactions)
                    bits.insert(bits.end(), reaction.impulse.data(), reaction.impulse.data() + 3);
        for (auto const& x : water.positions())
            for (int a = 0; a < d; ++a) bits.push_back(x[a]);
        auto const last = contact_points(water).points;
        bits.push_back(double(last.size()));
        return bits;
    };
    for (std::size_t const steps : {std::size_t(3), std::size_t(150)}) {
        auto const kept = run(0, steps), found = run(1e-150, steps);
        CHECK(kept == found);
    }
}

TEST_CASE("obstacles at their surface that cannot act are refused", "[physics][surface]")
{
    Block::Solver block(lattice(0.05));
    block.add(box_of_points<2>({0, 0}, {0.4, 0.2}, 0.05), 0.05 * 0.05 / 4);
    AtSurface plane;
    block.step(1e-4, plane); // none at all
    plane.list.push_back({.shape = HalfSpace{}, .on_particles = true});
    CHECK(refused([&] { block.step(1e-4, plane); }).what_is_wrong() ==
          "it is to act on particles, and its list does not");
}
