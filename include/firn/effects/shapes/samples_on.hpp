// SPDX-License-Identifier: MIT
#pragma once

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
