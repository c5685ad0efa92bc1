// SPDX-License-Identifier: MIT
#include "catch.hpp"
#include "problems/hopper.hpp"

#include <firn/models/fluids/keeps_volume.hpp>

#include <algorithm>
#include <cmath>

// Water and sand in hoppers of boards that act at their surface, and on particles or not.
using namespace firn;
using namespace firn::test;

namespace
{

struct Kind
{
    Boards boards;
    double overlap; ///< [cells]
};

/// Whether nothing is lost in what is shut and in what has an opening, through which it flows.
template <class Model>
void check_hoppers(Model const& model, Contact const& contact)
{
    for (auto const& [boards, overlap] : {Kind{Boards::boxes, 1}, Kind{Boards::boxes, 0},
                                          Kind{Boards::capsules, 0}, Kind{Boards::half_spaces, 0}})
        for (double const degrees : {60.0, 75.0}) // of the slope: the boards form an angle of 60, or 30
            for (double const opening : {0.0, 0.08}) {
                if (boards == Boards::half_spaces && opening > 0) continue;
                CAPTURE(int(boards), overlap, degrees, opening);
                Hopper<Scene<Model, QuadraticBSpline, Mls>> hopper({.boards = boards,
                                                                    .opening = opening,
                                                                    .overlap = overlap,
                                                                    .slope = degrees * M_PI / 180,
                                                                    .contact = contact},
                                                                   model);
                hopper.advance(0.4);
                CHECK(hopper.lost == 0);
                CHECK(hopper.deepest < 0.01);                                             // [cells]
                if (opening > 0) CHECK(hopper.count_below() > hopper.solver.size() / 10); // it flows
            }
}

} // namespace

TEST_CASE("hoppers whose boards meet at sharp angles lose no water", "[physics][surface]")
{
    check_hoppers(KeepsVolume<Fluid<Plane>>(materials::water<Plane>(3)), Contact::slip());
}

TEST_CASE("hoppers whose boards meet at sharp angles lose no sand", "[physics][surface]")
{
    check_hoppers(materials::dry_sand<Plane>(), Contact::coulomb(0.3));
}

namespace
{

using Water = KeepsVolume<Fluid<Plane>>;

/// A block of water in a tank that is turned against the cells and lies between nodes.
struct TankOfBoards
{
    static constexpr double h = 0.02, half_width = 0.2, depth = 0.2; ///< [m]

    TankOfBoards(double degrees, double offset) : turn(degrees * M_PI / 180), origin(offset * h, offset * h)
    {
        auto points = box_of_points<2>({-half_width, 0}, {half_width, depth}, h);
        for (auto& x : points) x = turn * x + origin;
        water.add(points, h * h / 4);
    }
    /// A board between these corners, in the tank's own axes.
    void add(Eigen::Vector2d const& low, Eigen::Vector2d const& high)
    {
        Eigen::Vector2d const half = 0.5 * (high - low), at = turn * (0.5 * (low + high)) + origin;
        boards.list.push_back({.shape = Box{{half.x(), half.y(), 1}},
                               .motion = {.position = {at.x(), at.y(), 0},
                                          .orientation = Eigen::Quaterniond(
                                              Eigen::AngleAxisd(turn.angle(), Eigen::Vector3d::UnitZ()))}});
    }
    /// How far a particle ever came behind a wall or the floor, in half a second [cells].
    double deepest()
    {
        Eigen::Vector2d const down = turn * Eigen::Vector2d(0, -9.81);
        double most = -1e9;
        for (int call = 0; call < 50; ++call) {
            water.advance(0.01, Gravity{{down.x(), down.y(), 0}}, boards);
            for (auto const& x : water.positions()) {
                Eigen::Vector2d const own = turn.inverse() * (x - origin);
                most = std::max({most, -own.y() / h, (std::abs(own.x()) - half_width) / h});
            }
        }
        return most;
    }

    Eigen::Rotation2Dd turn;
    Eigen::Vector2d origin;
    Scene<Water, QuadraticBSpline, Mls>::Solver water{lattice(h), materials::water<Plane>(3)};
    Obstacles<AnyShape<>, ActsOn::surface> boards;
};

} // namespace

// Boards overlap, or nothing but their edges touch. A particle may come a little into a board before that
// pushes back: none is pushed out.
TEST_CASE("at the surface alone they lose no water either, however sharp they are", "[physics][surface]")
{
    for (double const overlap : {0.0, 1.0})
        for (double const degrees : {60.0, 75.0, 82.5}) // the boards form an angle of 60, 30 or 15
            for (double const offset : {0.0, 0.3, 0.5}) {
                CAPTURE(overlap, degrees, offset);
                Hopper<Scene<Water, QuadraticBSpline, Mls>, ActsOn::surface> hopper(
                    {.overlap = overlap, .slope = degrees * M_PI / 180, .offset = {offset, 0.7 * offset, 0}},
                    materials::water<Plane>(3));
                hopper.advance(0.4);
                CHECK(hopper.lost == 0);
                CHECK(hopper.deepest < 0.3); // [cells]
            }
}

// What flows along the floor of the tray and is turned by a wall drives what is a little inside deeper.
TEST_CASE("at the surface alone nothing is lost where water runs out of a hopper, either",
          "[physics][surface]")
{
    struct Setting
    {
        double overlap, degrees, offset;
    };
    for (auto const& [overlap, degrees, offset] : {Setting{1, 60, 0.3}, {1, 75, 0.3}, {0, 75, 0.5}}) {
        CAPTURE(overlap, degrees, offset);
        Hopper<Scene<Water, QuadraticBSpline, Mls>, ActsOn::surface> hopper(
            {.opening = 0.04,
             .overlap = overlap,
             .slope = degrees * M_PI / 180,
             .h = 0.01,
             .offset = {offset, 0.7 * offset, 0}},
            materials::water<Plane>(3));
        hopper.advance(0.5);
        CHECK(hopper.lost == 0);
        CHECK(hopper.deepest < 0.1); // [cells]
        CHECK(hopper.count_below() > hopper.solver.size() / 10);
    }
}

TEST_CASE("tanks of boards and of tiles that only touch hold water at the surface alone",
          "[physics][surface]")
{
    double const w = TankOfBoards::half_width, t = 4 * TankOfBoards::h;
    for (double const degrees : {0.0, 17.0, 30.0})
        for (double const offset : {0.0, 0.25, 0.75}) {
            CAPTURE(degrees, offset);
            TankOfBoards on_floor(degrees, offset), beside_floor(degrees, offset), edges(degrees, offset);
            on_floor.add({-w - t, -t}, {w + t, 0});
            on_floor.add({-w - t, 0}, {-w, 1});
            on_floor.add({w, 0}, {w + t, 1});
            CHECK(on_floor.deepest() < 0.5);
            beside_floor.add({-w, -t}, {w, 0});
            beside_floor.add({-w - t, -t}, {-w, 1});
            beside_floor.add({w, -t}, {w + t, 1});
            CHECK(beside_floor.deepest() < 0.5);
            edges.add({-w, -t}, {w, 0});
            edges.add({-w - t, 0}, {-w, 1});
            edges.add({w, 0}, {w + t, 1});
            CHECK(edges.deepest() < 0.5);
        }
    for (double const degrees : {0.0, 17.0, 30.0})
        for (double const of_tile : {1.3, 2.65, 4.0, 5.0}) { // [cells]
            CAPTURE(degrees, of_tile);
            TankOfBoards tank(degrees, 0.3);
            double const side = of_tile * TankOfBoards::h;
            for (double x = -w - 2 * side; x < w + side; x += side) tank.add({x, -side}, {x + side, 0});
            tank.add({-w - t, 0}, {-w, 1});
            tank.add({w, 0}, {w + t, 1});
            CHECK(tank.deepest() < 0.5);
        }
}
