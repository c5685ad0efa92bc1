// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/instruction_set.hpp>

#include <cmath>
#include <concepts>
#include <cstddef>
#include <limits>

// Without SSE4.1 xsimd rounds by adding a large number and subtracting it again, which -fassociative-math
// (part of -ffast-math) simplifies to nothing: exp is then off by a third. clang does the same to xsimd's
// logarithm. There these functions are computed by the C library, one number at a time.
#if (defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__)) && (defined(__clang__) || !defined(__SSE4_1__))
#define FIRN_FUNCTIONS_BY_NUMBER
#endif

#if defined(FIRN_HAS_XSIMD)

namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

// As in pack.hpp: warnings about g++ 12's own intrinsics.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

/// The rounding, the exponential, the logarithm and the inverse root of a pack.
template <class Pack>
class PackFunctions
{
    using Number = typename Pack::Number;
    using Arch = typename Pack::Arch;
    using Batch = typename Pack::Batch;
    using Mask = typename Pack::Mask;
    static constexpr int width = Pack::width;

public:
#if defined(FIRN_FUNCTIONS_BY_NUMBER)
    static Pack floor(Pack a)
    {
        return by_number(a, [](Number x) { return std::floor(x); });
    }
    static Pack exp(Pack a)
    {
        return by_number(a, [](Number x) { return std::exp(x); });
    }
    static Pack log(Pack a)
    {
        return by_number(a, [](Number x) { return std::log(x); });
    }
#else
    static Pack floor(Pack a) { return Pack(xsimd::floor(a.value)); }

    /// To 2 ulp; results below the smallest normal number are 0, those within a factor 1.5 of the largest, ∞.
    static Pack exp(Pack a) { return Pack(xsimd::exp(a.value)); }

    /// To 1 ulp; −∞ for 0, NaN for negative numbers.
    static Pack log(Pack a)
    {
        if constexpr (sizeof(Number) == 4 && std::derived_from<Arch, xsimd::avx512f>)
            return log_by_mantissa(a);
        else if constexpr (sizeof(Number) == 4)
            return Pack(xsimd::log(a.value));
        else {
            // xsimd 8.1 scales denormal doubles, but takes the exponent of the unscaled number.
            Mask const small = a < Pack(std::numeric_limits<Number>::min());
            Pack const of_scaled(xsimd::log(select(small, a * Number(0x1p54), a).value));
            return of_scaled - select(small, Pack(Number(54 * 0.693147180559945309417)), Pack(0));
        }
    }
#endif

    /// 1/√x to 1.5 ulp: with y the estimate and e = 1 − x y², 1/√x = y (1 + e/2 + 3 e²/8 + …).
    static Pack inverse_sqrt(Pack x)
    {
        if constexpr (estimate_bits() == 0)
            return Number(1) / sqrt(x);
        else if constexpr (estimate_bits() == 14) {
            Pack const y(estimate(x.value));
            Pack const error = Pack(one_minus((x * y).value, y.value));
            // error is NaN where x is 0, ∞ or has no root; the estimate is exact there
            return select(error == error, y + y * (error * Number(0.5)), y);
        }
        else {
            // The 12-bit estimate treats denormal numbers as zero.
            Mask const small = x < Pack(std::numeric_limits<Number>::min());
            Pack const scaled = select(small, x * Number(0x1p24), x);
            Pack const y(estimate(scaled.value));
            Pack const product = scaled * y;
            Pack const rest(lost_by_rounding(scaled.value, y.value, product.value));
            Pack const error = Pack(one_minus(product.value, y.value)) - rest * y;
            Pack const root =
                select(error == error, y + y * (error * (Number(0.5) + error * Number(0.375))), y);
            return select(small, root * Number(0x1p12), root);
        }
    }

private:
#if defined(FIRN_FUNCTIONS_BY_NUMBER)
    template <class Function>
    static Pack by_number(Pack x, Function const& function)
    {
        Number lanes[width];
        x.store(lanes);
        for (Number& lane : lanes) lane = function(lane);
        return Pack::load(lanes);
    }
#endif

    /// The logarithm by an instruction that splits numbers, denormal ones included. With x = 2ⁿ (1 + r), r
    /// from -1/4 to 1/2, it is n ln 2 + r − r²/2 + r³ p(r), where p has the least largest error of its
    /// degree, 5e-9 of the whole. It needs no branch and no quotient; xsimd's has one of each.
    static Pack log_by_mantissa([[maybe_unused]] Pack x)
    {
#if defined(__AVX512F__)
        constexpr float p[] = {0.33333450f, -0.25000095f, 0.19990861f, -0.16647312f,
                               0.14478396f, -0.13161199f, 0.10463030f, -0.04507483f};
        auto const of = [](float number) { return _mm512_set1_ps(number); };
        auto const times_plus = [](__m512 a, __m512 b, __m512 c) { return _mm512_fmadd_ps(a, b, c); };
        __m512 const mantissa = _mm512_getmant_ps(x.value.data, _MM_MANT_NORM_p75_1p5, _MM_MANT_SIGN_nan);
        __m512 const n = _mm512_sub_ps(_mm512_getexp_ps(x.value.data), _mm512_getexp_ps(mantissa));
        __m512 const r = _mm512_sub_ps(mantissa, of(1)), r2 = _mm512_mul_ps(r, r);
        __m512 const low =
            times_plus(times_plus(of(p[3]), r, of(p[2])), r2, times_plus(of(p[1]), r, of(p[0])));
        __m512 const high =
            times_plus(times_plus(of(p[7]), r, of(p[6])), r2, times_plus(of(p[5]), r, of(p[4])));
        __m512 const all = times_plus(high, _mm512_mul_ps(r2, r2), low);
        __m512 const of_mantissa = times_plus(r2, times_plus(r, all, of(-0.5f)), r);
        return Pack(Batch(times_plus(n, of(0.693147181f), of_mantissa)));
#else
        return x;
#endif
    }

    /// The precision in bits of the processor's estimate of 1/√x; 0 if it has none, or only one of 8 bits.
    static constexpr int estimate_bits()
    {
        if (sizeof(Number) != 4) return 0;
        if (std::derived_from<Arch, xsimd::avx512f>) return 14;
#if defined(__AVX512VL__)
        return std::derived_from<Arch, xsimd::sse2> || std::derived_from<Arch, xsimd::avx> ? 14 : 0;
#else
        return std::derived_from<Arch, xsimd::sse2> || std::derived_from<Arch, xsimd::avx> ? 12 : 0;
#endif
    }

    static Batch estimate(Batch x)
    {
        if constexpr (std::derived_from<Arch, xsimd::avx512f>) return _mm512_rsqrt14_ps(x.data);
#if defined(__AVX512VL__)
        else if constexpr (std::derived_from<Arch, xsimd::avx>)
            return _mm256_rsqrt14_ps(x.data);
        else
            return _mm_rsqrt14_ps(x.data);
#else
        else if constexpr (std::derived_from<Arch, xsimd::avx>)
            return _mm256_rsqrt_ps(x.data);
        else
            return _mm_rsqrt_ps(x.data);
#endif
    }

    /// 1 − a b, rounded once where the processor can; xsimd 8.1 cannot for AVX-512.
    static Batch one_minus(Batch a, Batch b)
    {
        Batch const one(Number(1));
        if constexpr (std::derived_from<Arch, xsimd::avx512f>)
            return _mm512_fnmadd_ps(a.data, b.data, one.data);
        else
            return xsimd::fnma(a, b, one);
    }

    /// The rounding error of `product` = a b, where the processor can compute it.
    static Batch lost_by_rounding([[maybe_unused]] Batch a, [[maybe_unused]] Batch b,
                                  [[maybe_unused]] Batch product)
    {
#if defined(__FMA__)
        if constexpr (std::derived_from<Arch, xsimd::avx>)
            return _mm256_fmsub_ps(a.data, b.data, product.data);
        else
            return _mm_fmsub_ps(a.data, b.data, product.data);
#else
        return Batch(Number(0));
#endif
    }
};

#pragma GCC diagnostic pop

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp

#endif
