// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>

// The library refuses input, and rejects steps, often because of NaN or infinity. -ffinite-math-only (part of
// -ffast-math and -Ofast) lets the compiler assume that there is neither, and delete every check for them,
// isfinite and comparisons alike. The functions of this header look at bits instead, which the assumption
// does not cover.
#if defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0
#define FIRN_FINITE_MATH_ONLY
#if !defined(FIRN_ALLOW_FAST_MATH)
// clang-format off
#error "Firn: -ffinite-math-only (part of -ffast-math and -Ofast) lets the compiler delete checks for NaN and \
infinity. Add -fno-finite-math-only behind it, with clang -fno-associative-math, too; or define \
FIRN_ALLOW_FAST_MATH: Firn's own checks of input and of steps hold all the same."
// clang-format on
#endif
#endif

namespace firn
{

/// Whether the compiler assumes that there is no NaN and no infinity.
#if defined(FIRN_FINITE_MATH_ONLY)
inline constexpr bool finite_math_only = true;
#else
inline constexpr bool finite_math_only = false;
#endif

namespace detail
{
/// The same value, hidden from the optimiser: clang follows an assumption about a number into the integer of
/// its bits. Does nothing where there is no such assumption.
template <class Value>
FIRN_HOST_DEVICE inline Value opaque(Value value)
{
#if defined(FIRN_FINITE_MATH_ONLY) && !defined(FIRN_FOR_DEVICE)
    asm("" : "+m"(value));
#endif
    return value;
}

/// An unsigned integer as large as a number; there is none for a long double.
template <std::size_t bytes>
struct BitsOfSize
{};
template <>
struct BitsOfSize<4>
{
    using Type = std::uint32_t;
};
template <>
struct BitsOfSize<8>
{
    using Type = std::uint64_t;
};

/// The bits of |x|. They are in the order of magnitudes; infinity comes after all finite numbers, and NaN
/// after infinity (IEEE 754).
template <std::floating_point Number>
FIRN_HOST_DEVICE inline auto bits_of_magnitude(Number x)
{
    using Bits = typename BitsOfSize<sizeof(Number)>::Type;
    return opaque(std::bit_cast<Bits>(x)) & (std::numeric_limits<Bits>::max() >> 1);
}

/// The bits of infinity.
template <std::floating_point Number>
inline constexpr auto bits_of_infinity =
    std::bit_cast<typename BitsOfSize<sizeof(Number)>::Type>(std::numeric_limits<Number>::infinity());
} // namespace detail

/// Whether a number is finite, also where the compiler assumes that all are. For long double the compiler's
/// own check has to do.
template <std::floating_point Number>
FIRN_HOST_DEVICE inline bool is_finite(Number x)
{
    if constexpr (sizeof(Number) > 8)
        return std::isfinite(x);
    else
        return detail::bits_of_magnitude(x) < detail::bits_of_infinity<Number>;
}

/// Whether it is not NaN (infinity is a number here), also where the compiler assumes that there is none.
template <std::floating_point Number>
FIRN_HOST_DEVICE inline bool is_number(Number x)
{
    if constexpr (sizeof(Number) > 8)
        return !std::isnan(x);
    else
        return detail::bits_of_magnitude(x) <= detail::bits_of_infinity<Number>;
}

/// Whether low <= x <= high, false for NaN, also where the compiler assumes that there is none.
FIRN_HOST_DEVICE inline bool is_between(double low, double x, double high)
{
    return is_number(x) && low <= x && x <= high;
}

} // namespace firn
