// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <firn/effects/obstacles.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/models/response.hpp>

#include <cmath>
#include <type_traits>
#include <vector>

namespace firn::test
{

/// Water in a tank of slipping walls, 0.6 m wide and 0.4 m deep before its weight compresses it, that begins
/// at rest.
///
/// Particles at a height Y of the uncompressed water bear the pressure p = rho_0 g (H - Y). By Tait's law
/// their volume ratio is J = (1 + gamma p / K)^(-1 / gamma), and their height at rest the integral of J up to
/// Y. Obstacles act at their surface where the water keeps its volume, which needs that, and else on nodes.
template <class SceneType>
class WaterTank
{
public:
    using Solver = typename SceneType::Solver;
    using Transfer = typename SceneType::Transfer;
    using Walls = std::conditional_t<KeepsItsVolume<typename SceneType::Model>,
                                     Obstacles<AnyShape<>, ActsOn::surface>, Obstacles<>>;
    static constexpr double width = 0.6, depth = 0.4, gravity = 9.81; ///< [m], [m], [m/s^2]

    /// Turned by `degrees` against the cells. A disk of a `radius` [m], if above 0, displaces water around
    /// the middle of its surface.
    WaterTank(double degrees, double cell_size, int per_cell, double radius, Transfer const& transfer,
              StepControl const& control, typename SceneType::Backend const& backend)
        : solver(lattice(cell_size), materials::water<typename SceneType::Space>(2), transfer, control,
                 backend),
          turn_(degrees * M_PI / 180), origin_(Eigen::Vector2d(0.3, 0.21) * cell_size)
    {
        using Number = typename SceneType::Number;
        std::vector<Eigen::Vector2d> points;
        std::vector<Number> log_J;
        for (auto const& Y : box_of_points<2>({-width / 2, 0}, {width / 2, depth}, cell_size, per_cell)) {
            Eigen::Vector2d const y(Y.x(), at_rest(Y.y()));
            if ((y - Eigen::Vector2d(0, level())).norm() < radius) continue;
            points.push_back(place(y));
            log_J.push_back(Number(-std::log(power(Y.y())) / gamma()));
        }
        solver.add(points, std::pow(cell_size / per_cell, 2));
        solver.template upload<LogVolumeRatio>(log_J);
        add_wall({0, 1}, {0, 0});
        add_wall({1, 0}, {-width / 2, 0});
        add_wall({-1, 0}, {width / 2, 0});
    }

    Solver solver;

protected:
    AdvanceReport advance_by(double duration) { return solver.advance(duration, Gravity{pull()}, walls_); }

    /// Of its surface at rest above its floor [m].
    double level() const { return at_rest(depth); }
    Eigen::Vector3d pull() const { return direction({0, -gravity}); }
    /// Where a point of the tank is, whose origin is the middle of its floor.
    Eigen::Vector2d place(Eigen::Vector2d const& own) const { return turn_ * own + origin_; }
    double height(Eigen::Vector2d const& x) const { return (turn_.inverse() * (x - origin_)).y(); }
    Eigen::Vector3d in_space(Eigen::Vector2d const& x) const { return {x.x(), x.y(), 0}; }

    Walls walls_;

private:
    double gamma() const { return double(solver.model().exponent); }
    /// rho_0 g / K [1/m].
    double softness() const
    {
        return double(solver.model().density) * gravity / double(solver.model().bulk_modulus);
    }
    /// 1 + gamma p / K at a height of the uncompressed water.
    double power(double Y) const { return 1 + gamma() * softness() * (depth - Y); }
    /// Where that height is at rest.
    double at_rest(double Y) const
    {
        double const exponent = 1 - 1 / gamma();
        return (std::pow(power(0), exponent) - std::pow(power(Y), exponent)) /
               (gamma() * exponent * softness());
    }
    Eigen::Vector3d direction(Eigen::Vector2d const& own) const { return in_space(turn_ * own); }
    void add_wall(Eigen::Vector2d const& normal, Eigen::Vector2d const& at)
    {
        walls_.list.push_back(
            {.shape = HalfSpace{direction(normal)}, .motion = {.position = in_space(place(at))}});
    }

    Eigen::Rotation2Dd turn_;
    Eigen::Vector2d origin_;
};

/// Water at rest for two seconds, in a tank that is tilted by 17 degrees against the cells.
template <class SceneType>
class StillWater : public WaterTank<SceneType>
{
    using Tank = WaterTank<SceneType>;

public:
    static constexpr int pieces = 8;
    static constexpr double duration = 2; ///< [s]

    /// `cells` per depth of the water, `per_cell` particles per cell and axis.
    StillWater(int cells, int per_cell = 2, typename Tank::Transfer const& transfer = {},
               StepControl const& control = {}, typename SceneType::Backend const& backend = {})
        : Tank(17, Tank::depth / cells, per_cell, 0, transfer, control, backend)
    {}

    AdvanceReport advance(int) { return this->advance_by(duration / pieces); }

    /// Looks in the second half of the time: at first there is sound, since particles lie across the cells.
    void observe(int piece)
    {
        if (2 * piece < pieces) return;
        auto const& water = this->solver;
        for (auto const& v : water.template download<Velocity>())
            squares_ += 2.0 / pieces * v.template cast<double>().squaredNorm() / double(water.size());
    }

    /// The root mean square speed over sqrt(g H). The level in its place would grow with the time that passes
    /// until it is looked at, and a setting would seem exact where it goes through 0.
    double error() const { return std::sqrt(squares_ / (Tank::gravity * Tank::depth)); }

private:
    double squares_ = 0;
};

/// A disk of half the water's density, 0.16 m across, in an upright tank for a second: half of it is under
/// water, so that its centre lies at the level of the water.
template <class SceneType>
class HalfImmersedDisk : public WaterTank<SceneType>
{
    using Tank = WaterTank<SceneType>;

public:
    static constexpr int pieces = 500;
    static constexpr double duration = 1, radius = 0.08; ///< [s], [m]

    /// `cells` per diameter, `per_cell` particles per cell and axis.
    HalfImmersedDisk(int cells, int per_cell = 2, typename Tank::Transfer const& transfer = {},
                     StepControl const& control = {}, typename SceneType::Backend const& backend = {})
        : Tank(0, 2 * radius / cells, per_cell, radius, transfer, control, backend)
    {
        Eigen::Vector3d const centre = this->in_space(this->place({0, this->level()}));
        this->walls_.list.push_back({.shape = Sphere{radius}, .motion = {.position = centre}});
        double const mass = 0.5 * double(this->solver.model().density) * M_PI * radius * radius,
                     flat = mass * radius * radius / 4;
        start_ = {.mass = mass, .motion = {.position = centre}};
        for (int a = 0; a < 3; ++a) start_.inertia(a, a) = a == 2 ? 2 * flat : flat;
        disk_ = start_;
    }

    /// The first piece begins anew with the disk where it was at the start.
    AdvanceReport advance(int piece)
    {
        if (piece == 0) disk_ = start_;
        this->walls_.list.back().motion = disk_.motion;
        double const of_piece = duration / pieces;
        auto report = this->advance_by(of_piece);
        disk_.advance(report.reactions.back(), of_piece, this->pull());
        return report;
    }

    /// Looks in the second half of the time, in which it bobs once.
    void observe(int piece)
    {
        if (2 * piece < pieces) return;
        double const height = this->height(disk_.motion.position.template head<2>());
        off_ += 2.0 / pieces * (height - this->level()) / (2 * radius);
    }

    /// How far its centre is from its place on average, over its diameter.
    double error() const { return std::abs(off_); }

private:
    RigidBody disk_, start_;
    double off_ = 0;
};

} // namespace firn::test
