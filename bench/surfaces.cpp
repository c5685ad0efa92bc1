// SPDX-License-Identifier: MIT
// How well obstacles that act at their surface hold water that keeps its volume.
//     surfaces [fine|finest]
// Prints figures, one to a line, which results.py reads: tanks at rest for 2 s in the plane, by their place
// on the cells and the size of these; the lift of a disk, and of a ball in space, over that of Archimedes;
// how far disks float off his depth, in their size; the particles that leave a tank, and hoppers of water
// and of sand; and the error of a standing wave between walls. With `fine`, cells of half the size, larger
// disks, and hoppers in space, too: some minutes. With `finest`, a ball of twelve cells alone, in 1.7 million
// particles: half a minute of a GPU, or an hour.
#include "on_each_backend.hpp"
#include "problems/floating.hpp"
#include "problems/hopper.hpp"
#include "problems/standing_wave.hpp"
#include "tank.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <string>
#include <vector>

using namespace firn;

namespace
{

using Water = KeepsVolume<Fluid<bench::Plane>>;
using Tank = bench::Tank<Water, QuadraticBSpline, Mls>;

void figure(std::string const& entry, double value, char const* unit)
{
    std::printf("figure surfaces/%s %.6g %s\n", entry.c_str(), value, unit);
    std::fflush(stdout);
}

struct Place
{
    char const* name;
    double degrees;
    Eigen::Vector2d offset;
};
std::array<Place, 4> const places{{{"on_nodes", 0, {0, 0}},
                                   {"half_a_cell_off", 0, {0.5, 0.5}},
                                   {"17_degrees", 17, {0.3, 0.21}},
                                   {"30_degrees", 30, {0.3, 0.21}}}};

void tank_at_rest(Place const& place, double h)
{
    Tank tank({.degrees = place.degrees, .offset = place.offset, .h = h});
    tank.advance(1);
    double const duration = 1, depth = tank.setting().depth;
    auto const report = tank.advance(duration);
    std::string const entry = "tank/" + std::string(place.name) + '/' + std::to_string(int(1000 * h)) + "mm/";
    double const of_side = 0.5 * 1000 * bench::g * depth * depth;
    figure(entry + "speed", 100 * tank.speed() / std::sqrt(bench::g * depth), "%");
    figure(entry + "level", tank.level(), "%");
    figure(entry + "force_on_floor", 100 * (tank.force(report, 0, {0, -1}, duration) / tank.weight() - 1),
           "%");
    for (int side = 0; side < 2; ++side) // water leans on the walls at its sides
        figure(entry + (side == 0 ? "force_on_left" : "force_on_right"),
               100 * (tank.force(report, std::size_t(1 + side), {side == 0 ? -1.0 : 1.0, 0}, duration) /
                          of_side -
                      1),
               "%");
    figure(entry + "pressure_at_floor", 100 * (tank.pressure_at_floor() - 1), "%");
    figure(entry + "raw_pressure_at_floor", 100 * (tank.raw_pressure_at_floor() - 1), "%");
}

void lift_of_disk(Place const& place, double radius_in_cells)
{
    double const radius = 0.06, h = radius / radius_in_cells;
    Tank tank(
        {.degrees = place.degrees, .offset = place.offset, .h = h, .radius = radius, .half_width = 0.24});
    tank.advance(0.15);
    double const duration = 0.45;
    auto const report = tank.advance(duration);
    double const displaced = 1000 * bench::g * M_PI * radius * radius;
    figure("lift/disk/" + std::string(place.name) + '/' + std::to_string(int(radius_in_cells)) + "_cells",
           100 * (tank.force(report, 3, {0, 1}, duration) / displaced - 1), "%");
}

/// Water at rest around a ball: cubes that it cuts are as large as what it leaves of them, and all lie as
/// high as the weight above them lets them. (By whole cubes the hole of a ball of three cells would be 0.8 %
/// too large.)
struct AroundBall
{
    double radius, spacing; ///< [m]
    Eigen::Vector3d middle;
    double exponent, softness; ///< Tait's; rho g over the bulk modulus [1/m]
    double depth;
    std::vector<Eigen::Vector3d> points{};
    std::vector<double> volumes{};
    std::vector<float> log_J{};

    void add(Eigen::Vector3d const& cube)
    {
        constexpr int parts = 8; // along an axis
        Eigen::Vector3d sum = Eigen::Vector3d::Zero();
        int count = 0;
        for (int i = 0; i < parts * parts * parts; ++i) {
            Eigen::Vector3d const own(i % parts, i / parts % parts, i / parts / parts),
                x = cube + spacing * ((own.array() + 0.5) / parts - 0.5).matrix();
            if ((x - middle).norm() > radius) sum += x, ++count;
        }
        if (50 * count < parts * parts * parts) return;
        Eigen::Vector3d x = sum / count;
        double const away = (x - middle).norm();
        if (away < radius) x = middle + (x - middle) * (radius / away);
        log_J.push_back(float(-std::log(power(x.y())) / exponent));
        double const of_height = 1 - 1 / exponent;
        x.y() = (std::pow(power(0), of_height) - std::pow(power(x.y()), of_height)) /
                (exponent * of_height * softness);
        points.push_back(x);
        volumes.push_back(std::pow(spacing, 3) * count / (parts * parts * parts));
    }

private:
    double power(double y) const { return 1 + exponent * softness * (depth - y); }
};

/// A place in space: the tank is turned about z, and nodes are moved against it [cells].
struct PlaceInSpace
{
    char const* name;
    double degrees;
    Eigen::Vector3d offset;
    double narrower = 0; ///< than a whole number of cells, by so many at each side; else all walls lie alike
};
std::array<PlaceInSpace, 6> const places_in_space{
    {{"on_nodes", 0, {0, 0, 0}},
     {"half_a_cell_off", 0, {0.5, 0.5, 0.5}},
     {"between_nodes", 0, {0.3, 0.21, 0.4}},
     {"17_degrees", 17, {0.3, 0.21, 0.4}},
     {"30_degrees", 30, {0.3, 0.21, 0.4}},
     {"half_a_cell_off_and_sides_on_nodes", 0, {0.5, 0.5, 0.5}, 0.5}}};

void lift_of_ball(PlaceInSpace const& place, double radius_in_cells)
{
    using Ball = KeepsVolume<Fluid<Space<3, float>>>;
    double const radius = 0.06, h = radius / radius_in_cells, side = 0.16 - place.narrower * h, depth = 0.3;
    Eigen::Matrix3d const turned =
        Eigen::AngleAxisd(place.degrees * M_PI / 180, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    Ball const model = materials::water<Space<3, float>>(3);
    Solver<bench::Backend, Ball> water(lattice(h, place.offset * h), model, {}, {}, bench::backend());
    Eigen::Vector3d const middle(0, depth / 2, 0), up = turned.col(1);
    AroundBall around{radius, h / 2, middle, 7, 1000 * bench::g / double(model.bulk_modulus), depth};
    for (double x = -side + h / 4; x < side; x += h / 2)
        for (double y = h / 4; y < depth; y += h / 2)
            for (double z = -side + h / 4; z < side; z += h / 2) around.add({x, y, z});
    for (auto& x : around.points) x = turned * x;
    water.add(around.points, around.volumes);
    water.upload<LogVolumeRatio>(around.log_J);
    bench::Walls walls;
    auto const add = [&](Eigen::Vector3d const& normal, Eigen::Vector3d const& at) {
        walls.list.push_back(
            {.shape = HalfSpace{turned * normal}, .motion = {.position = turned * at}, .on_particles = true});
    };
    walls.list.push_back(
        {.shape = Sphere{radius}, .motion = {.position = turned * middle}, .on_particles = true});
    add({0, 1, 0}, {0, 0, 0});
    for (double const towards : {-1.0, 1.0}) {
        add({towards, 0, 0}, {-towards * side, 0, 0});
        add({0, 0, towards}, {0, 0, -towards * side});
    }
    Gravity const gravity{-bench::g * up};
    water.advance(0.1, gravity, walls);
    double const duration = 0.2;
    auto const report = water.advance(duration, gravity, walls);
    double const displaced = 1000 * bench::g * 4 / 3 * M_PI * std::pow(radius, 3);
    figure("lift/ball/" + std::string(place.name) + '/' + std::to_string(int(radius_in_cells)) + "_cells",
           100 * (report.reactions[0].impulse.dot(up) / duration / displaced - 1), "%");
}

void floating(Place const& place)
{
    for (double const density : {0.3, 0.5, 0.8}) {
        test::FloatingDisk const disk(density, place.degrees * M_PI / 180, place.offset, bench::backend());
        std::string const entry = "floating/" + std::string(place.name) + '/' +
                                  std::to_string(int(10 * density)) + "_tenths_of_water/";
        figure(entry + "rigid", 100 * disk.of_rigid_body(0.5, 1), "%");
        figure(entry + "elastic", 100 * disk.of_elastic_body(0.5, 1), "%");
    }
}

/// How many particles a hopper loses, and how deep one comes into a board.
template <ActsOn acts_on = ActsOn::surface_and_particles, class Model>
void hopper(std::string const& name, Model const& model, test::HopperSetting const& setting, double duration)
{
    test::Hopper<test::Scene<Model, QuadraticBSpline, Mls>, acts_on> of(setting, model, bench::backend());
    of.advance(duration);
    std::string const entry =
        "hopper/" + name + (setting.opening > 0 ? "/open/" : "/shut/") +
        (setting.boards == test::Boards::boxes      ? setting.overlap > 0 ? "boxes" : "boxes_that_only_touch"
         : setting.boards == test::Boards::capsules ? "capsules"
                                                    : "half_spaces") +
        '/' + std::to_string(int(std::lround(setting.slope * 180 / M_PI))) + "_degrees/" +
        (acts_on == ActsOn::surface ? "at_surface_alone/" : "");
    figure(entry + "particles", double(of.solver.size()), "1");
    figure(entry + "steps", double(of.steps), "1");
    figure(entry + "lost", double(of.lost), "1");
    figure(entry + "deepest", std::max(of.deepest, 0.0), "cells");
}

/// The same in all shapes, of water and of sand.
template <class Space>
void hoppers(std::string const& where, test::HopperSetting setting, double duration)
{
    KeepsVolume<Fluid<Space>> const water(materials::water<Space>(3));
    auto const sand = materials::dry_sand<Space>();
    auto const of_both = [&](test::Boards boards, double degrees, double opening) {
        setting.boards = boards, setting.slope = degrees * M_PI / 180, setting.opening = opening;
        setting.contact = Contact::slip();
        hopper(where + "/water", water, setting, duration);
        setting.contact = Contact::coulomb(0.3);
        hopper(where + "/sand", sand, setting, duration);
    };
    double const open = 4 * setting.h;
    of_both(test::Boards::boxes, 60, 0);
    of_both(test::Boards::boxes, 60, open);
    of_both(test::Boards::half_spaces, 75, 0);
    if constexpr (Space::dimension == 2) { // in space capsules make no walls
        of_both(test::Boards::boxes, 75, 0);
        of_both(test::Boards::boxes, 75, open);
        of_both(test::Boards::capsules, 60, 0);
        of_both(test::Boards::capsules, 60, open);
    }
    setting.boards = test::Boards::boxes, setting.slope = M_PI / 3, setting.contact = Contact::slip();
    for (double const opening : {0.0, open}) {
        setting.opening = opening;
        hopper<ActsOn::surface>(where + "/water", water, setting, duration);
        auto touching = setting;
        touching.overlap = 0;
        hopper(where + "/water", water, touching, duration);
    }
}

/// The error of a standing wave between walls, over its amplitude, and by which power of the cell size it
/// falls.
void standing_wave(std::string const& where, double offset)
{
    using Bar = test::Scene<NeoHookean<bench::Plane>, QuadraticBSpline, Mls>;
    double const coarse = test::error_of_standing_wave<Bar>(16, test::Ends::at_surface, offset),
                 medium = test::error_of_standing_wave<Bar>(32, test::Ends::at_surface, offset),
                 fine = test::error_of_standing_wave<Bar>(64, test::Ends::at_surface, offset);
    std::string const entry = "standing_wave/" + where + '/';
    figure(entry + "64_cells", 100 * fine, "%");
    figure(entry + "order_from_16_to_32", std::log2(coarse / medium), "1");
    figure(entry + "order_from_32_to_64", std::log2(medium / fine), "1");
}

void leaks()
{
    Tank tank({.degrees = 17, .h = 0.0031}); // some 1e5 particles
    double const of_call = 0.01;
    std::uint64_t steps = 0;
    for (double time = 0; steps < 2000; time += of_call) // shaken, so that it is no idle test
        steps += tank.advance(of_call, 0.5 * std::sin(2 * M_PI * tank.frequency() * time)).substeps;
    figure("leaks/particles", double(tank.size()), "1");
    figure("leaks/steps", double(steps), "1");
    figure("leaks/lost", tank.lost(), "1");
}

} // namespace

int main(int argc, char** argv)
{
    std::string const how = argc > 1 ? argv[1] : "";
    if (how == "finest") {
        lift_of_ball(places_in_space[2], 12);
        return 0;
    }
    bool const is_fine = how == "fine";
    if (argc > 2 || (!how.empty() && !is_fine)) {
        std::fprintf(stderr, "surfaces [fine|finest]\n");
        return 1;
    }
    for (auto const& place : places) {
        tank_at_rest(place, 0.02);
        if (is_fine) tank_at_rest(place, 0.01);
    }
    for (auto const& place : places)
        for (double const radius : {3.0, 6.0, 12.0})
            if (radius < 12 || is_fine) lift_of_disk(place, radius);
    for (auto const& place : places_in_space) {
        lift_of_ball(place, 3);
        if (is_fine) lift_of_ball(place, 6);
    }
    for (auto const& place : places) floating(place);
    leaks();
    standing_wave("on_nodes", 0);
    standing_wave("3_tenths_off", 0.3);
    standing_wave("half_a_cell_off", 0.5);
    hoppers<bench::Plane>("plane", {.h = 0.01}, 0.5); // of twice the cells of the test, for some 3 000 steps
    if (is_fine) hoppers<Space<3, float>>("space", {.height = 0.3, .offset = {0.3, 0.21, 0.4}}, 0.6);
}
