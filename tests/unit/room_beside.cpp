// SPDX-License-Identifier: MIT
#include "catch.hpp"

#include <firn/effects/shapes/half_space.hpp>
#include <firn/effects/shapes/solids.hpp>
#include <firn/phases/room_beside.hpp>

#include <cmath>

using namespace firn;

namespace
{

/// The volume that a shape takes from the nodes around it [cells]: its centre lies at `at`.
template <int degree, int d, class ShapeType>
double taken(ShapeType const& shape, Vector<double, d> const& at, int reach)
{
    double sum = 0;
    int const width = 2 * reach + 1;
    for (int i = 0, all = d == 3 ? width * width * width : width * width; i < all; ++i) {
        Vector<double, d> node;
        for (int a = 0, rest = i; a < d; ++a, rest /= width) node[a] = rest % width - reach;
        Vector<double, d> const from = node - at;
        sum += 1 - room_beside<degree, double, d>([&](Vector<double, d> const& cells) {
                       return shape.template surface<double, d>(Vector<double, d>(from + cells)).distance;
                   }).own;
    }
    return sum;
}

template <int degree>
void check_balls()
{
    for (double const place : {0.0, 0.21, 0.5})
        for (double const radius : {3.0, 6.0}) {
            CAPTURE(degree, place, radius);
            Vector<double, 2> in_plane;
            in_plane[0] = place, in_plane[1] = 0.3;
            Vector<double, 3> in_space;
            in_space[0] = place, in_space[1] = 0.3, in_space[2] = 0.4;
            int const reach = static_cast<int>(radius) + 4;
            double const disk = M_PI * radius * radius, ball = 4.0 / 3 * disk * radius;
            // by their tangent planes 2.8 % and 8.3 % too much with three cells and a quadratic kernel
            CHECK(std::abs(taken<degree, 2>(Sphere{radius}, in_plane, reach) / disk - 1) < 1e-3);
            CHECK(std::abs(taken<degree, 3>(Sphere{radius}, in_space, reach) / ball - 1) < 1e-3);
        }
}

} // namespace

TEST_CASE("the room that disks and balls take from nodes is their volume, wherever they lie")
{
    check_balls<2>();
    check_balls<3>();
}

TEST_CASE("that of a box is its volume but for its edges")
{
    Vector<double, 2> at;
    at[0] = 0.3, at[1] = 0.1;
    // 0.13 cells too little; by its tangent planes it is 0.87 too much
    CHECK(std::abs(taken<2, 2>(Box{{4, 3, 0}}, at, 8) - 48) < 0.2);
}

TEST_CASE("beside a plane the distance of the node decides")
{
    for (double height = -2; height < 2; height += 0.1) {
        Vector<double, 3> normal, node;
        normal[0] = 0.36, normal[1] = 0.48, normal[2] = 0.8;
        for (int a = 0; a < 3; ++a) node[a] = normal[a] * height;
        HalfSpace const plane{{0.36, 0.48, 0.8}};
        auto const left = room_beside<2, double, 3>([&](Vector<double, 3> const& cells) {
            return plane.surface<double, 3>(Vector<double, 3>(node + cells)).distance;
        });
        CHECK(std::abs(left.own - share_above<2>(height)) < 1e-13);
        for (int b = 0; b < 6; ++b)
            CHECK(std::abs(left.of_neighbours[b] -
                           share_above<2>(height + (b % 2 == 0 ? -1 : 1) * normal[b / 2])) < 1e-13);
    }
}
