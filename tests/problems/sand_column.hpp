// SPDX-License-Identifier: MIT
#pragma once

#include "support/policies.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace firn::test
{

/// The coordinate along x that a share of the particles has not passed.
template <class Points>
double front(Points const& points, double share = 0.995)
{
    std::vector<double> x;
    for (auto const& point : points) x.push_back(point[0]);
    std::sort(x.begin(), x.end());
    return x[static_cast<std::size_t>(share * double(x.size()))];
}

/// The right half of a column of sand of a half width of 0.1 m that collapses on a rough floor (after Lube et
/// al. 2005).
template <class SceneType>
class SandColumn
{
public:
    using Solver = typename SceneType::Solver;
    using Transfer = typename SceneType::Transfer;
    static constexpr int pieces = 1;
    static constexpr double half_width = 0.1; ///< L0 [m]

    /// `cells` and `per_cell` particles per axis in each of them; `aspect`: the height over the half width.
    SandColumn(int cells_per_half_width, int per_cell = 2, Transfer const& transfer = {},
               StepControl const& control = {}, typename SceneType::Backend const& backend = {},
               double aspect = 1)
        : solver(lattice(half_width / cells_per_half_width), material(), transfer, control, backend),
          aspect_(aspect)
    {
        auto const points = box_of_points<2>({0, 0}, {half_width, aspect * half_width},
                                             half_width / cells_per_half_width, per_cell);
        solver.add(points, aspect * half_width * half_width / double(points.size()));
    }

    /// Until it lies.
    AdvanceReport advance(int) { return advance_by(8 * std::sqrt(aspect_ * half_width / 9.81)); }

    /// For some time more [s].
    AdvanceReport advance_by(double duration)
    {
        return solver.advance(duration, Gravity{}, Obstacle<HalfSpace>{.contact = Contact::sticky()},
                              Obstacle<HalfSpace>{.shape = {{1, 0, 0}}, .contact = Contact::slip()});
    }

    /// Compares the centre of mass with that of a fine run; for a column as high as half its width.
    void observe(int)
    {
        Eigen::Vector2d const fine{fine_run[0], fine_run[1]},
            start = Eigen::Vector2d::Constant(half_width / 2);
        error_ = (centre() - fine).norm() / (start - fine).norm();
    }

    /// How far the centre of mass is from that of the fine run, over the way it has gone there.
    double error() const { return error_; }

    Eigen::Vector2d centre() const
    {
        Eigen::Vector2d sum = Eigen::Vector2d::Zero();
        for (auto const& x : solver.positions()) sum += x / double(solver.size());
        return sum;
    }

    /// By how much the front has gone out, over the half width.
    double run_out() const { return front(solver.positions()) / half_width - 1; }

    Solver solver;

private:
    static typename SceneType::Model material()
    {
        auto sand = materials::dry_sand<typename SceneType::Space>();
        sand.cone = friction_cone(3, 30 * M_PI / 180); // in the plane it stands at 27.5 degrees
        return sand;
    }

    /// centre() of 64 and 32 cells with cubic kernels and MLS in double precision, extrapolated to cells of
    /// no size. That of 32 and 16 differs from it by 0.013 of the way, that of 128 and 64 by 0.019.
    static constexpr double fine_run[2]{0.088074, 0.025364};

    double aspect_, error_ = 0;
};

} // namespace firn::test
