// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/effects/shapes/cylinder.hpp>
#include <firn/effects/shapes/height_field.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>
#include <firn/effects/shapes/union.hpp>

#include <cmath>
#include <type_traits>
#include <utility>
#include <vector>

// Every kind of solid acts at its surface.
using namespace firn;
using namespace firn::test;

TEST_CASE("what a solid of any kind receives at its surface is what the material loses", "[physics][surface]")
{
    double const h = 0.05;

    std::vector<double> distances; // of a disk
    for (int j = 0; j < 41; ++j)
        for (int i = 0; i < 41; ++i) distances.push_back(std::hypot(0.01 * i - 0.2, 0.01 * j - 0.2) - 0.1);
    std::vector<double> heights;
    for (int i = 0; i < 81; ++i) heights.push_back(0.02 * std::sin(0.4 * i));
    auto const disk =
        SignedDistanceGrid<double, 2>({-0.2, -0.2}, 0.01, {41, 41}, distances).on(TestedBackend{});
    auto const ground = HeightField<double, 2>({-0.8}, 0.02, {81}, heights).on(TestedBackend{});
    using Cross = Union<Box, Box>;
    using Solid =
        AnyShape<Cylinder, std::remove_const_t<decltype(disk)>, std::remove_const_t<decltype(ground)>, Cross>;
    Cross cross;
    cross.parts = {Placed<Box>{Box{{0.12, 0.05, 1}}}, Placed<Box>{Box{{0.05, 0.12, 1}}}};
    std::vector<std::pair<char const*, Solid>> const kinds{
        {"box", Box{{0.1, 0.08, 1}}}, {"capsule", Capsule{0.06, 0.08}}, {"cylinder", Cylinder{0.08, 0.1}},
        {"grid of distances", disk},  {"height field", ground},         {"union", cross}};

    for (auto const& [name, shape] : kinds) {
        CAPTURE(name);
        // Mls keeps angular momentum, too
        Scene<Fluid<Plane>, QuadraticBSpline, Mls>::Solver block(lattice(h), materials::water<Plane>(3));
        block.add(box_of_points<2>({0.02, 0.13}, {0.32, 0.33}, h), h * h / 4, {1, -2});
        Obstacles<Solid, ActsOn::surface> around;
        around.list.push_back({.shape = HalfSpace{{0, 1, 0}}, .contact = Contact::coulomb(0.3)});
        around.list.push_back({.shape = shape,
                               .contact = Contact::coulomb(0.4),
                               .motion = {.position = {0.45, 0.15, 0},
                                          .velocity = {-0.5, 0.1, 0},
                                          .angular_velocity = {0, 0, 2},
                                          .time = 0}});
        Totals const before(block);
        Eigen::Vector2d received = Eigen::Vector2d::Zero();
        double angular = 0, time = 0, pushed = 0;
        for (auto const& report : block.steps(120, 3e-4, around)) {
            time += report.dt;
            Reaction const of_floor = report.reactions[0], of_solid = report.reactions[1];
            received += (of_floor.impulse + of_solid.impulse).head<2>();
            Eigen::Vector2d const at = Eigen::Vector2d(0.45, 0.15) + Eigen::Vector2d(-0.5, 0.1) * time;
            angular += of_floor.angular_impulse.z() + of_solid.angular_impulse.z() +
                       at.x() * of_solid.impulse.y() - at.y() * of_solid.impulse.x();
            pushed += of_solid.impulse.norm();
        }
        Totals const after(block);
        double const scale = before.momentum.norm();
        CHECK(pushed > 0.05 * scale);
        CHECK((before.momentum - after.momentum - received).norm() < 1e-10 * scale);
        CHECK(std::abs(before.angular_momentum - after.angular_momentum - angular) < 1e-9 * scale);
    }
}

using Cases = Combinations<
    Scene<NeoHookean<Plane>, Linear, Apic>, Scene<NeoHookean<Plane>, CubicBSpline, Tpic>,
    More<Scene<NeoHookean<Plane>, QuadraticBSpline, Pic>, Scene<NeoHookean<Plane>, Linear, Flip>,
         Scene<NeoHookean<Plane>, QuadraticBSpline, Asflip>, Scene<NeoHookean<Plane>, CubicBSpline, Xpic>>>;

TEMPLATE_LIST_TEST_CASE("contact of any kind at the surface keeps momentum with every kernel and transfer",
                        "[physics][surface]", Cases)
{
    double const h = 0.05;
    int kind = 0;
    for (auto const& contact :
         {Contact::slip(), Contact::bound_slip(), Contact::coulomb(0.4), Contact::sticky()}) {
        CAPTURE(kind++);
        typename TestType::Solver block(lattice(h));
        block.add(box_of_points<2>({0.02, 0.03}, {0.32, 0.23}, h), h * h / 4, {1, -2});
        Obstacles<AnyShape<>, ActsOn::surface> around;
        around.list.push_back(
            {.shape = HalfSpace{Eigen::Vector3d(0.1, 1, 0).normalized()}, .contact = contact});
        around.list.push_back({.shape = Sphere{0.1},
                               .contact = contact,
                               .motion = {.position = {0.4, 0.1, 0}, .angular_velocity = {0, 0, 8}}});
        Totals const before(block);
        Eigen::Vector2d left = before.momentum;
        double pushed[2]{};
        for (auto const& report : block.steps(100, 2e-4, around))
            for (std::size_t i = 0; i < 2; ++i) {
                left -= report.reactions[i].impulse.template head<2>();
                pushed[i] += report.reactions[i].impulse.norm();
            }
        double const scale = before.momentum.norm();
        CHECK(pushed[0] > 0.05 * scale);
        CHECK(pushed[1] > 0.05 * scale);
        CHECK((Totals(block).momentum - left).norm() < 1e-12 * scale);
    }
}
