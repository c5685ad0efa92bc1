// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"
#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/smoothed.hpp>

#include <cmath>
#include <cstddef>
#include <vector>

namespace firn::test
{

using AtSurface = Obstacles<AnyShape<>, ActsOn::surface>;

inline constexpr double g = 9.81; ///< [m/s^2]

inline Eigen::Vector3d in_space(Eigen::Vector2d const& v) { return {v.x(), v.y(), 0}; }

/// A frame of reference that lies somehow across the cells.
struct Frame
{
    double angle;           ///< against the axes [radians]
    Eigen::Vector2d origin; ///< [m]

    Eigen::Vector2d direction(Eigen::Vector2d const& v) const { return Eigen::Rotation2Dd(angle) * v; }
    Eigen::Vector2d place(Eigen::Vector2d const& x) const { return direction(x) + origin; }
    Eigen::Vector2d own(Eigen::Vector2d const& x) const
    {
        return Eigen::Rotation2Dd(-angle) * Eigen::Vector2d(x - origin);
    }
};

/// Water at rest in a tank of slipping walls, 0.6 m wide and 0.4 m deep, that lies across the cells.
template <class Model>
class Tank
{
public:
    using Solver = firn::Solver<TestedBackend, Model, QuadraticBSpline, Mls>;
    static_assert(Model::Space::dimension == 2);
    static constexpr double h = 0.02, width = 0.6, depth = 0.4;

    /// With a disk whose centre lies at this height, if it has a radius [m].
    explicit Tank(Frame const& frame, double radius = 0, double fastest = 2, double height = depth / 2)
        : frame_(frame), model_(materials::water<typename Model::Space>(fastest)), water(lattice(h), model_)
    {
        Eigen::Vector2d const centre(0, height);
        std::vector<Eigen::Vector2d> points;
        std::vector<double> log_J;
        for (auto const& x : box_of_points<2>({-width / 2, 0}, {width / 2, depth}, h)) {
            if ((x - centre).norm() < radius) continue;
            points.push_back(frame.place(x));
            double const pressure = model_.density * g * (depth - x.y());
            log_J.push_back(-std::log1p(model_.exponent * pressure / model_.bulk_modulus) / model_.exponent);
        }
        water.add(points, h * h / 4);
        water.template upload<LogVolumeRatio>(log_J);
        add_wall({0, 1}, {0, 0});
        add_wall({1, 0}, {-width / 2, 0});
        add_wall({-1, 0}, {width / 2, 0});
        if (radius > 0)
            walls.list.push_back(
                {.shape = Sphere{radius}, .motion = {.position = in_space(frame.place(centre))}});
    }

    AdvanceReport advance(double duration) { return water.advance(duration, Gravity{pull()}, walls); }
    Eigen::Vector3d pull() const { return in_space(frame_.direction({0, -g})); }
    /// The force [N/m] in a direction of the frame on an obstacle.
    double force(AdvanceReport const& report, std::size_t obstacle, Eigen::Vector2d const& along,
                 double duration) const
    {
        return report.reactions[obstacle].impulse.head<2>().dot(frame_.direction(along)) / duration;
    }
    double mean_height() const
    {
        double sum = 0;
        for (auto const& x : water.positions()) sum += frame_.own(x).y();
        return sum / double(water.size());
    }
    double rms_speed() const
    {
        double sum = 0;
        for (auto const& v : water.template download<Velocity>()) sum += v.squaredNorm();
        return std::sqrt(sum / double(water.size()));
    }
    /// The pressure of the particles that lie within half a cell of the floor, over that of their depth; both
    /// smoothed.
    double pressure_at_floor() const
    {
        std::vector<double> expected;
        for (auto const& x : water.positions())
            expected.push_back(model_.density * g * (depth - frame_.own(x).y()));
        auto const pressures = smoothed(water, water.template download<Pressure>());
        expected = smoothed(water, expected);
        auto const positions = water.positions();
        double sum = 0, sum_expected = 0;
        for (std::size_t i = 0; i < positions.size(); ++i)
            if (frame_.own(positions[i]).y() < h / 2) sum += pressures[i], sum_expected += expected[i];
        return sum / sum_expected;
    }
    double weight() const { return model_.density * g * double(water.size()) * h * h / 4; }

private:
    void add_wall(Eigen::Vector2d const& normal, Eigen::Vector2d const& at)
    {
        walls.list.push_back({.shape = HalfSpace{in_space(frame_.direction(normal))},
                              .motion = {.position = in_space(frame_.place(at))}});
    }

    Frame frame_;
    Model model_;

public:
    Solver water;
    AtSurface walls;
};

/// Whether water that has had this time [s] to come to rest is at rest, at the height and with the forces of
/// hydrostatics.
template <class Model>
void check_rest(Tank<Model>& tank, double settles)
{
    using Still = Tank<Model>;
    tank.advance(settles);
    double const duration = 0.5;
    auto const report = tank.advance(duration);
    double const of_side = 0.5 * 1000 * g * Still::depth * Still::depth;
    CHECK(tank.rms_speed() < 0.01 * std::sqrt(g * Still::depth));
    CHECK(std::abs(tank.mean_height() - Still::depth / 2) < 0.01 * Still::depth / 2);
    CHECK(std::abs(tank.force(report, 0, {0, -1}, duration) / tank.weight() - 1) < 0.01);
    CHECK(std::abs(tank.force(report, 1, {-1, 0}, duration) / of_side - 1) < 0.01);
    CHECK(std::abs(tank.force(report, 2, {1, 0}, duration) / of_side - 1) < 0.01);
}

} // namespace firn::test
