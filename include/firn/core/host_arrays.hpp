// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/space.hpp>

#include <cstddef>
#include <iterator>

namespace firn
{

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
