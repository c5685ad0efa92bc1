// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <utility>

// Vectors and matrices by their components instead of Eigen's expressions: each expression is a type of its
// own, which takes a compiler some 20 ms, and each type of numbers has its own expressions.
namespace firn
{

namespace detail
{
template <class Values, class Component, int... i>
FIRN_HOST_DEVICE inline Values made_of(Component const& component, std::integer_sequence<int, i...>)
{
    Values made;
    auto* const to = made.data();
    ((to[i] = component(i)), ...);
    return made;
}
} // namespace detail

/// The vector or matrix `Values` of `component(i)`, column by column; without a loop, so that compilers keep
/// it in registers from the start.
template <class Values, class Component>
FIRN_HOST_DEVICE inline Values made_of(Component const& component)
{
    return detail::made_of<Values>(component,
                                   std::make_integer_sequence<int, int{Values::SizeAtCompileTime}>{});
}

/// A copy of a vector or a matrix, component by component. Eigen copies memory, which a compiler may do in
/// parts narrower than packs; a pack that was stored in two parts cannot be loaded before they have reached
/// the cache.
template <class Values>
FIRN_HOST_DEVICE inline Values copy_of(Values const& values)
{
    return made_of<Values>([from = values.data()](int i) { return from[i]; });
}

/// The vector or matrix `Values` of zeros.
template <class Values>
FIRN_HOST_DEVICE inline Values zeros()
{
    using Number = typename Values::Scalar;
    return made_of<Values>([](int) { return Number(0); });
}

/// The sum of `term(0)` to `term(d - 1)`, in Eigen's order: the later terms are added first.
template <Lane Real, int d, class Term>
FIRN_HOST_DEVICE inline Real sum_of(Term const& term)
{
    if constexpr (d == 2)
        return term(0) + term(1);
    else
        return term(0) + (term(1) + term(2));
}

/// The vector of `component(i)`, also without a loop.
template <Lane Real, int d, class Component>
FIRN_HOST_DEVICE inline Vector<Real, d> make_vector(Component const& component)
{
    if constexpr (d == 2)
        return {component(0), component(1)};
    else
        return {component(0), component(1), component(2)};
}

/// A point or a vector of a scene as one in space: in two dimensions z is 0.
template <int d>
FIRN_HOST_DEVICE inline Eigen::Vector3d in_space(Vector<double, d> const& x)
{
    return make_vector<double, 3>([&](int i) { return i < d ? x[i] : 0.0; });
}

/// Column j of a matrix.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Vector<Real, d> column(Matrix<Real, d> const& A, int j)
{
    return make_vector<Real, d>([&](int i) { return A(i, j); });
}

/// The matrix of `component(i, j)`.
template <Lane Real, int d, class Component>
FIRN_HOST_DEVICE inline Matrix<Real, d> make_matrix(Component const& component)
{
    Matrix<Real, d> made;
    auto const set_row = [&](int i) {
        made(i, 0) = component(i, 0);
        made(i, 1) = component(i, 1);
        if constexpr (d == 3) made(i, 2) = component(i, 2);
    };
    set_row(0);
    set_row(1);
    if constexpr (d == 3) set_row(2);
    return made;
}

/// The first `d` coordinates of any of Eigen's vectors, in other numbers or the same in all lanes.
template <Lane Real, int d, class From>
FIRN_HOST_DEVICE inline Vector<Real, d> vector_of(From const& from)
{
    static_assert(From::IsVectorAtCompileTime && d <= int(From::SizeAtCompileTime));
    return make_vector<Real, d>([&](int i) { return Real(static_cast<ScalarOf<Real>>(from[i])); });
}

/// The first `d` rows and columns of a matrix, in other numbers or the same in all lanes.
template <Lane Real, int d, class From, int n>
FIRN_HOST_DEVICE inline Matrix<Real, d> matrix_of(Eigen::Matrix<From, n, n> const& from)
{
    static_assert(d <= n);
    return make_matrix<Real, d>([&](int i, int j) { return Real(static_cast<ScalarOf<Real>>(from(i, j))); });
}

/// Whether all numbers of a vector or a matrix are finite, also where the compiler assumes that they are.
template <class Number, int rows, int columns>
bool all_finite(Eigen::Matrix<Number, rows, columns> const& numbers)
{
    static_assert(rows > 0 && columns > 0);
    for (int i = 0; i < rows * columns; ++i)
        if (!is_finite(numbers.data()[i])) return false;
    return true;
}

} // namespace firn
