// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "distributed/any_ranks.hpp"
#include "distributed/numbers.hpp"

#include <firn/contact_points.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/firn.hpp>

#include <algorithm>
#include <array>
#include <type_traits>
#include <utility>
#include <vector>

// Obstacles that act at their surface, with the same bits on any number of ranks.
using namespace firn;
using firn::test::append;
using firn::test::append_all;
using firn::test::append_report;
using firn::test::box_of_points;
using firn::test::Numbers;
using firn::test::part_of_time;
using firn::test::require_same_on_any_ranks;
using Plane = firn::Space<2, double>;
using Solid = firn::Space<3, float>;

namespace
{

/// A tank across the cells, without its lid.
template <ActsOn acts_on>
Obstacles<HalfSpace, acts_on> tank()
{
    Obstacles<HalfSpace, acts_on> walls;
    auto const add = [&](Eigen::Vector3d const& outward, Eigen::Vector3d const& at, Contact const& contact) {
        walls.list.push_back(
            {.shape = HalfSpace{outward.normalized()}, .contact = contact, .motion = {.position = at}});
    };
    add({0.1, 1, 0}, {0, -0.03, 0}, Contact::coulomb(0.3));
    add({1, -0.1, 0}, {-0.04, 0, 0}, Contact::slip());
    add({-1, 0.1, 0}, {1.97, 0, 0}, Contact::slip());
    return walls;
}

/// The points at which obstacles acted, in an order of their own.
template <class Solver>
void append_contacts(Numbers& to, Solver const& solver)
{
    auto points = contact_points(solver).points;
    std::vector<std::array<double, 6>> sorted;
    for (auto const& point : points)
        sorted.push_back({double(point.obstacle), point.position[0], point.position[1], point.impulse[0],
                          point.impulse[1], point.normal[0]});
    std::ranges::sort(sorted);
    for (auto const& point : sorted) append(to, point);
}

} // namespace

TEST_CASE("walls at rest that act at their surface give the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, Fluid<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                            backend);
        solver.add(box_of_points<2>({0.05, 0.05}, {1.3, 0.9}, 0.05), 0.05 * 0.05, {2, -1});
        auto const walls = tank<ActsOn::surface>();
        Numbers all;
        for (int i = 0; i < 3; ++i) append_report(all, solver.advance(0.2 * part_of_time, Gravity{}, walls));
        append_contacts(all, solver);
        append_all(all, solver);
        return all;
    });
}

TEST_CASE(
    "walls that move and turn, and keep their points for a while, give the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, Fluid<Plane>> solver(lattice(0.1), {}, {}, {},
                                                                            backend);
        solver.add(box_of_points<2>({0.05, 0.05}, {1.3, 0.9}, 0.05), 0.05 * 0.05, {2, -1});
        auto walls = tank<ActsOn::surface>(); // they stay in their cells for many steps
        walls.list[0].motion.velocity = {0, 0.1, 0};
        walls.list[1].motion.angular_velocity = {0, 0, 0.3};
        walls.list[2].motion.velocity = {-0.4, 0, 0};
        Obstacles<Box, ActsOn::surface> mixer; // and its points hardly do
        mixer.list.push_back(
            {.shape = {{0.3, 0.12, 1}},
             .contact = Contact::coulomb(0.2),
             .motion = {.position = {0.7, 0.5, 0}, .velocity = {0.5, 0, 0}, .angular_velocity = {0, 0, 9}}});
        Numbers all;
        for (double const duration : {0.3, 0.1}) {
            append_report(all, solver.advance(duration * part_of_time, Gravity{}, walls, mixer));
            append_contacts(all, solver);
        }
        append_all(all, solver);
        return all;
    });
}

TEST_CASE("fluids that keep their volume have the same bits on any number of ranks")
{
    auto const scene = [](auto solver) {
        solver.template add<Material<0>>(box_of_points<2>({0.02, 0.02}, {1.3, 0.9}, 0.05), 0.05 * 0.05 * 1.05,
                                         {2, -1});
        auto const walls = tank<ActsOn::surface>();
        Numbers all;
        for (int i = 0; i < 3; ++i) append_report(all, solver.advance(0.15 * part_of_time, Gravity{}, walls));
        append_all(all, solver);
        return all;
    };
    using Water = KeepsVolume<Fluid<Plane>>;
    Water water;
    SECTION("alone")
    {
        require_same_on_any_ranks([&](auto const& backend) {
            using B = std::remove_cvref_t<decltype(backend)>;
            return scene(Solver<B, Water>(lattice(0.1), water, {}, {}, backend));
        });
    }
#if !defined(FIRN_TESTS_FEW_OF_RANKS)
    SECTION("in every step, by more sweeps than there are cells between ranks, beside a solid")
    {
        water.interval = 0;
        water.sweeps = 40;
        require_same_on_any_ranks([&](auto const& backend) {
            using B = std::remove_cvref_t<decltype(backend)>;
            Solver<B, Materials<Water, NeoHookean<Plane>>> solver(lattice(0.1), {water, {}}, {}, {}, backend);
            solver.template add<Material<1>>(box_of_points<2>({1.4, 0.2}, {1.8, 0.6}, 0.05), 0.05 * 0.05);
            return scene(std::move(solver));
        });
    }
#endif
}

#if !defined(FIRN_TESTS_FEW_OF_RANKS)
TEST_CASE("a block that lets go of surfaces and comes back has the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, NeoHookean<Plane>, CubicBSpline, Apic> solver(
            lattice(0.1), {}, {}, {}, backend);
        solver.add(box_of_points<2>({0.3, 0.05}, {1.1, 0.7}, 0.05), 0.05 * 0.05, {5, -6});
        auto const walls = tank<ActsOn::surface>();
        Numbers all;
        append_report(all, solver.advance(0.4, Gravity{}, walls));
        append_contacts(all, solver);
        append_all(all, solver);
        return all;
    });
}

TEST_CASE(
    "bodies that move, at the surface and beside particles, react with the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, Sand<Solid>> solver(lattice(0.1), {}, {}, {}, backend);
        solver.add(box_of_points<3>({0, 0.02, 0}, {1.4, 0.5, 0.5}, 0.05), 0.05 * 0.05 * 0.05, {1, 0, 0});
        RigidBody ball{.mass = 40, .motion = {.position = {0.9, 0.85, 0.25}, .velocity = {0, -4, 0}}};
        ball.inertia = Eigen::Vector3d(1, 1, 1).asDiagonal();
        Obstacles<Box, ActsOn::surface> floor;
        floor.list.push_back({.shape = {{3, 0.1, 3}}, .motion = {.position = {0.5, -0.1, 0}}});
        Numbers all;
        for (int i = 0; i < 4; ++i) {
            Obstacles<Sphere, ActsOn::surface_and_particles> balls;
            balls.list.push_back({.shape = {0.25},
                                  .contact = Contact::coulomb(0.4),
                                  .motion = ball.motion,
                                  .on_particles = true});
            auto const report = solver.advance(0.02, Gravity{}, floor, balls);
            ball.advance(report.reactions[1], 0.02, {0, -9.81, 0});
            append_report(all, report);
            append(all, ball.motion.position);
        }
        append_contacts(all, solver);
        append_all(all, solver);
        return all;
    });
}

TEST_CASE("thin shells, and periods that surfaces go through, keep the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        Solver<std::remove_cvref_t<decltype(backend)>, Fluid<Plane>> solver(lattice(0.1).periodic(0, 32), {},
                                                                            {}, {}, backend);
        solver.add(box_of_points<2>({2.3, 0.15}, {3.1, 0.8}, 0.05), 0.05 * 0.05, {4, -1});
        Obstacles<Shell<Box>, ActsOn::surface_and_particles> sheets; // a trough that begins at the end
        for (double const x : {0.4, 2.9})
            sheets.list.push_back({.shape = {Box{{0.05, 0.6, 1}}, 0.01},
                                   .motion = {.position = {x, 0.5, 0}, .velocity = {0.5, 0, 0}},
                                   .on_particles = true});
        Obstacles<HalfSpace, ActsOn::surface> floor;
        floor.list.push_back({.motion = {.position = {0, 0.03, 0}}});
        Numbers all;
        for (int i = 0; i < 2; ++i) append_report(all, solver.advance(0.15, Gravity{}, floor, sheets));
        append_contacts(all, solver);
        append_all(all, solver);
        return all;
    });
}

TEST_CASE(
    "water that falls freely through a period keeps its volume with the same bits on any number of ranks")
{
    require_same_on_any_ranks([](auto const& backend) {
        KeepsVolume<Fluid<Solid>> water;
        water.interval = 2;
        Solver<std::remove_cvref_t<decltype(backend)>, KeepsVolume<Fluid<Solid>>> solver(
            lattice(0.1).periodic(0, 32), water, {}, {}, backend);
        solver.add(box_of_points<3>({2.6, 0, 0}, {3.1, 0.5, 0.4}, 0.05), 0.05 * 0.05 * 0.05 * 1.1, {8, 0, 2});
        Numbers all;
        append_report(all, solver.advance(0.04, Gravity{}));
        append_all(all, solver);
        return all;
    });
}
#endif
