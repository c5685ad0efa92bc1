// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/native_lane.hpp>

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>

// Powers, sines, cosines and hyperbolic tangents of packs. All are computed in double precision, those of
// floats with shorter polynomials in two packs of half the width. Each product that goes into a sum is fused
// with it, and no other one is. So a number's result has the same bits in a pack of any width, and beside any
// other numbers. The polynomials are interpolated at Chebyshev's points.

#if defined(FIRN_HAS_XSIMD)

// Without instructions that multiply and add at once, the C library is faster. With flags by which compilers
// change the order of sums, or assume that there is no NaN, it is more accurate.
#if !(defined(__FMA__) || defined(__aarch64__)) || defined(__FAST_MATH__) ||                                 \
    defined(__ASSOCIATIVE_MATH__) || defined(FIRN_FINITE_MATH_ONLY)
#define FIRN_MORE_FUNCTIONS_BY_NUMBER
#endif

namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

namespace functions
{

/// The function of each number by itself.
template <class Pack, class Function, class... Packs>
Pack by_number(Function const& function, Pack x, Packs... more)
{
    if constexpr (sizeof...(more) == 0) {
        typename Pack::Number lanes[Pack::width];
        x.store(lanes);
        for (auto& lane : lanes) lane = function(lane);
        return Pack::load(lanes);
    }
    else {
        typename Pack::Number lanes[Pack::width], others[Pack::width];
        x.store(lanes);
        (more.store(others), ...);
        for (int l = 0; l < Pack::width; ++l) lanes[l] = function(lanes[l], others[l]);
        return Pack::load(lanes);
    }
}

#if !defined(FIRN_MORE_FUNCTIONS_BY_NUMBER)

// In what follows D is a pack of doubles, and Number the type that the results are for.

/// a b + c, rounded once.
template <class D>
D times_plus(D a, D b, D c)
{
    using Batch = typename D::Batch;
#if defined(__aarch64__)
    return D(Batch(vfmaq_f64(c.value.data, a.value.data, b.value.data)));
#else
#if defined(__AVX512F__)
    if constexpr (D::width == 8) return D(Batch(_mm512_fmadd_pd(a.value.data, b.value.data, c.value.data)));
#endif
    if constexpr (D::width == 4) return D(Batch(_mm256_fmadd_pd(a.value.data, b.value.data, c.value.data)));
    if constexpr (D::width == 2) return D(Batch(_mm_fmadd_pd(a.value.data, b.value.data, c.value.data)));
#endif
}

/// The same value. Compilers fuse a product with a sum that it goes into, unless it comes out of this.
template <class D>
D settled(D x)
{
#if defined(__aarch64__)
    asm("" : "+w"(x.value.data));
#else
    asm("" : "+x"(x.value.data));
#endif
    return x;
}

/// c[0] + c[1] x + c[2] x² + …
template <class D, std::size_t count>
D polynomial(double const (&c)[count], D x)
{
    D sum(c[count - 1]);
    for (std::size_t i = count - 1; i-- > 0;) sum = times_plus(sum, x, D(c[i]));
    return sum;
}

/// The bits of doubles as integers, with the operators that compilers have for vectors.
template <class D>
struct Words
{
    using Register = typename D::Batch::register_type;
    typedef std::uint64_t Type __attribute__((vector_size(sizeof(Register))));

    static Type of(D x) { return std::bit_cast<Type>(x.value.data); }
    static D number(Type words) { return D(typename D::Batch(std::bit_cast<Register>(words))); }
};

/// The magnitude of one number with the sign of another one, zeros included.
template <class D>
D with_sign_of(D sign, D magnitude)
{
    using W = Words<D>;
    return W::number(W::of(magnitude) | (W::of(sign) & (std::uint64_t{1} << 63)));
}

/// 2ⁿ for whole n from -1022 to 1023.
template <class D>
D power_of_two(D n)
{
    return Words<D>::number(Words<D>::of(n + D(0x1p52 + 1023)) << 52);
}

/// The nearest whole number to a b.
template <class D>
D nearest_to_product(D a, D b)
{
    D const large(0x1.8p52); // its unit of the last place is 1
    return times_plus(a, b, large) - large;
}

/// A sum whose second part is smaller than the first one's last place.
template <class D>
struct Pair
{
    D high, low;
};

/// a b without an error.
template <class D>
Pair<D> product(D a, D b)
{
    D const high = settled(a * b);
    return {high, times_plus(a, b, -high)};
}

// ln 2 in two parts, of which the first one times a whole number below 2¹² has no error
inline constexpr double ln2_high = 0x1.62e42fefa3p-1, ln2_low = 0x1.3de6af278ece6p-42;

/// The natural logarithm of positive finite numbers, to 2⁻⁶⁵ of itself for doubles. With x = 2ⁿ m, m between
/// √½ and √2, and s = (m - 1) / (m + 1), it is n ln 2 + 2 s + s³ g(s²).
template <class Number, class D>
Pair<D> logarithm(D x)
{
    using W = Words<D>;
    D n(0);
    if constexpr (sizeof(Number) == 8) { // a denormal float is a normal double
        auto const denormal = x < D(std::numeric_limits<double>::min());
        x = select(denormal, x * D(0x1p54), x);
        n = select(denormal, D(-54), n);
    }
    constexpr std::uint64_t one = std::bit_cast<std::uint64_t>(1.0), first = 0x3fe6a09e667f3bcd; // √½
    auto const words = W::of(x) + (one - first);
    n = n + (W::number((words >> 52) | std::bit_cast<std::uint64_t>(0x1p52)) - D(0x1p52 + 1023));
    D const m = W::number((words & ((std::uint64_t{1} << 52) - 1)) + first);
    D const above = m - D(1), sum = m + D(1);
    if constexpr (sizeof(Number) == 4) {
        constexpr double g[] = {0.6666666666737581, 0.39999998796359565, 0.285717547355818,
                                0.22191388154720976, 0.1936289997264935};
        D const s = above / sum, z = s * s;
        return {times_plus(n, D(ln2_high + ln2_low), times_plus(s * z, polynomial(g, z), s + s)), D(0)};
    }
    else {
        // g(z) = 2/3 + z h(z)
        constexpr double h[] = {0.4,
                                0.2857142857142937,
                                0.2222222222165554,
                                0.1818181833547124,
                                0.15384594954137945,
                                0.13334805149611875,
                                0.11706224135460942,
                                0.11723306234080849};
        D const lost = m - (sum - D(1)), inverse = D(1) / sum;
        D const s = settled(above * inverse);
        D const s_low = settled(times_plus(-s, lost, times_plus(-s, sum, above)) * inverse);
        Pair<D> z = product(s, s);
        z.low = times_plus(s + s, s_low, z.low);
        D const rest = settled(z.high * polynomial(h, z.high));
        D const g = D(2. / 3) + rest, g_low = (rest - (g - D(2. / 3))) + D(0x1.5555555555555p-55);
        Pair<D> cube = product(s, z.high);
        cube.low = times_plus(s, z.low, times_plus(s_low, z.high, cube.low));
        Pair<D> third = product(cube.high, g);
        third.low = times_plus(cube.high, g_low, times_plus(cube.low, g, third.low));
        D const of_exponent = n * D(ln2_high), first_term = s + s;
        D const partial = of_exponent + first_term, all = partial + third.high;
        D const low = ((first_term - (partial - of_exponent)) + (third.high - (all - partial))) +
                      (third.low + (s_low + s_low));
        D const rounded_off = times_plus(n, D(ln2_low), low), high = all + rounded_off;
        return {high, rounded_off - (high - all)};
    }
}

/// An exponential as 2ⁿ (1 + high + low).
template <class D>
struct Exponential
{
    D n, high, low;
};

/// The exponential of a sum, whose magnitude is below 1000.
template <class Number, class D>
Exponential<D> exponential(Pair<D> x)
{
    // exp r = 1 + r + r² p(r) for |r| up to ln 2 / 2
    D const n = nearest_to_product(x.high, D(0x1.71547652b82fep0));
    D const rest = times_plus(-n, D(ln2_high), x.high);
    if constexpr (sizeof(Number) == 4) {
        constexpr double p[] = {0.500000001346581,  0.16666666681623232,   0.041666464925285904,
                                0.0083333109254809, 0.0013933649996309251, 0.00019890990824673654};
        D const r = times_plus(-n, D(ln2_low), rest);
        return {n, times_plus(r * r, polynomial(p, r), r), D(0)};
    }
    else {
        constexpr double p[] = {0.5000000000000001,    0.16666666666666669,   0.04166666666662413,
                                0.008333333333330062,  0.0013888888917213717, 0.00019841269863053618,
                                2.4801521295954376e-5, 2.7557268459997064e-6, 2.7620088445409746e-7,
                                2.510038549551032e-8};
        D const small = settled(n * D(ln2_low)), high = rest - small;
        D const low = x.low + ((rest - high) - small), r = high + low;
        return {n, r, times_plus(r * r, polynomial(p, r), low - (r - high))};
    }
}

/// x to the power of y, with the special values of IEEE 754.
template <class Number, class D>
D power(D x, D y)
{
    D const magnitude = abs(x), infinity(std::numeric_limits<double>::infinity());
    auto const is_finite = magnitude < infinity;
    Pair<D> of_base = logarithm<Number>(magnitude);
    of_base.high = select(is_finite, of_base.high, magnitude);
    of_base.high = select(magnitude == D(0), -infinity, of_base.high);
    Pair<D> exponent = product(y, of_base.high);
    exponent.low = times_plus(y, of_base.low, exponent.low);
    D const limit(sizeof(Number) == 4 ? 200 : 800); // beyond, results are 0 or infinite
    exponent.low = select(abs(exponent.high) < limit, exponent.low, D(0));
    exponent.high = max(min(exponent.high, limit), -limit); // NaN stays
    Exponential<D> const e = exponential<Number>(exponent);
    D result = D(1) + (e.high + e.low);
    if constexpr (sizeof(Number) == 4)
        result = result * power_of_two(e.n);
    else { // by two factors, either of which is a normal number
        D const half = floor(e.n * D(0.5));
        result = result * power_of_two(half) * power_of_two(e.n - half);
    }
    result = select((magnitude == D(1)) & (y == y), D(1), result); // where y may be infinite
    auto const is_whole = floor(y) == y;
    D const half = y * D(0.5);
    result = select(is_whole & (floor(half) != half), with_sign_of(x, result), result);
    D const none(std::numeric_limits<double>::quiet_NaN());
    result = select((x < D(0)) & is_finite & (!is_whole), none, result);
    return select((x == D(1)) | (y == D(0)), D(1), result);
}

/// Up to here angles are reduced in packs: the number of right angles has no more than 20 bits.
inline constexpr double largest_angle = 800000;

/// The sine of x and some right angles more.
template <class Number, class D>
D sine(D x, double right_angles)
{
    // π/2 in parts of 33 bits: each times n has no error (Cody and Waite 1980)
    constexpr double part[] = {0x1.921fb544p0, 0x1.0b4611a6p-34, 0x1.3198a2ep-69, 0x1.b839a252p-104};
    D const n = nearest_to_product(x, D(0x1.45f306dc9c883p-1));
    D const half(0.5), first = times_plus(-n, D(part[0]), x);
    D of_sine, of_cosine;
    if constexpr (sizeof(Number) == 4) {
        constexpr double of_s[] = {-0.16666666663853044, 0.008333331873837089, -0.00019840086263755443,
                                   2.7249864655139585e-6};
        constexpr double of_c[] = {0.04166666465830042, -0.0013888302802309161, 2.454789161981386e-5};
        D const r = times_plus(-n, D(part[1] + part[2]), first), z = r * r;
        of_sine = times_plus(r * z, polynomial(of_s, z), r);
        of_cosine = times_plus(z * z, polynomial(of_c, z), times_plus(-half, z, D(1)));
    }
    else {
        constexpr double of_s[] = {-0.16666666666666666, 0.008333333333330946,   -0.0001984126983675497,
                                   2.755731610068303e-6, -2.5051131455427946e-8, 1.591810123027412e-10};
        constexpr double of_c[] = {0.041666666666666664,   -0.0013888888888887395, 2.4801587298763433e-5,
                                   -2.7557317270560326e-7, 2.0876146024689747e-9,  -1.1382614868556325e-11};
        D const second_part = n * D(part[1]), second = first - second_part;
        D const third_part = n * D(part[2]), third = second - third_part;
        D const lost = ((first - second) - second_part) + ((second - third) - third_part);
        D const low = times_plus(-n, D(part[3]), lost);
        D const r = third + low, rest = (third - r) + low; // the angle is r + rest
        D const z = r * r, half_z = half * z, beside = D(1) - half_z;
        of_sine = r + times_plus(r * z, polynomial(of_s, z), times_plus(-half_z, rest, rest));
        of_cosine =
            beside + times_plus(z * z, polynomial(of_c, z), times_plus(-r, rest, (D(1) - beside) - half_z));
    }
    D quarter = n + D(right_angles);
    quarter = quarter - D(4) * floor(quarter * D(0.25));
    D const found = select((quarter == D(1)) | (quarter == D(3)), of_cosine, of_sine);
    return select(quarter > D(1.5), -found, found);
}

/// The hyperbolic tangent: t / (t + 2) with t = exp(2 |x|) - 1.
template <class Number, class D>
D hyperbolic_tangent(D x)
{
    D const magnitude = min(abs(x), D(sizeof(Number) == 4 ? 10 : 22)); // beyond, the result is 1
    Exponential<D> const e = exponential<Number>(Pair<D>{magnitude + magnitude, D(0)});
    D const power = power_of_two(e.n), whole = power - D(1), scaled = power * e.high, sum = whole + scaled;
    D const rest = times_plus(power, e.low, scaled - (sum - whole)), two(2);
    if constexpr (sizeof(Number) == 4) {
        D const t = sum + rest;
        return with_sign_of(x, t / (t + two));
    }
    else { // the quotient of two pairs: Dekker 1971
        D const t = sum + rest, t_low = rest - (t - sum);
        D const divisor = t + two, divisor_low = min(t, two) - (divisor - max(t, two));
        D const inverse = D(1) / divisor, quotient = settled(t * inverse);
        D const left = times_plus(-quotient, divisor, t) + times_plus(-quotient, divisor_low, t_low);
        return with_sign_of(x, times_plus(left, inverse, quotient));
    }
}

/// A pack of floats as two of doubles, D, and back.
template <class D>
struct Halves
{
    using Register = typename D::Batch::register_type;
    using Floats = Pack<float, typename D::Arch>;
    typedef float Half __attribute__((vector_size(D::width * sizeof(float))));
    static constexpr auto lanes = std::make_integer_sequence<int, D::width>{};

    template <int first, int... lane>
    static D of(Floats x, std::integer_sequence<int, lane...>)
    {
        Half const half = __builtin_shufflevector(x.value.data, x.value.data, (first + lane)...);
        return D(typename D::Batch(__builtin_convertvector(half, Register)));
    }

    template <int... lane>
    static Floats together(D low, D high, std::integer_sequence<int, lane...>)
    {
        Half const first = __builtin_convertvector(low.value.data, Half);
        Half const last = __builtin_convertvector(high.value.data, Half);
        return Floats(
            typename Floats::Batch(__builtin_shufflevector(first, last, lane..., (D::width + lane)...)));
    }
};

/// Calls a function of packs of doubles. Floats are converted, half of them at a time.
template <class Number, class Arch, class Function, class... Packs>
Pack<Number, Arch> in_doubles(Function const& function, Pack<Number, Arch> x, Packs... more)
{
    if constexpr (sizeof(Number) == 8)
        return function(x, more...);
    else {
        using D = Pack<double, Arch>;
        using H = Halves<D>;
        return H::together(
            function(H::template of<0>(x, H::lanes), H::template of<0>(more, H::lanes)...),
            function(H::template of<D::width>(x, H::lanes), H::template of<D::width>(more, H::lanes)...),
            H::lanes);
    }
}

/// Replaces the results for angles that are too large to be reduced here.
template <class P, class Function>
P with_large_angles(P x, P results, Function const& function)
{
    auto const far = !(abs(x) < P(typename P::Number(largest_angle)));
    if (any(far)) [[unlikely]]
        return select(far, by_number(function, x), results);
    return results;
}

#endif

} // namespace functions

#if defined(FIRN_MORE_FUNCTIONS_BY_NUMBER)

template <class Number, class Arch>
Pack<Number, Arch> pow(Pack<Number, Arch> x, Pack<Number, Arch> y)
{
    return functions::by_number([](Number a, Number b) { return std::pow(a, b); }, x, y);
}

template <class Number, class Arch>
Pack<Number, Arch> sin(Pack<Number, Arch> x)
{
    return functions::by_number([](Number a) { return std::sin(a); }, x);
}

template <class Number, class Arch>
Pack<Number, Arch> cos(Pack<Number, Arch> x)
{
    return functions::by_number([](Number a) { return std::cos(a); }, x);
}

template <class Number, class Arch>
Pack<Number, Arch> tanh(Pack<Number, Arch> x)
{
    return functions::by_number([](Number a) { return std::tanh(a); }, x);
}

#else

/// To 2 ulp for all numbers, denormal results included. Zeros, infinities, NaN and negative bases are as in
/// IEEE 754 and in std::pow: 1 to any power is 1, and so is anything to the power of 0.
template <class Number, class Arch>
Pack<Number, Arch> pow(Pack<Number, Arch> x, Pack<Number, Arch> y)
{
    return functions::in_doubles([](auto a, auto b) { return functions::power<Number>(a, b); }, x, y);
}

/// To 2 ulp for |x| < 800 000. Larger angles are left to std::sin, one number at a time. NaN for infinity.
template <class Number, class Arch>
Pack<Number, Arch> sin(Pack<Number, Arch> x)
{
    auto const found = functions::in_doubles([](auto a) { return functions::sine<Number>(a, 0); }, x);
    return functions::with_large_angles(x, select(x == Pack<Number, Arch>(0), x, found),
                                        [](Number a) { return std::sin(a); });
}

/// To 2 ulp for |x| < 800 000. Larger angles are left to std::cos, one number at a time. NaN for infinity.
template <class Number, class Arch>
Pack<Number, Arch> cos(Pack<Number, Arch> x)
{
    auto const found = functions::in_doubles([](auto a) { return functions::sine<Number>(a, 1); }, x);
    return functions::with_large_angles(x, found, [](Number a) { return std::cos(a); });
}

/// To 2 ulp for all numbers.
template <class Number, class Arch>
Pack<Number, Arch> tanh(Pack<Number, Arch> x)
{
    return functions::in_doubles([](auto a) { return functions::hyperbolic_tangent<Number>(a); }, x);
}

#endif

// with a plain number for one of the two, as operators have it

template <class Number, class Arch>
Pack<Number, Arch> pow(Pack<Number, Arch> x, std::type_identity_t<Number> y)
{
    return pow(x, Pack<Number, Arch>(y));
}

template <class Number, class Arch>
Pack<Number, Arch> pow(std::type_identity_t<Number> x, Pack<Number, Arch> y)
{
    return pow(Pack<Number, Arch>(x), y);
}

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp

static_assert(firn::Lane<firn::openmp::NativePack<float>> && firn::Lane<firn::openmp::NativePack<double>>);

#endif
