// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <cmath>
#include <vector>

namespace firn::test
{

/// A column of height 1 m and two cells' width that comes to rest under its own weight between slippery
/// walls.
///
/// Whatever the law, the first Piola-Kirchhoff stress is then -rho_0 g (H - Y), Y being the height at rest.
template <class SceneType>
class Column
{
public:
    using Solver = typename SceneType::Solver;
    using Model = typename SceneType::Model;
    using Transfer = typename SceneType::Transfer;
    static constexpr int pieces = 1;

    /// `cells` per metre, `per_cell` particles per cell and axis.
    Column(int cells, int per_cell = 2, Transfer const& transfer = {}, StepControl const& control = {},
           typename SceneType::Backend const& backend = {})
        : solver(lattice(1.0 / cells), material(), transfer, control, backend),
          points_(box_of_points<2>({0, 0}, {2.0 / cells, 1}, 1.0 / cells, per_cell))
    {
        solver.add(points_, 2.0 / cells / double(points_.size()));
    }

    /// Twelve periods of its slowest vibration, damped, until it is at rest; of implicit steps one solve,
    /// whose passes over the particles count as steps.
    AdvanceReport advance(int)
    {
        ReflectingWall const left{.axis = 0}, right{.axis = 0, .node = 2, .side = -1}, floor{.axis = 1};
        if constexpr (SceneType::is_implicit) {
            AdvanceReport report;
            report.substeps = std::uint64_t(solver.settle(Gravity{}, left, right, floor).solve.passes);
            return report;
        }
        else
            return damped(left, right, floor);
    }

    /// Compares stresses with those of equilibrium, and finds how far the top has sunk.
    void observe(int)
    {
        auto const x = solver.positions();
        auto const H = solver.template download<DisplacementGradient>();
        double squares = 0, highest = 0;
        for (std::size_t i = 0; i < points_.size(); ++i) {
            auto particle = Record<double, 2, typename Model::State>::at_rest();
            particle[DisplacementGradient{}] = H[i].template cast<double>();
            Matrix<double, 2> const still = Matrix<double, 2>::Zero();
            Matrix<double, 2> const tau =
                solver.model().template respond<double>(particle, still, 0.0).kirchhoff_stress;
            double const H_yy = H[i](1, 1), Y = points_[i].y();
            double const found = tau(1, 1) / (1 + H_yy), exact = -density * gravity * (1 - Y);
            squares += (found - exact) * (found - exact);
            if (Y <= highest) continue;
            highest = Y;
            tip_ = x[i].y() - Y + H_yy * (1 - Y);
        }
        error_ = std::sqrt(squares / double(points_.size())) / (density * gravity);
    }

    /// The root mean square error of the stress, over that at the foot.
    double error() const { return error_; }
    /// The displacement of the top [m].
    double tip() const { return tip_; }

    Solver solver;

private:
    AdvanceReport damped(ReflectingWall const& left, ReflectingWall const& right, ReflectingWall const& floor)
    {
        double const period = 4 / std::sqrt(double(solver.model().elasticity.p_wave_modulus()) / density);
        return solver.advance(12 * period, Gravity{}, Damping{1.4 * 6.283185307179586 / period}, left, right,
                              floor);
    }

    static constexpr double density = 1000, gravity = 9.81; ///< [kg/m^3], [m/s^2]

    static Model material()
    {
        Model column;
        column.density = density;
        column.elasticity = lame<typename SceneType::Number>(1e5, 0.3);
        return column;
    }

    std::vector<Eigen::Vector2d> points_;
    double error_ = 0, tip_ = 0;
};

} // namespace firn::test
