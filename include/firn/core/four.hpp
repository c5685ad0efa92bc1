// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <cstddef>

namespace firn
{

// Compilers make no vectors of loops over four sums, or drop the last one and make pairs. Functions take
// these by reference: how they are passed depends on the processor compiled for.
#if defined(FIRN_VECTOR_TYPES)

namespace detail
{
template <class Number>
struct FourNumbers
{
    typedef Number Type __attribute__((vector_size(4 * sizeof(Number))));
};
} // namespace detail

/// Four numbers, which a processor adds and multiplies at once.
template <class Number>
using Four = typename detail::FourNumbers<Number>::Type;

/// The same numbers of another type.
template <class To, class From>
inline void convert(From const& from, To& to)
{
    to = __builtin_convertvector(from, To);
}

#else

/// Four numbers.
template <class Number>
struct alignas(4 * sizeof(Number)) Four
{
    Number of[4];

    FIRN_HOST_DEVICE Number& operator[](int i) { return of[i]; }
    FIRN_HOST_DEVICE Number const& operator[](int i) const { return of[i]; }
    FIRN_HOST_DEVICE friend Four operator+(Four const& x, Four const& y)
    {
        return {{x[0] + y[0], x[1] + y[1], x[2] + y[2], x[3] + y[3]}};
    }
    FIRN_HOST_DEVICE friend Four operator-(Four const& x, Four const& y)
    {
        return {{x[0] - y[0], x[1] - y[1], x[2] - y[2], x[3] - y[3]}};
    }
    FIRN_HOST_DEVICE friend Four operator*(Four const& x, Number y)
    {
        return {{x[0] * y, x[1] * y, x[2] * y, x[3] * y}};
    }
    FIRN_HOST_DEVICE Four& operator+=(Four const& x) { return *this = *this + x; }
};

/// The same numbers of another type.
template <class To, class From>
FIRN_HOST_DEVICE inline void convert(Four<From> const& from, Four<To>& to)
{
    for (int i = 0; i < 4; ++i) to[i] = static_cast<To>(from[i]);
}

#endif

} // namespace firn
