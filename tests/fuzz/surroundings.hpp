// SPDX-License-Identifier: MIT
#pragma once

#include "scenes.hpp"

#include <firn/effects/damping.hpp>
#include <firn/effects/force.hpp>
#include <firn/effects/held.hpp>
#include <firn/effects/held_marked.hpp>
#include <firn/effects/local_damping.hpp>
#include <firn/effects/marked_force.hpp>
#include <firn/effects/obstacles.hpp>
#include <firn/effects/pose_path.hpp>
#include <firn/effects/shapes/union.hpp>
#include <firn/effects/traction.hpp>

#include <cmath>
#include <vector>

// The effects of the harness `calls`: they change between calls, and some of them are any numbers.
namespace firn::fuzz
{

constexpr double cell = 0.05; // [m]
constexpr int wall_node = 20; // walls at ±1 m

template <class Solver>
struct Surroundings
{
    static constexpr int d = Solver::d;
    using Pair = Union<Sphere, Box>;

    Gravity gravity{};
    Force<Sphere> blast{.shape = {0.2}, .acceleration = {0, 0, 0}};
    MarkedForce<Mark> wind{};
    HeldMarked<Mark> grip{.beyond = 0.9};
    Traction load{};
    Damping damping{};
    LocalDamping local_damping{.share = 0};
    Obstacle<HalfSpace> floor{.contact = Contact::coulomb(0.3)};
    Obstacle<Sphere> ball{.shape = {0.2}, .motion = {.position = {0.3, 0.1, 0}}};
    Obstacles<AnyShape<Pair>, ActsOn::particles> crates{};
    Obstacles<Shell<AnyShape<>>> shells{};
    Held<Sphere> held{.shape = {1e-3}, .motion = {.position = {50, 50, 0}}}; // holds nothing yet
    ReflectingWall left{.axis = 0, .node = -wall_node, .side = 1},
        right{.axis = 0, .node = wall_node, .side = -1};

    /// Calls `use` with all effects.
    template <class Use>
    auto with(Use const& use) const
    {
        auto const with_others = [&](auto const&... marked) {
            return use(marked..., gravity, blast, floor, ball, crates, shells, held, left, right);
        };
        if constexpr (is_pool<Solver>)
            return use(gravity, blast, as_one_surface());
        else if constexpr (has_marks<Solver>)
            return with_others(wind, grip, load, damping, local_damping);
        else
            return with_others();
    }

    /// The solids as one list that acts at their surface.
    using Surface = Obstacles<AnyShape<Pair>, ActsOn::surface_and_particles>;
    Surface as_one_surface() const
    {
        Surface surface{crates.list};
        auto const add = [&](auto const& obstacle) {
            surface.list.push_back({.shape = obstacle.shape,
                                    .contact = obstacle.contact,
                                    .motion = obstacle.motion,
                                    .on_particles = obstacle.on_particles});
        };
        add(floor);
        add(ball);
        return surface;
    }

    /// How many reactions these have.
    std::size_t reactions() const
    {
        if constexpr (is_pool<Solver>) return 2 + crates.list.size();
        return (has_marks<Solver> ? 1 : 0) + 5 + crates.list.size() + shells.list.size();
    }

    /// Whether something changes momentum by what nothing tells of.
    bool has_secrets() const
    {
        return blast.acceleration.norm() > 0 ||
               (has_marks<Solver> && (damping.rate > 0 || local_damping.share > 0));
    }

    /// The impulse of all forces in a time [s], and the scale of its rounding errors.
    struct Impulse
    {
        Vector<double, d> sum = Vector<double, d>::Zero();
        double scale = 0;
    };
    Impulse forces(Solver const& solver, Told<Solver> const& told, double elapsed) const
    {
        Impulse all;
        auto const add = [&](Eigen::Vector3d const& force) {
            all.sum += elapsed * force.head<d>();
            all.scale += elapsed * force.norm();
        };
        add(told.mass() * gravity.acceleration);
        if constexpr (has_marks<Solver>) {
            auto const marks = solver.template download<Mark>();
            auto const areas = solver.template download<AreaPerMass>();
            for (std::size_t i = 0; i < marks.size(); ++i) {
                add(told.masses[i] * double(marks[i]) * wind.acceleration);
                Eigen::Vector3d area(0, 0, 0);
                area.head<d>() = told.masses[i] * areas[i].template cast<double>();
                add(load.stress * area);
            }
        }
        return all;
    }

    void change_gravity(Input& input)
    {
        gravity.acceleration = {input.between(-20, 20), input.between(-20, 20), 0};
    }
    void change_wind(Input& input)
    {
        wind.acceleration = {input.between(-20, 20), input.between(-20, 20), 0};
    }
    void change_grip(Input& input)
    {
        grip.motion.position = {input.between(-1, 1), input.between(-0.2, 1), 0};
        grip.motion.velocity = {input.between(-2, 2), input.between(-2, 2), 0};
        grip.motion.angular_velocity = {0, 0, input.between(-5, 5)};
        grip.beyond = input.between(0, 0.99);
    }
    void change_contact(int what)
    {
        ball.on_particles = what & 1;
        ball.contact = what & 2 ? Contact::sticky() : what & 4 ? Contact::coulomb(0.5) : Contact::slip();
        floor.contact = what & 8    ? Contact::sticky()
                        : what & 16 ? Contact::bound_slip()
                                    : Contact::coulomb(0.3);
    }

    /// The ball moves; with a velocity to the right it goes on through all calls from `now` on.
    void move_ball(Input& input, double now)
    {
        auto& motion = ball.motion;
        if (input.below(8) == 0)
            ball.shape = Sphere{input.any(0.2)};
        else
            ball.shape = Sphere{input.between(0.01, 0.4)};
        motion.position = {input.between(-1, 1), input.between(-0.2, 1), 0};
        motion.velocity = {input.between(-10, 10), input.between(-10, 10), 0};
        motion.angular_velocity = {0, 0, input.between(-50, 50)};
        motion.time.reset();
        if (motion.velocity.x() > 0) motion.time = now;
    }

    /// The ball follows a path from `now` on, if that makes sense.
    void follow_path(Input& input, double now)
    {
        PosePath path;
        int const keys = input.below(5);
        bool const any = input.below(4) == 0;
        double time = now;
        for (int i = 0; i < keys; ++i) {
            time += any ? input.any(1e-3) : input.between(0, 1e-2);
            Eigen::Vector3d position(input.between(-1, 1), input.between(-0.2, 1), 0);
            Eigen::Quaterniond orientation(input.between(-1, 1), 0, 0, input.between(-1, 1));
            if (any) position.y() = input.any(1), orientation.x() = input.any(1e-9);
            std::size_t const before = path.size();
            bool const was_refused = refused([&] { path.add(time, position, orientation.normalized()); });
            expect(path.size() == before + (was_refused ? 0 : 1), "a path has another number of keys");
        }
        double const duration = any ? input.any(1e-3) : input.between(0, 1e-2);
        Motion motion;
        if (refused([&] { motion = path.during(now, duration); })) return;
        expect(path.size() > 0, "a path without a key has a pose");
        expect(motion.position.allFinite() && motion.velocity.allFinite() &&
                   motion.angular_velocity.allFinite() && motion.orientation.coeffs().allFinite(),
               "a motion by a path is not finite");
        ball.motion = motion;
    }

    /// Obstacles come, move and go, and a region is held or let go.
    void change_crates(Input& input)
    {
        Motion const motion = some_motion(input);
        auto& list = crates.list;
        switch (input.below(5)) {
        case 0:
            if (list.size() < 20)
                list.push_back({.shape = Sphere{input.between(0.01, 0.2)}, .motion = motion});
            break;
        case 1:
            if (list.size() < 20) list.push_back({.shape = Box{{0.1, 0.05, 0.1}}, .motion = motion});
            break;
        case 2:
            if (!list.empty()) list.erase(list.begin() + input.below(int(list.size())));
            break;
        case 3:
            for (auto& crate : list) crate.motion.velocity = motion.velocity;
            break;
        default:
            held.motion = motion;
            held.shape.radius = input.between(0.01, 0.1);
            break;
        }
    }

    /// What makes a scene hard: shells, unions, loads and damping.
    void change_more(Input& input)
    {
        bool const any = input.below(8) == 0;
        switch (input.below(9)) {
        case 0:
        case 1:
            add_shell(input, any);
            break;
        case 2:
            if (!shells.list.empty()) shells.list.pop_back();
            break;
        case 3:
            add_union(input, any);
            break;
        case 4:
            damping.rate = any ? input.any(10) : input.between(0, 100);
            break;
        case 5:
            local_damping.share = any ? input.any(0.5) : input.between(0, 0.99);
            break;
        case 6:
            load.stress.setZero();
            for (int i = 0; i < 4; ++i)
                load.stress(i % 2, i / 2) = any ? input.any(1e3) : input.between(-1e4, 1e4);
            if (any) load.stress(2, 2) = input.any(1);
            break;
        case 7:
            blast.acceleration.x() = any ? input.any(1e3) : input.between(-1e3, 1e3);
            blast.motion = some_motion(input);
            break;
        default: // momentum is looked after once more
            damping.rate = local_damping.share = 0;
            blast.acceleration.setZero();
            break;
        }
    }

private:
    static Motion some_motion(Input& input)
    {
        return {.position = {input.between(-1, 1), input.between(-0.2, 1), 0},
                .velocity = {input.between(-5, 5), input.between(-5, 5), 0}};
    }

    void add_shell(Input& input, bool any)
    {
        if (shells.list.size() == 4) return;
        double const thickness = any ? input.any(0.01) : input.between(1e-4, 0.02),
                     size = any ? input.any(0.1) : input.between(0.02, 0.3);
        AnyShape<> shape = Sphere{size};
        if (input.below(3) == 0) shape = Box{{size, 0.1, 1}};
        if (input.below(3) == 0) shape = HalfSpace{};
        shells.list.push_back({.shape = {shape, thickness}, .motion = some_motion(input)});
        shells.list.back().motion.angular_velocity.z() = input.between(-9, 9);
    }

    void add_union(Input& input, bool any)
    {
        if (crates.list.size() == 20) return;
        Pair shape;
        auto& [ball, box] = shape.parts;
        ball = {.shape = {any ? input.any(0.1) : input.between(0.02, 0.2)}};
        box = {.shape = {{input.between(0.02, 0.2), 0.05, 1}}, .position = {input.between(-0.2, 0.2), 0, 0}};
        if (any) box.orientation.z() = input.any(0.1);
        crates.list.push_back({.shape = shape, .motion = some_motion(input)});
        crates.list.back().on_particles = input.below(2) == 0;
    }
};

} // namespace firn::fuzz
