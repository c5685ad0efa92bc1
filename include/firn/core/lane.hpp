// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>

#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>

// Physics is written over a lane type `Real`: a number (one particle at a time, or a device thread), or a
// pack of numbers (several particles at a time; a backend has them). So nothing branches on the values of
// particles: a comparison returns a Mask, and select(mask, a, b) chooses lane by lane. A pack has its own
// overloads of everything below as friends, found by argument-dependent look-up.
namespace firn
{

/// What a lane type is made of; specialised by each pack.
template <class Real>
struct LaneTraits;

/// A number is a lane of one.
template <std::floating_point Number>
struct LaneTraits<Number>
{
    using Scalar = Number;
    using Mask = bool;
    static constexpr int width = 1;

    FIRN_HOST_DEVICE static Number load(Number const* from) { return *from; }
    FIRN_HOST_DEVICE static void store(Number lane, Number* to) { *to = lane; }
};

/// The number type of a lane: `float` for a pack of floats.
template <class Real>
using ScalarOf = typename LaneTraits<Real>::Scalar;

/// The result of comparing two lanes.
template <class Real>
using Mask = typename LaneTraits<Real>::Mask;

/// How many numbers a lane holds.
template <class Real>
inline constexpr int lane_width = LaneTraits<Real>::width;

// ---- the scalar lane
// -------------------------------------------------------------------------------------------

/// `if_true` where the condition holds, and else `if_false`.
template <std::floating_point Number>
FIRN_HOST_DEVICE constexpr Number select(bool condition, Number if_true, Number if_false)
{
    return condition ? if_true : if_false;
}

/// Whether a mask holds in any lane.
FIRN_HOST_DEVICE constexpr bool any(bool mask) { return mask; }
/// Whether a mask holds in all lanes.
FIRN_HOST_DEVICE constexpr bool all(bool mask) { return mask; }

/// One bit per lane, lane 0 lowest.
FIRN_HOST_DEVICE constexpr std::uint64_t bits(bool mask) { return mask; }

/// Calls `use(lane)` for each of `width` lanes with its bit set, lane 0 first.
template <int width, class Use>
FIRN_HOST_DEVICE void for_each_lane(std::uint64_t bits, Use const& use)
{
    if constexpr (width == 1) { // nvcc 13 reads beside an array at an index from std::countr_zero
        if (bits != 0) use(0);
    }
    else
        for (; bits != 0; bits &= bits - 1) use(std::countr_zero(bits));
}

/// Whether a magnitude, 0 or above, is below a bound; false for NaN, also where the compiler assumes that
/// there is no NaN (see core/finite.hpp).
template <std::floating_point Number>
FIRN_HOST_DEVICE inline bool is_below(Number magnitude, Number bound)
{
    if constexpr (finite_math_only && sizeof(Number) <= 8)
        return detail::bits_of_magnitude(magnitude) < detail::bits_of_magnitude(bound);
    else
        return magnitude < bound;
}

/// The largest of a lane's numbers.
template <std::floating_point Number>
FIRN_HOST_DEVICE constexpr Number largest(Number x)
{
    return x;
}

// clang-format off
/// The square root.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number sqrt(Number x) { return std::sqrt(x); }
/// The magnitude.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number abs(Number x) { return std::abs(x); }
/// The exponential.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number exp(Number x) { return std::exp(x); }
/// The natural logarithm.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number log(Number x) { return std::log(x); }
// What follows is as accurate as the library of the host or of the device; packs say what they guarantee.
/// x to the power of y; NaN for a negative x and a y that is not whole.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number pow(Number x, Number y) { return std::pow(x, y); }
/// The sine of an angle in radians.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number sin(Number x) { return std::sin(x); }
/// The cosine of an angle in radians.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number cos(Number x) { return std::cos(x); }
/// The hyperbolic tangent.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number tanh(Number x) { return std::tanh(x); }
/// The largest whole number that is not above x.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number floor(Number x) { return std::floor(x); }
/// The smaller one, or `a` if one of them is NaN.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number min(Number a, Number b) { return b < a ? b : a; }
/// The larger one, or `a` if one of them is NaN.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number max(Number a, Number b) { return a < b ? b : a; }
/// One over the square root.
template <std::floating_point Number> FIRN_HOST_DEVICE inline Number inverse_sqrt(Number x) { return Number(1) / std::sqrt(x); }
// clang-format on

/// What physics may require of a lane type.
template <class Real>
concept Lane = requires(Real a, Real b, ScalarOf<Real> number, Mask<Real> mask)
{
    Real(number);
    LaneTraits<Real>::store(LaneTraits<Real>::load(&number), &number);
    {
        -a + b* a - a / b
        } -> std::convertible_to<Real>;
    {
        a < b
        } -> std::same_as<Mask<Real>>;
    {
        a > b
        } -> std::same_as<Mask<Real>>;
    {
        a == b
        } -> std::same_as<Mask<Real>>;
    {
        !mask
        } -> std::convertible_to<Mask<Real>>;
    {
        mask& mask
        } -> std::convertible_to<Mask<Real>>;
    {
        mask | mask
        } -> std::convertible_to<Mask<Real>>;
    {
        is_below(a, b)
        } -> std::same_as<Mask<Real>>;
    {
        select(mask, a, b)
        } -> std::same_as<Real>;
    {
        any(mask)
        } -> std::same_as<bool>;
    {
        all(mask)
        } -> std::same_as<bool>;
    {
        bits(mask)
        } -> std::same_as<std::uint64_t>;
    {
        largest(a)
        } -> std::same_as<ScalarOf<Real>>;
    {
        sqrt(a)
        } -> std::same_as<Real>;
    {
        abs(a)
        } -> std::same_as<Real>;
    {
        exp(a)
        } -> std::same_as<Real>;
    {
        log(a)
        } -> std::same_as<Real>;
    {
        pow(a, b)
        } -> std::same_as<Real>;
    {
        sin(a)
        } -> std::same_as<Real>;
    {
        cos(a)
        } -> std::same_as<Real>;
    {
        tanh(a)
        } -> std::same_as<Real>;
    {
        floor(a)
        } -> std::same_as<Real>;
    {
        min(a, b)
        } -> std::same_as<Real>;
    {
        max(a, b)
        } -> std::same_as<Real>;
    {
        inverse_sqrt(a)
        } -> std::same_as<Real>;
};

static_assert(Lane<float> && Lane<double>);

} // namespace firn
