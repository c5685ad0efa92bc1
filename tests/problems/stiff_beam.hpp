// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <cmath>
#include <vector>

namespace firn::test
{

/// A stiff beam, 1 m long and a tenth of that thick, that is clamped at one end and comes to rest under its
/// weight: rho b g L^3 / EI = 1. In explicit steps it is damped for two periods of its slowest vibration.
///
/// With shear and stretch (Reissner 1972) its end sinks by 0.12446 m.
template <class SceneType>
class StiffBeam
{
public:
    using Solver = typename SceneType::Solver;
    using Transfer = typename SceneType::Transfer;
    static constexpr int pieces = 1;

    /// `cells` per thickness, `per_cell` particles per cell and axis.
    StiffBeam(int cells, int per_cell = 2, Transfer const& transfer = {}, StepControl const& control = {},
              typename SceneType::Backend const& backend = {})
        : h_(thickness / cells), solver(lattice(h_), material(), transfer, control, backend),
          points_(box_of_points<2>({-4 * h_, -thickness / 2}, {1, thickness / 2}, h_, per_cell)),
          spacing_(h_ / per_cell)
    {
        solver.add(points_, spacing_ * spacing_);
    }

    AdvanceReport advance(int)
    {
        Gravity const weight{{0, -young * thickness * thickness / (12 * density), 0}};
        Obstacle<HalfSpace> const clamp{.shape = {{1, 0, 0}}, .contact = Contact::sticky()};
        if constexpr (SceneType::is_implicit) {
            AdvanceReport report;
            report.substeps = std::uint64_t(solver.settle(weight, clamp).solve.passes);
            return report;
        }
        else {
            double const slowest = 3.516 * thickness * std::sqrt(young / (12 * density)); // [rad/s]
            return solver.advance(2 * 6.283185307179586 / slowest, weight, Damping{2 * slowest}, clamp);
        }
    }

    void observe(int)
    {
        auto const x = solver.positions();
        auto const H = solver.template download<DisplacementGradient>();
        double sum = 0;
        int count = 0;
        for (std::size_t i = 0; i < points_.size(); ++i)
            if (std::abs(points_[i].y()) < spacing_ && points_[i].x() > 1 - spacing_) {
                sum += points_[i].y() - x[i].y() - double(H[i](1, 0)) * (1 - points_[i].x());
                ++count;
            }
        sinks_ = sum / count;
    }

    /// Of the sinking of its end.
    double error() const { return std::abs(sinks_ / 0.12446 - 1); }

private:
    static constexpr double thickness = 0.1, young = 1e9, density = 1000; ///< [m], [Pa], [kg/m^3]

    static typename SceneType::Model material()
    {
        typename SceneType::Model beam;
        beam.density = density;
        beam.elasticity = lame<typename SceneType::Number>(young, 0);
        return beam;
    }

    double h_;

public:
    Solver solver;

private:
    std::vector<Eigen::Vector2d> points_;
    double spacing_, sinks_ = 0;
};

} // namespace firn::test
