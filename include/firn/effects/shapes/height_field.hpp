// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/effects/shapes/samples_on.hpp>
#include <firn/effects/shapes/shape.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace firn
{

/// The heights of a HeightField in the memory of a host or a device: a plain value to pass to a loop.
template <std::floating_point Real, int d>
struct HeightFieldView
{
    static constexpr int across = d - 1; ///< axes of the ground: x, or x and z
    static constexpr bool is_sampled = true;

    std::array<Real, std::size_t(across)> origin; ///< the first sample's place on the ground [m]
    Real spacing;                                 ///< of the samples [m]
    std::array<int, std::size_t(across)> count;   ///< of samples along each axis of the ground
    Real const* values;                           ///< height of each sample [m], x fastest

    /// An estimate of the signed distance, and the outward normal, at `x` [m].
    ///
    /// (y - H) / sqrt(1 + |grad H|²) with H the height below or above x: exact in sign, exact for a plane,
    /// and else off by (distance² × curvature) / 2 to first order. The normal is that of the terrain at the
    /// same place on the ground, so it is continuous.
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const
    {
        Vector<Real, across> slope;
        Real const above = x[1] - height(x, slope);
        Real const shrink = 1 / std::sqrt(1 + slope.squaredNorm());
        SurfaceSample<Real, d> sample{above * shrink, Vector<Real, d>::Zero()};
        for (int i = 0; i < across; ++i) sample.normal[axis(i)] = -slope[i] * shrink;
        sample.normal[1] = shrink;
        return sample;
    }

    /// Along a unit vector in the body's frame: see AlongAxis. Along the ground it goes on from image to
    /// image.
    static AlongAxis along(Eigen::Vector3d const& axis)
    {
        constexpr double infinity = std::numeric_limits<double>::infinity();
        bool const is_level = std::abs(axis.y()) < 1e-6;
        return {is_level ? -infinity : infinity, is_level};
    }

    /// The height [m] of the terrain below or above `x`, and its slope.
    ///
    /// Cubic Hermite pieces through the samples whose slopes are central differences (Catmull & Rom 1974, *A
    /// class of local interpolating splines*), as a product over the axes: the slope is continuous, error
    /// O(spacing³). At the border the neighbour that is missing is extrapolated linearly; beyond it the
    /// terrain goes on level.
    FIRN_HOST_DEVICE Real height(Vector<Real, d> const& x, Vector<Real, across>& slope) const
    {
        Real weight[std::size_t(across)][4], change[std::size_t(across)][4];
        int first[std::size_t(across)];
        for (int i = 0; i < across; ++i) {
            Real const last = Real(count[std::size_t(i)] - 1);
            Real u = (x[axis(i)] - origin[std::size_t(i)]) / spacing;
            if constexpr (finite_math_only) u = is_number(u) ? u : Real(-1); // comparisons may let NaN pass
            bool const within = u >= 0 && u <= last;                         // false for NaN
            Real const kept = within ? u : (u > last ? last : Real(0));
            int const cell = int(kept) < count[std::size_t(i)] - 2 ? int(kept) : count[std::size_t(i)] - 2;
            spline(kept - Real(cell), weight[i], change[i]);
            if (!within)
                for (Real& c : change[i]) c = 0;
            extrapolate(cell, i, weight[i]);
            extrapolate(cell, i, change[i]);
            first[i] = cell - 1;
        }
        Real sum = 0;
        slope.setZero();
        FIRN_ROLLED_ON_DEVICE
        for (int k = 0; k < (across == 2 ? 4 : 1); ++k) {
            Real row = 0, row_change = 0;
            Real const* const samples =
                across == 2
                    ? values + std::ptrdiff_t(kept_within(first[across - 1] + k, across - 1)) * count[0]
                    : values;
            for (int j = 0; j < 4; ++j) {
                Real const value = samples[kept_within(first[0] + j, 0)];
                row += weight[0][j] * value;
                row_change += change[0][j] * value;
            }
            Real const w = across == 2 ? weight[across - 1][k] : Real(1);
            sum += w * row;
            slope[0] += w * row_change / spacing;
            if constexpr (across == 2) slope[1] += change[1][k] * row / spacing;
        }
        return sum;
    }

private:
    FIRN_HOST_DEVICE static constexpr int axis(int i) { return 2 * i; } ///< of the world: x, then z

    /// The nearest index that exists; a sample beyond the border has the weight 0.
    FIRN_HOST_DEVICE int kept_within(int at, int i) const
    {
        return at < 0 ? 0 : (at < count[std::size_t(i)] ? at : count[std::size_t(i)] - 1);
    }

    /// Moves the weight of a sample beyond the border to the two next to it, as if it were in line with them.
    FIRN_HOST_DEVICE void extrapolate(int cell, int i, Real (&w)[4]) const
    {
        if (cell == 0) w[1] += 2 * w[0], w[2] -= w[0], w[0] = 0;
        if (cell == count[std::size_t(i)] - 2) w[2] += 2 * w[3], w[1] -= w[3], w[3] = 0;
    }

    /// Weights of the samples -1, 0, 1, 2 at `t` between the samples 0 and 1, and their derivatives.
    FIRN_HOST_DEVICE static void spline(Real t, Real (&w)[4], Real (&dw)[4])
    {
        Real const half = Real(0.5);
        w[0] = half * t * (t * (2 - t) - 1);
        w[1] = half * (t * t * (3 * t - 5) + 2);
        w[2] = half * t * (t * (4 - 3 * t) + 1);
        w[3] = half * t * t * (t - 1);
        dw[0] = half * (t * (4 - 3 * t) - 1);
        dw[1] = half * t * (9 * t - 10);
        dw[2] = half * (t * (8 - 9 * t) + 1);
        dw[3] = half * t * (3 * t - 2);
    }
};

/// A terrain: all points below heights [m] given on a regular grid over the ground, y up. A Shape. Cheap to
/// copy.
///
/// The ground is the x axis in two dimensions, x and z in three. `Real` is a number, not a pack of them. The
/// terrain is solid all the way down, so nothing can pass through it. Features smaller than a cell of the
/// simulation have no effect.
template <std::floating_point Real, int d>
    requires(d == 2 || d == 3)
class HeightField
{
public:
    using View = HeightFieldView<Real, d>;
    static constexpr int across = View::across;

    /// Takes `count` heights along each axis of the ground, x fastest, the first at `origin` [m], `spacing`
    /// [m] apart.
    ///
    /// Throws firn::Error: spacing not above 0, fewer than 2 samples along an axis, a number of heights that
    /// does not fit, a height or an origin that is not finite, a terrain so far from its origin that its
    /// samples are lost to rounding, heights beyond 1e15 m or as many spacings.
    HeightField(std::array<Real, std::size_t(across)> const& origin, Real spacing,
                std::array<int, std::size_t(across)> const& count, std::vector<Real> heights)
        : view_{origin, spacing, count, nullptr}
    {
        char const* const where = "HeightField";
        auto const is_finite = [](Real x) { return firn::is_finite(x); };
        require(is_finite(spacing) && spacing > 0 && std::ranges::all_of(origin, is_finite),
                "the spacing of the heights is not above 0, or their origin is not finite", where,
                "Pass lengths in metres.");
        std::size_t samples = 1;
        for (int n : count) samples *= n >= 2 ? std::size_t(n) : 0;
        require(samples > 0, "there is an axis of fewer than 2 heights", where,
                "Pass more samples; a level floor is a HalfSpace.");
        require(heights.size() == samples, "the number of heights is not that of the samples", where,
                "Pass one height for each sample, x fastest.");
        require(std::ranges::all_of(heights, is_finite), "a height is not finite", where,
                "Pass a height [m] for each sample.");
        require(detail::tells_cells_apart<Real, across>(origin, spacing, count),
                "the terrain lies so far from its frame's origin that its samples are lost to rounding",
                where, "Give it in coordinates about a point of it, and place it by the obstacle's motion.");
        // so interpolated heights, slopes and their squares do not overflow
        Real const largest = Real(largest_length) * std::min(spacing, Real(1));
        require(std::ranges::all_of(heights, [&](Real y) { return std::abs(y) <= largest; }),
                "a height is out of range, or the terrain is too steep to tell up from down", where,
                "Pass heights and their spacing in metres.");
        heights_ = std::make_shared<std::vector<Real> const>(std::move(heights));
        view_.values = heights_->data();
    }

    /// Signed distance and outward normal at `x` [m]; see HeightFieldView::surface.
    SurfaceSample<Real, d> surface(Vector<Real, d> const& x) const { return view_.surface(x); }

    /// A view of its heights, valid while the field or a copy of it lives.
    View view() const { return view_; }
    static constexpr bool in_host_memory = true; ///< where a backend for devices cannot reach them

    /// The same with its heights in memory that the backend's loops can read.
    template <class Backend>
    SamplesOn<Backend, View> on(Backend const& backend) const
    {
        return {view_, *heights_, backend};
    }

private:
    View view_;
    std::shared_ptr<std::vector<Real> const> heights_;
};

} // namespace firn
