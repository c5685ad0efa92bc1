// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/models/fluids/keeps_volume.hpp>
#include <firn/models/several_materials.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace firn::test
{

/// How high above the surface of a liquid the centre of a disk floats, by Archimedes; `density` in that of
/// the liquid.
inline double height_of_floating_disk(double density, double radius)
{
    double low = -radius, high = radius;
    for (int i = 0; i < 50; ++i) {
        double const middle = (low + high) / 2;
        // a segment of the circle is immersed
        double const half_angle = std::acos(std::clamp(middle / radius, -1.0, 1.0));
        (half_angle - std::sin(2 * half_angle) / 2 > density * M_PI ? low : high) = middle;
    }
    return low;
}

/// A disk that floats in a tank of water that keeps its volume. The tank lies somehow across the cells.
class FloatingDisk
{
public:
    using Water = KeepsVolume<Fluid<Plane>>;
    using Elastic = NeoHookean<Plane>;
    static constexpr double h = 0.02, half_width = 0.3, depth = 0.4, radius = 4 * h;

    /// `density`: of the disk, in that of water; `origin`: of the tank, in cells from a node.
    explicit FloatingDisk(double density, double angle = 0, Eigen::Vector2d const& origin = {0.3, 0.21},
                          TestedBackend const& backend = {})
        : density_(density), height_(depth + height_of_floating_disk(density, radius)), turn_(angle),
          origin_(origin * h), backend_(backend)
    {
        Eigen::Vector2d const centre(0, height_);
        for (auto const& x :
             box_of_points<2>({-half_width, 0}, {half_width, std::max(depth, height_ + radius)}, h)) {
            Eigen::Vector2d const there = turn_ * x + origin_;
            if ((x - centre).norm() < radius)
                body_.push_back(there);
            else if (x.y() < depth) {
                water_.push_back(there);
                double const pressure = model_.density * g * (depth - x.y());
                log_J_.push_back(-std::log1p(model_.exponent * pressure / model_.bulk_modulus) /
                                 model_.exponent);
            }
        }
        add_wall({0, 1}, {0, 0});
        add_wall({1, 0}, {-half_width, 0});
        add_wall({-1, 0}, {half_width, 0});
    }

    /// How far a rigid disk lies too high, over its size, as a mean of the second of two durations [s].
    double of_rigid_body(double settles, double duration) const
    {
        firn::Solver<TestedBackend, Water, QuadraticBSpline, Mls> solver(lattice(h), model_, {}, {},
                                                                         backend_);
        solver.add(water_, h * h / 4);
        solver.upload<LogVolumeRatio>(log_J_);
        double const mass = density_ * model_.density * M_PI * radius * radius,
                     flat = mass * radius * radius / 4;
        RigidBody disk{.mass = mass, .motion = {.position = in_world({0, height_})}};
        disk.inertia = Eigen::Vector3d(flat, flat, 2 * flat).asDiagonal();
        auto around = walls_;
        around.list.push_back({.shape = Sphere{radius}, .on_particles = true});
        auto const pull = gravity();
        return mean_error(settles, duration, 0.002, [&](double of_call) {
            around.list.back().motion = disk.motion;
            auto const report = solver.advance(of_call, pull, around);
            disk.advance(report.reactions.back(), of_call, pull.acceleration);
            return own_height(disk.motion.position.head<2>());
        });
    }

    /// The same of an elastic one.
    double of_elastic_body(double settles, double duration) const
    {
        Elastic light;
        light.density = density_ * model_.density;
        light.elasticity = lame<double>(4e5, 0.3); // the water's pressure makes it smaller by a hundredth
        using Both = Materials<Water, Elastic>;
        firn::Solver<TestedBackend, Both, QuadraticBSpline, Mls> solver(lattice(h), Both{model_, light}, {},
                                                                        {}, backend_);
        solver.add<Material<0>>(water_, h * h / 4);
        solver.upload<LogVolumeRatio, Material<0>>(log_J_);
        // as large as its circle, which lies across the squares of the particles
        solver.add<Material<1>>(body_, M_PI * radius * radius / double(body_.size()));
        auto const pull = gravity();
        return mean_error(settles, duration, 0.02, [&](double of_call) {
            solver.advance(of_call, pull, walls_);
            double sum = 0;
            auto const now = solver.positions<Material<1>>();
            for (auto const& x : now) sum += own_height(x) / double(now.size());
            return sum;
        });
    }

private:
    static constexpr double g = 9.81; // [m/s^2]

    Eigen::Vector3d in_world(Eigen::Vector2d const& own) const
    {
        Eigen::Vector2d const there = turn_ * own + origin_;
        return {there.x(), there.y(), 0};
    }
    Eigen::Vector3d direction(Eigen::Vector2d const& own) const
    {
        Eigen::Vector2d const there = turn_ * own;
        return {there.x(), there.y(), 0};
    }
    double own_height(Eigen::Vector2d const& x) const { return (turn_.inverse() * (x - origin_)).y(); }
    Gravity gravity() const { return {direction({0, -g})}; }
    void add_wall(Eigen::Vector2d const& normal, Eigen::Vector2d const& at)
    {
        walls_.list.push_back({.shape = HalfSpace{direction(normal)},
                               .motion = {.position = in_world(at)},
                               .on_particles = true});
    }

    /// `advance(of_call)` returns a height [m].
    double mean_error(double settles, double duration, double of_call, auto const& advance) const
    {
        double sum = 0;
        int const calls = static_cast<int>(std::lround(duration / of_call));
        for (int i = -static_cast<int>(std::lround(settles / of_call)); i < calls; ++i) {
            double const height = advance(of_call);
            if (i >= 0) sum += height / calls;
        }
        return (sum - height_) / (2 * radius);
    }

    double density_, height_;
    Eigen::Rotation2Dd turn_;
    Eigen::Vector2d origin_;
    TestedBackend backend_;
    Water model_ = materials::water<Plane>(3);
    std::vector<Eigen::Vector2d> water_, body_;
    std::vector<double> log_J_;
    Obstacles<AnyShape<>, ActsOn::surface_and_particles> walls_;
};

} // namespace firn::test
