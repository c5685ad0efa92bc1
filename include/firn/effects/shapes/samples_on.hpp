// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>
#include <memory>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

namespace detail
{
/// Whether the precision tells the samples of a regular grid apart, down to a sixteenth of their spacing.
template <std::floating_point Real, int axes, class Origin, class Count>
bool tells_cells_apart(Origin const& origin, Real spacing, Count const& count)
{
    double largest = 0; // coordinate [m]
    for (int a = 0; a < axes; ++a) {
        double const first = double(origin[std::size_t(a)]),
                     last = first + double(spacing) * (double(count[std::size_t(a)]) - 1);
        largest = std::fmax(largest, std::fmax(std::abs(first), std::abs(last)));
    }
    return largest * double(std::numeric_limits<Real>::epsilon()) <= double(spacing) / 16;
}
} // namespace detail

namespace detail
{
/// Where a point lies among the samples of a regular grid: its cell, or that of the grid's nearest point.
template <std::floating_point Real, int d>
struct CellOfSamples
{
    std::ptrdiff_t first = 0;            ///< the number of the cell's first sample, x fastest
    std::ptrdiff_t stride = 1;           ///< after all axes: how many samples there are
    std::ptrdiff_t step[std::size_t(d)]; ///< between neighbours along an axis
    Real within[std::size_t(d)];         ///< the share of the cell before the point
    Vector<Real, d> nearest;             ///< the point, or the nearest one in the grid's box [m]

    FIRN_HOST_DEVICE CellOfSamples(Vector<Real, d> const& x, Vector<Real, d> const& origin, Real cell_size,
                                   Eigen::Array<int, d, 1> const& nodes)
    {
        for (int i = 0; i < d; ++i) {
            Real const last = Real(nodes[i] - 1);
            Real u = (x[i] - origin[i]) / cell_size;
            if constexpr (finite_math_only) u = is_number(u) ? u : Real(-1); // comparisons may let NaN pass
            bool const inside = u >= 0 && u <= last;
            u = u > 0 ? (u < last ? u : last) : Real(0); // 0 for NaN
            nearest[i] = inside ? x[i] : origin[i] + u * cell_size;
            int const cell = int(u) < nodes[i] - 2 ? int(u) : nodes[i] - 2;
            within[i] = u - Real(cell);
            first += cell * stride;
            step[i] = stride;
            stride *= nodes[i];
        }
    }

    /// The number of the sample at a corner of the cell, which has a bit for each axis.
    FIRN_HOST_DEVICE std::ptrdiff_t at(int corner) const
    {
        std::ptrdiff_t sample = first;
        for (int i = 0; i < d; ++i)
            if (corner >> i & 1) sample += step[i];
        return sample;
    }
};
} // namespace detail

/// A shape given by samples in a backend's memory: a Shape for that backend's loops. Cheap to copy.
///
/// `View` is a plain value with a pointer `values` to the samples.
template <class Backend, class View>
class SamplesOn
{
    using Number = std::remove_cvref_t<decltype(*std::declval<View>().values)>;
    using Values = typename Backend::template Array<Number>;

public:
    SamplesOn(View view, std::vector<Number> const& values, Backend const& backend)
        : view_(view), values_(std::make_shared<Values>(backend))
    {
        values_->resize(values.size());
        values_->upload(0, values);
        view_.values = values_->data();
    }

    /// A view of its samples, valid while the shape or a copy of it lives.
    View view() const { return view_; }
    /// Distance of its farthest point from the reference point [m]; an unbounded shape has no reach.
    double reach() const requires requires(View const v) { v.reach(); }
    {
        return view_.reach();
    }
    /// A bound on the speed of its surface [m/s], of a shape that changes its form.
    double largest_speed() const requires requires(View const v) { v.largest_speed(); }
    {
        return view_.largest_speed();
    }
    static constexpr bool is_deforming = requires { requires View::is_deforming; };

private:
    View view_;
    std::shared_ptr<Values> values_;
};

} // namespace firn
