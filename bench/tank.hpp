// SPDX-License-Identifier: MIT
#pragma once

#include "on_each_backend.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/models/fluids/keeps_volume.hpp>
#include <firn/particles/observables.hpp>
#include <firn/smoothed.hpp>

#include <cmath>
#include <cstddef>
#include <vector>

namespace firn::bench
{

using Plane = Space<2, double>;
using Walls = Obstacles<AnyShape<>, ActsOn::surface_and_particles>;
inline constexpr double g = 9.81; ///< [m/s^2]

inline Eigen::Vector3d in_space(Eigen::Vector2d const& v) { return {v.x(), v.y(), 0}; }

/// How a Tank lies and what is in it.
struct TankSetting
{
    double degrees = 0;                                  ///< against the cells
    Eigen::Vector2d offset = Eigen::Vector2d(0.3, 0.21); ///< of the middle of its floor from a node [cells]
    double h = 0.02;                                     ///< of a cell [m]
    double depth = 0.4;                                  ///< of the water [m]
    double fastest = 3;                                  ///< flow [m/s]
    double radius = 0;       ///< of a disk that is held in the middle [m]; 0: none
    double half_width = 0.3; ///< [m]
};

/// Water in the plane in a tank of slipping walls that lies across the cells, at rest at the start.
template <class Model, class Kernel, class Transfer>
class Tank
{
public:
    explicit Tank(TankSetting const& setting)
        : setting_(setting), turn_(setting.degrees * M_PI / 180), origin_(setting.offset * setting.h),
          model_(materials::water<Plane>(setting.fastest)),
          water_(lattice(setting.h), model_, {}, {}, backend())
    {
        auto const [cell, depth, half] = std::array{setting.h, setting.depth, setting.half_width};
        Eigen::Vector2d const middle(0, depth / 2);
        std::vector<Eigen::Vector2d> points;
        std::vector<double> log_J;
        for (double x = -half + cell / 4; x < half; x += cell / 2)
            for (double y = cell / 4; y < depth; y += cell / 2) {
                Eigen::Vector2d const own(x, y);
                if ((own - middle).norm() < setting.radius) continue;
                points.push_back(turn_ * own + origin_);
                log_J.push_back(-std::log1p(model_.exponent * pressure_at(y) / model_.bulk_modulus) /
                                model_.exponent);
            }
        water_.add(points, cell * cell / 4);
        water_.template upload<LogVolumeRatio>(log_J);
        add_wall({0, 1}, {0, 0});
        add_wall({1, 0}, {-half, 0});
        add_wall({-1, 0}, {half, 0});
        if (setting.radius > 0)
            walls_.list.push_back({.shape = Sphere{setting.radius},
                                   .motion = {.position = in_space(turn_ * middle + origin_)},
                                   .on_particles = true});
        rest_ = mean_height();
    }

    /// Advances by a time [s], pushed sidewards by a share of gravity.
    AdvanceReport advance(double duration, double sidewards = 0)
    {
        return water_.advance(duration, Gravity{in_space(turn_ * Eigen::Vector2d(sidewards * g, -g))},
                              walls_);
    }
    /// The frequency of the first standing wave [Hz].
    double frequency() const
    {
        double const k = M_PI / (2 * setting_.half_width);
        return std::sqrt(g * k * std::tanh(k * setting_.depth)) / (2 * M_PI);
    }
    /// How far the level is from its place [% of the depth], without the waves.
    double level() const
    {
        double const waves = speed() * speed() / (2 * g);
        return 100 * (mean_height() - rest_ - waves) / (setting_.depth / 2);
    }
    /// The root mean square [m/s].
    double speed() const
    {
        double sum = 0;
        for (auto const& v : water_.template download<Velocity>()) sum += v.squaredNorm();
        return std::sqrt(sum / double(water_.size()));
    }
    /// The force [N/m] on a wall, or on the disk: along a direction of the tank, as a mean of a call.
    double force(AdvanceReport const& report, std::size_t obstacle, Eigen::Vector2d const& along,
                 double duration) const
    {
        return report.reactions[obstacle].impulse.template head<2>().dot(turn_ * along) / duration;
    }
    double weight() const { return model_.density * g * double(water_.size()) * setting_.h * setting_.h / 4; }
    /// The pressure of the particles that lie within half a cell of the floor, over that of their depth: as
    /// they carry it.
    double raw_pressure_at_floor() const
    {
        return at_floor(water_.template download<Pressure>()) / at_floor(hydrostatic_pressures());
    }
    /// The same of what they carry and of what they should, both smoothed through the grid.
    double pressure_at_floor() const
    {
        return at_floor(smoothed(water_, water_.template download<Pressure>())) /
               at_floor(smoothed(water_, hydrostatic_pressures()));
    }
    /// How many particles are outside.
    int lost() const
    {
        int count = 0;
        for (auto const& x : water_.positions()) {
            Eigen::Vector2d const at = own(x);
            count +=
                at.y() < -0.01 * setting_.h || std::abs(at.x()) > setting_.half_width + 0.01 * setting_.h;
        }
        return count;
    }
    std::size_t size() const { return water_.size(); }
    TankSetting const& setting() const { return setting_; }

private:
    void add_wall(Eigen::Vector2d const& normal, Eigen::Vector2d const& at)
    {
        walls_.list.push_back({.shape = HalfSpace{in_space(turn_ * normal)},
                               .motion = {.position = in_space(turn_ * at + origin_)},
                               .on_particles = true});
    }
    double pressure_at(double y) const { return model_.density * g * (setting_.depth - y); }
    std::vector<double> hydrostatic_pressures() const
    {
        std::vector<double> pressures;
        for (auto const& x : water_.positions()) pressures.push_back(pressure_at(own(x).y()));
        return pressures;
    }
    double at_floor(std::vector<double> const& values) const
    {
        auto const positions = water_.positions();
        double sum = 0;
        for (std::size_t i = 0; i < positions.size(); ++i)
            if (own(positions[i]).y() < setting_.h / 2) sum += values[i];
        return sum;
    }
    Eigen::Vector2d own(Eigen::Vector2d const& x) const { return turn_.inverse() * (x - origin_); }
    double mean_height() const
    {
        double sum = 0;
        for (auto const& x : water_.positions()) sum += own(x).y();
        return sum / double(water_.size());
    }

    TankSetting setting_;
    Eigen::Rotation2Dd turn_;
    Eigen::Vector2d origin_;
    double rest_ = 0;
    Model model_;
    Solver<Backend, Model, Kernel, Transfer> water_;
    Walls walls_;
};

} // namespace firn::bench
