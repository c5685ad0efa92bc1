// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/space.hpp>

#include <concepts>
#include <cstddef>
#include <iterator>
#include <type_traits>
#include <utility>

// Arrays of a host, which has vectors of its own and none of Eigen's.
namespace firn
{

namespace detail
{
template <class Value>
concept HasCoordinates = requires(Value value)
{
    value.x;
    value.y;
    requires std::same_as<decltype(value.x), decltype(value.y)>;
};

/// The type of the numbers that a value of a host consists of: a number, a struct with x and y, or an array.
template <class Value>
struct NumberIn
{
    using Type = void;
};
template <std::floating_point Value>
struct NumberIn<Value>
{
    using Type = Value;
};
template <HasCoordinates Value>
struct NumberIn<Value>
{
    using Type = decltype(Value::x);
};
template <class Value>
    requires(std::is_aggregate_v<Value> && !HasCoordinates<Value> && requires(Value value) { value[0]; })
struct NumberIn<Value>
{
    using Type = typename NumberIn<std::remove_cvref_t<decltype(std::declval<Value&>()[0])>>::Type;
};

/// Whether the members of a host's struct are the coordinates alone, x first.
template <class Value, int count>
constexpr bool has_coordinates_in_order()
{
    if constexpr (!HasCoordinates<Value>)
        return true;
    else if constexpr (count == 2)
        return offsetof(Value, x) == 0;
    else if constexpr (count == 3 &&
                       requires(Value value) { requires std::same_as<decltype(value.x), decltype(value.z)>; })
        return offsetof(Value, x) == 0 && offsetof(Value, y) < offsetof(Value, z);
    else
        return false;
}
} // namespace detail

/// float or double: what a host's value consists of; void if it is none that Firn can read.
template <class Value>
using NumberIn = typename detail::NumberIn<std::remove_cv_t<Value>>::Type;

/// A value of a host that is `count` floats or doubles in memory, and nothing else: a number, a struct with
/// members x, y and perhaps z, or an array such as float[9] or std::array<double, 3>.
template <class Value, int count>
concept HostValue = std::floating_point<NumberIn<Value>> && std::is_trivially_copyable_v<Value> &&
                        std::is_standard_layout_v<Value> &&
                        sizeof(Value) == std::size_t(count) * sizeof(NumberIn<Value>) &&
                    detail::has_coordinates_in_order<std::remove_cv_t<Value>, count>();

/// An array of such values, for which std::data and std::size are defined: a std::vector or std::span, an
/// array, or one of a host's own with data() and size().
template <class Array, int count>
concept HostArray = requires(Array& array)
{
    {
        std::size(array)
        } -> std::convertible_to<std::size_t>;
    requires HostValue<std::remove_cvref_t<decltype(*std::data(array))>, count>;
};

/// A point of d coordinates: one of Eigen's vectors, or a host's.
template <class Value, int d>
concept PointOf = HostValue<Value, d> || requires
{
    requires int(Value::SizeAtCompileTime) == d;
};

/// A point as one of Eigen's.
template <int d, PointOf<d> Point>
Vector<double, d> point_of(Point const& point)
{
    if constexpr (HostValue<Point, d>) {
        auto const* const first = reinterpret_cast<NumberIn<Point> const*>(&point);
        return make_vector<double, d>([&](int a) { return static_cast<double>(first[a]); });
    }
    else
        return vector_of<double, d>(point);
}

/// Points in an array of a host, which has vectors of its own and none of Eigen's: see points_of().
template <int d, class Number>
class HostPoints
{
public:
    /// Reads one point after the other.
    class Iterator
    {
    public:
        using iterator_category = std::input_iterator_tag;
        using value_type = Vector<double, d>;
        using difference_type = std::ptrdiff_t;
        using pointer = void;
        using reference = value_type;

        Iterator(Number const* first, std::size_t stride, std::size_t index)
            : first_(first), stride_(stride), index_(index)
        {}
        value_type operator*() const
        {
            value_type point;
            for (int a = 0; a < d; ++a)
                point[a] = static_cast<double>(first_[index_ * stride_ + std::size_t(a)]);
            return point;
        }
        Iterator& operator++()
        {
            ++index_;
            return *this;
        }
        bool operator==(Iterator const& other) const { return index_ == other.index_; }

    private:
        Number const* first_;
        std::size_t stride_, index_;
    };

    HostPoints(Number const* first, std::size_t count, std::size_t stride)
        : first_(first), count_(count), stride_(stride)
    {}
    Iterator begin() const { return {first_, stride_, 0}; }
    Iterator end() const { return {first_, stride_, count_}; }
    std::size_t size() const { return count_; }

private:
    Number const* first_;
    std::size_t count_, stride_;
};

/// `count` points in an array of a host as the range that Solver::add takes: coordinate a of the i-th is
/// `first[i * stride + a]` [m]. The array must live until the call is over.
///
///     solver.add(points_of<3>(&particles[0].x, particles.size(), sizeof(Particle) / sizeof(float)), volume);
///
/// Throws an Error if points overlap, or if there are points and no array.
template <int d, class Number>
HostPoints<d, Number> points_of(Number const* first, std::size_t count, std::size_t stride = d)
{
    static_assert(d == 2 || d == 3, "there are scenes in 2 and in 3 dimensions");
    require(first != nullptr || count == 0, "there is no array of points", "points_of",
            "Pass a pointer to the first coordinate of the first point.");
    require(stride >= std::size_t(d), "the points overlap", "points_of",
            "Pass a stride, in numbers, of as many as there are dimensions, or more.");
    return {first, count, stride};
}

} // namespace firn
