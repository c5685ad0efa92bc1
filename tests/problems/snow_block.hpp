// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <array>
#include <cmath>
#include <vector>

namespace firn::test
{

/// A square block of fresh snow, 0.2 m wide, that is thrown flat on a smooth floor.
///
/// Nothing is known of it exactly: runs are compared with fine ones of the library itself, and with what they
/// must keep, mass and momentum (the floor's included), and must not gain, kinetic energy.
template <class SceneType>
class SnowBlock
{
public:
    using Solver = typename SceneType::Solver;
    using Transfer = typename SceneType::Transfer;
    using Model = typename SceneType::Model;
    static constexpr int pieces = 12;
    static constexpr double side = 0.2, speed = 4, duration = 0.06; ///< [m], [m/s], [s]

    /// `cells` and `per_cell` particles per axis in each of them.
    SnowBlock(int cells, int per_cell = 2, Transfer const& transfer = {}, StepControl const& control = {},
              typename SceneType::Backend const& backend = {})
        : solver(lattice(side / cells), materials::fresh_snow<typename SceneType::Space>(), transfer, control,
                 backend)
    {
        auto const points = box_of_points<2>({0, 0}, {side, side}, side / cells, per_cell);
        solver.add(points, side * side / double(points.size()), {0, -speed});
    }

    AdvanceReport advance(int piece)
    {
        auto report = solver.advance(duration * (piece + 1) / pieces - solver.time(), Gravity{},
                                     Obstacle<HalfSpace>{.contact = Contact::slip()});
        pushed_ += report.reactions[0].impulse.y();
        return report;
    }

    /// Compares the middle of the block with where it is in a fine run, and looks after what it keeps.
    void observe(int piece)
    {
        Totals<Solver> const now(solver);
        heights_[std::size_t(piece)] = now.centre.y();
        squares_ += std::pow((now.centre.y() - fine_run[std::size_t(piece)]) / side, 2) / pieces;
        double const mass = side * side * double(solver.model().density);
        Eigen::Vector2d const expected{0, -(speed + 9.81 * solver.time()) * mass - pushed_};
        momentum_ = std::max(momentum_, (now.momentum - expected).norm() / (mass * speed));
        double const energy = now.kinetic_energy / (0.5 * mass * speed * speed);
        gained_ = std::max(gained_, energy - energy_);
        energy_ = energy;
    }

    /// The root mean square error of the height of the centre of mass over the run, over the side.
    double error() const { return std::sqrt(squares_); }
    std::array<double, pieces> const& heights() const { return heights_; }
    /// The largest error of momentum, of that at the start.
    double momentum_error() const { return momentum_; }
    /// Kinetic energy in the end, of that at the start, and the most that it gained between two looks.
    double kinetic_energy() const { return energy_; }
    double most_gained() const { return gained_; }

    Solver solver;

private:
    /// heights() of 128 cells with cubic kernels and MLS in double precision. Those of 64 differ from it by
    /// 0.0023 of the side at most, in either direction: as the block crumbles, nothing is left to
    /// extrapolate.
    static constexpr std::array<double, pieces> fine_run{0.084412, 0.077901, 0.080338, 0.085303,
                                                         0.090023, 0.094498, 0.098728, 0.102712,
                                                         0.106451, 0.109945, 0.113194, 0.116197};

    std::array<double, pieces> heights_{};
    double squares_ = 0, pushed_ = 0, momentum_ = 0, energy_ = 1, gained_ = 0;
};

} // namespace firn::test
