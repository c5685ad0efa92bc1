// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/openmp/tuning.hpp>

#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

// Packs exist where xsimd is installed, unless FIRN_NO_XSIMD is defined.
#if !defined(FIRN_NO_XSIMD) && __has_include(<xsimd/xsimd.hpp>)
#if defined(__NVCC__)
#error "nvcc does not compile firn/openmp.hpp with xsimd: include it in a .cpp file."
#endif
#define FIRN_HAS_XSIMD
#include <xsimd/xsimd.hpp>
#endif

// Without SSE4.1 xsimd rounds by adding a large number and subtracting it again, which -fassociative-math
// (part of -ffast-math) simplifies to nothing: exp is then off by a third. clang does the same to xsimd's
// logarithm. There these functions are computed by the C library, one number at a time.
#if (defined(__FAST_MATH__) || defined(__ASSOCIATIVE_MATH__)) && (defined(__clang__) || !defined(__SSE4_1__))
#define FIRN_FUNCTIONS_BY_NUMBER
#endif

namespace firn::openmp
{

// Everything that runs on lanes is a template over a type of this namespace, so that the namespace's name is
// part of every symbol. Files of one program compiled for different processors then never share a function.
#if defined(__AVX512VL__) && defined(__AVX512DQ__) && defined(__AVX512BW__)
inline namespace avx512
#elif defined(__AVX512F__)
inline namespace avx512f
#elif defined(__AVX2__) && defined(__FMA__)
inline namespace avx2_fma
#elif defined(__AVX2__)
inline namespace avx2
#elif defined(__AVX__)
inline namespace avx
#elif defined(__SSE4_2__)
inline namespace sse4
#elif defined(__SSE2__)
inline namespace sse2
#elif defined(__ARM_NEON)
inline namespace neon
#else
inline namespace plain
#endif
{

#if defined(FIRN_HAS_XSIMD)

// g++ 12 mistakes the "undefined" registers inside its own AVX-512 intrinsics for errors (its bug 105593).
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

#if defined(__AVX512F__)
/// A mask register as a number. g++ 12 may spill the register's one or two bytes and read eight back. The
/// empty assembly hides where the number comes from, so that the bits beyond the mask are really cut off.
template <class Register>
std::uint64_t number_of(Register mask)
{
    unsigned number = mask;
    asm("" : "+r"(number));
    return number & ((std::uint64_t{1} << (8 * sizeof(Register))) - 1);
}
#endif

#if defined(__AVX2__) && !defined(__AVX512VL__)
/// AVX2 has no instructions that compress and expand. These tables replace them: for each pattern of lanes,
/// the source of each word of 32 bits, or -1 for zero. A lane is one word or two.
template <int words>
struct WordsByPattern
{
    static constexpr int lanes = 8 / words;
    using Words = std::array<signed char, 8>;

    std::array<Words, 1 << lanes> together; ///< compress: the lanes of the pattern side by side
    std::array<Words, 1 << lanes> apart;    ///< expand: consecutive lanes to the lanes of the pattern

    constexpr WordsByPattern() : together{}, apart{}
    {
        for (unsigned pattern = 0; pattern < 1u << lanes; ++pattern) {
            for (int word = 0; word < 8; ++word)
                together[pattern][std::size_t(word)] = apart[pattern][std::size_t(word)] = -1;
            int count = 0;
            for (int lane = 0; lane < lanes; ++lane) {
                if (((pattern >> lane) & 1) == 0) continue;
                for (int word = 0; word < words; ++word) {
                    together[pattern][std::size_t(count * words + word)] =
                        static_cast<signed char>(lane * words + word);
                    apart[pattern][std::size_t(lane * words + word)] =
                        static_cast<signed char>(count * words + word);
                }
                ++count;
            }
        }
    }
};
template <int words>
inline constexpr WordsByPattern<words> words_by_pattern;

/// Permutes the words of a register by a table of sources.
inline __m256 moved(__m256 words, std::array<signed char, 8> const& from)
{
    __m256i const places =
        _mm256_cvtepi8_epi32(_mm_loadl_epi64(reinterpret_cast<__m128i const*>(from.data())));
    return _mm256_blendv_ps(_mm256_permutevar8x32_ps(words, places), _mm256_setzero_ps(),
                            _mm256_castsi256_ps(places));
}

/// Eight words of any type.
inline __m256 load_words(void const* from)
{
    return _mm256_castsi256_ps(_mm256_loadu_si256(static_cast<__m256i const*>(from)));
}
inline void store_words(__m256 words, void* to)
{
    _mm256_storeu_si256(static_cast<__m256i*>(to), _mm256_castps_si256(words));
}

/// The first `count` words at `from`, then zeros. They are loaded in the parts in which store_first_words()
/// stores them: other parts would have to reach the cache before they could be loaded.
inline __m256 load_first_words(int count, void const* from)
{
    if (count == 8) return load_words(from);
    auto const* next = static_cast<char const*>(from);
    __m128i first = _mm_setzero_si128(), rest = first;
    if ((count & 4) != 0) {
        first = _mm_loadu_si128(reinterpret_cast<__m128i const*>(next));
        next += 16;
    }
    if ((count & 2) != 0) {
        rest = _mm_loadl_epi64(reinterpret_cast<__m128i const*>(next));
        next += 8;
    }
    if ((count & 1) != 0) {
        int word;
        std::memcpy(&word, next, 4);
        __m128i const last = _mm_cvtsi32_si128(word);
        rest = (count & 2) != 0 ? _mm_unpacklo_epi64(rest, last) : last;
    }
    bool const is_long = (count & 4) != 0;
    return _mm256_castsi256_ps(_mm256_set_m128i(is_long ? rest : first, is_long ? first : rest));
}

/// Writes the first `count` words and nothing beyond.
inline void store_first_words(__m256 words, int count, void* to)
{
    if (count == 8) return store_words(words, to);
    auto* next = static_cast<char*>(to);
    __m128i part = _mm_castps_si128(_mm256_castps256_ps128(words));
    if ((count & 4) != 0) {
        _mm_storeu_si128(reinterpret_cast<__m128i*>(next), part);
        next += 16;
        part = _mm_castps_si128(_mm256_extractf128_ps(words, 1));
    }
    if ((count & 2) != 0) {
        _mm_storel_epi64(reinterpret_cast<__m128i*>(next), part);
        next += 8;
        part = _mm_unpackhi_epi64(part, part);
    }
    if ((count & 1) != 0) {
        int const word = _mm_cvtsi128_si32(part);
        std::memcpy(next, &word, 4);
    }
}
#endif

/// One truth value per number of a pack. There is no conversion to bool, so `if (mask)` does not compile: use
/// select(), any(), all() or bits().
template <class Number, class Arch>
struct PackMask
{
    using Batch = xsimd::batch_bool<Number, Arch>;
    static constexpr int width = static_cast<int>(Batch::size);

    Batch value;

    explicit operator bool() const = delete;

    friend PackMask operator!(PackMask a) { return {~a.value}; }
    friend PackMask operator&(PackMask a, PackMask b) { return {a.value & b.value}; }
    friend PackMask operator|(PackMask a, PackMask b) { return {a.value | b.value}; }

    friend bool any(PackMask a) { return bits(a) != 0; }
    friend bool all(PackMask a) { return bits(a) == (std::uint64_t{1} << width) - 1; }

    /// One bit per lane, lane 0 lowest.
    friend std::uint64_t bits(PackMask a)
    {
        if constexpr (std::derived_from<Arch, xsimd::avx512f>)
            return number_of(a.value.data);
        else if constexpr (std::derived_from<Arch, xsimd::avx> && sizeof(Number) == 4)
            return static_cast<unsigned>(_mm256_movemask_ps(a.value.data));
        else if constexpr (std::derived_from<Arch, xsimd::avx>)
            return static_cast<unsigned>(_mm256_movemask_pd(a.value.data));
        else if constexpr (std::derived_from<Arch, xsimd::sse2> && sizeof(Number) == 4)
            return static_cast<unsigned>(_mm_movemask_ps(a.value.data));
        else if constexpr (std::derived_from<Arch, xsimd::sse2>)
            return static_cast<unsigned>(_mm_movemask_pd(a.value.data));
        else {
            bool lanes[std::size_t(width)];
            a.value.store_unaligned(lanes);
            std::uint64_t found = 0;
            for (int i = 0; i < width; ++i) found |= std::uint64_t{lanes[i]} << i;
            return found;
        }
    }

    /// The mask whose lane i is bit i; bits beyond the width are ignored.
    static PackMask from_bits(std::uint64_t pattern)
    {
        if constexpr (std::derived_from<Arch, xsimd::avx512f>)
            return {Batch(static_cast<typename Batch::register_type>(pattern))};
#if defined(__AVX2__)
        else if constexpr (width == 8) {
            __m256i const bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            __m256i const here = _mm256_and_si256(_mm256_set1_epi32(static_cast<int>(pattern)), bit);
            return {Batch(_mm256_castsi256_ps(_mm256_cmpeq_epi32(here, bit)))};
        }
        else if constexpr (width * sizeof(Number) == 32) {
            __m256i const bit = _mm256_setr_epi64x(1, 2, 4, 8);
            __m256i const here = _mm256_and_si256(_mm256_set1_epi64x(static_cast<long long>(pattern)), bit);
            return {Batch(_mm256_castsi256_pd(_mm256_cmpeq_epi64(here, bit)))};
        }
#endif
        else {
            // Powers of two up to 2^width are exact numbers, so this needs no integers, which some
            // instruction sets compare slowly.
            alignas(64) Number lanes[std::size_t(width)];
            for (int i = 0; i < width; ++i) lanes[i] = static_cast<Number>((pattern >> i) & 1);
            return {xsimd::batch<Number, Arch>::load_aligned(lanes) != xsimd::batch<Number, Arch>(Number(0))};
        }
    }
};

/// A lane type that holds several numbers in one register: Pack<float, Arch> for Space<d, float>.
template <class NumberType, class ArchType>
struct Pack
{
    using Number = NumberType;
    using Arch = ArchType;
    using Batch = xsimd::batch<Number, Arch>;
    using Mask = PackMask<Number, Arch>;
    static constexpr int width = static_cast<int>(Batch::size);

    Batch value;

    Pack() = default;
    Pack(Number number) : value(number) {} // implicit: formulas mix lanes and plain numbers
    explicit Pack(Batch batch) : value(batch) {}

    /// The numbers at `from`, `from + 1`, …; need not be aligned.
    static Pack load(Number const* from) { return Pack(Batch::load_unaligned(from)); }

    /// Writes the numbers to `to`, `to + 1`, …; need not be aligned.
    void store(Number* to) const { value.store_unaligned(to); }

    /// The first `count` numbers at `from`, then zeros; reads nothing beyond.
    static Pack load_first(int count, Number const* from)
    {
#if defined(__AVX512VL__)
        auto const first = (1u << count) - 1;
        if constexpr (sizeof(Number) == 4 && width == 16)
            return Pack(Batch(_mm512_maskz_loadu_ps(static_cast<__mmask16>(first), from)));
        else if constexpr (sizeof(Number) == 4 && width == 8)
            return Pack(Batch(_mm256_maskz_loadu_ps(static_cast<__mmask8>(first), from)));
        else if constexpr (sizeof(Number) == 8 && width == 8)
            return Pack(Batch(_mm512_maskz_loadu_pd(static_cast<__mmask8>(first), from)));
        else if constexpr (sizeof(Number) == 8 && width == 4)
            return Pack(Batch(_mm256_maskz_loadu_pd(static_cast<__mmask8>(first), from)));
#elif defined(__AVX2__)
        if constexpr (is_eight_words) return of_words(load_first_words(count * words, from));
#endif
        alignas(64) Number lanes[std::size_t(width)]{};
        for (int i = 0; i < count; ++i) lanes[i] = from[i];
        return Pack(Batch::load_aligned(lanes));
    }

    /// Writes the first `count` numbers and nothing beyond.
    void store_first(int count, Number* to) const
    {
#if defined(__AVX512VL__)
        auto const first = (1u << count) - 1;
        if constexpr (sizeof(Number) == 4 && width == 16)
            return _mm512_mask_storeu_ps(to, static_cast<__mmask16>(first), value.data);
        else if constexpr (sizeof(Number) == 4 && width == 8)
            return _mm256_mask_storeu_ps(to, static_cast<__mmask8>(first), value.data);
        else if constexpr (sizeof(Number) == 8 && width == 8)
            return _mm512_mask_storeu_pd(to, static_cast<__mmask8>(first), value.data);
        else if constexpr (sizeof(Number) == 8 && width == 4)
            return _mm256_mask_storeu_pd(to, static_cast<__mmask8>(first), value.data);
#elif defined(__AVX2__)
        if constexpr (is_eight_words) return store_first_words(as_words(), count * words, to);
#endif
        alignas(64) Number lanes[std::size_t(width)];
        value.store_aligned(lanes);
        for (int i = 0; i < count; ++i)
            std::memcpy(to + i, lanes + i, sizeof(Number)); // memcpy: they may be bits of integers
    }

    /// The numbers at `base[index[0]]`, `base[index[1]]`, …
    static Pack gather(Number const* base, std::int32_t const* index)
    {
#if defined(__AVX512VL__)
        if constexpr (sizeof(Number) == 4 && width == 16)
            return Pack(Batch(_mm512_i32gather_ps(_mm512_loadu_si512(index), base, 4)));
#endif
        alignas(64) Number lanes[std::size_t(width)];
        for (int i = 0; i < width; ++i) lanes[i] = base[index[i]];
        return Pack(Batch::load_aligned(lanes));
    }

    /// The lanes of the pattern side by side from lane 0 on; zeros beyond them.
    Pack compressed(std::uint64_t pattern) const
    {
#if defined(__AVX512VL__)
        if constexpr (sizeof(Number) == 4) {
            if constexpr (width == 16)
                return Pack(Batch(_mm512_maskz_compress_ps(static_cast<__mmask16>(pattern), value.data)));
            else if constexpr (width == 8)
                return Pack(Batch(_mm256_maskz_compress_ps(static_cast<__mmask8>(pattern), value.data)));
        }
        else {
            if constexpr (width == 8)
                return Pack(Batch(_mm512_maskz_compress_pd(static_cast<__mmask8>(pattern), value.data)));
            else if constexpr (width == 4)
                return Pack(Batch(_mm256_maskz_compress_pd(static_cast<__mmask8>(pattern), value.data)));
        }
#elif defined(__AVX2__)
        if constexpr (is_eight_words)
            return of_words(moved(as_words(), words_by_pattern<words>.together[pattern]));
#endif
        alignas(64) Number from[std::size_t(width)], to[std::size_t(width)] = {};
        value.store_aligned(from);
        for (int i = 0; pattern != 0; pattern &= pattern - 1) to[i++] = from[std::countr_zero(pattern)];
        return Pack(Batch::load_aligned(to));
    }

    /// The reverse: lanes 0, 1, … go to the lanes of the pattern; the others are zero.
    Pack expanded(std::uint64_t pattern) const
    {
#if defined(__AVX512VL__)
        if constexpr (sizeof(Number) == 4) {
            if constexpr (width == 16)
                return Pack(Batch(_mm512_maskz_expand_ps(static_cast<__mmask16>(pattern), value.data)));
            else if constexpr (width == 8)
                return Pack(Batch(_mm256_maskz_expand_ps(static_cast<__mmask8>(pattern), value.data)));
        }
        else {
            if constexpr (width == 8)
                return Pack(Batch(_mm512_maskz_expand_pd(static_cast<__mmask8>(pattern), value.data)));
            else if constexpr (width == 4)
                return Pack(Batch(_mm256_maskz_expand_pd(static_cast<__mmask8>(pattern), value.data)));
        }
#elif defined(__AVX2__)
        if constexpr (is_eight_words)
            return of_words(moved(as_words(), words_by_pattern<words>.apart[pattern]));
#endif
        alignas(64) Number from[std::size_t(width)], to[std::size_t(width)] = {};
        value.store_aligned(from);
        for (int i = 0; pattern != 0; pattern &= pattern - 1) to[std::countr_zero(pattern)] = from[i++];
        return Pack(Batch::load_aligned(to));
    }

    /// A pack of consecutive numbers, from place `first` on, out of those of `low` followed by those of
    /// `high`.
    template <int first>
    static Pack window(Pack low, Pack high)
    {
        return window_of(low, high, std::make_integer_sequence<int, width>{},
                         std::integral_constant<int, first>{});
    }

    Pack& operator+=(Pack b) { return *this = *this + b; }
    Pack& operator-=(Pack b) { return *this = *this - b; }
    Pack& operator*=(Pack b) { return *this = *this * b; }
    Pack& operator/=(Pack b) { return *this = *this / b; }

    friend Pack operator+(Pack a, Pack b) { return Pack(a.value + b.value); }
    friend Pack operator-(Pack a, Pack b) { return Pack(a.value - b.value); }
    friend Pack operator*(Pack a, Pack b) { return Pack(a.value * b.value); }
    friend Pack operator/(Pack a, Pack b)
    {
#if defined(__aarch64__) // xsimd 8.1 multiplies by an estimate of the reciprocal
        if constexpr (sizeof(Number) == 4) return Pack(Batch(vdivq_f32(a.value.data, b.value.data)));
#endif
        return Pack(a.value / b.value);
    }
    friend Pack operator+(Pack a) { return a; }

    // Flips the sign bit: xsimd 8.1 has 0 - a for AVX-512, which loses the sign of zero.
    friend Pack operator-(Pack a) { return Pack(a.value ^ Batch(Number(-0.0))); }

    friend Mask operator<(Pack a, Pack b) { return {a.value < b.value}; }
    friend Mask operator>(Pack a, Pack b) { return {a.value > b.value}; }
    friend Mask operator<=(Pack a, Pack b) { return {a.value <= b.value}; }
    friend Mask operator>=(Pack a, Pack b) { return {a.value >= b.value}; }
    friend Mask operator==(Pack a, Pack b) { return {a.value == b.value}; }
    friend Mask operator!=(Pack a, Pack b) { return !(a == b); }

    /// Where a magnitude, 0 or above, is below a bound, which NaN is not: compares bits, as the scalar lane
    /// does.
    friend Mask is_below(Pack magnitude, Pack bound)
    {
        if constexpr (finite_math_only) {
            using Integer = std::conditional_t<sizeof(Number) == 4, std::int32_t, std::int64_t>;
            using Integers = xsimd::batch<Integer, Arch>;
            using Register = typename Integers::register_type;
            auto const bits = [](Pack x) {
                Integers const all(firn::detail::opaque(std::bit_cast<Register>(x.value.data)));
                return all & Integers(std::numeric_limits<Integer>::max());
            };
            auto const is_less = bits(magnitude) < bits(bound);
            return {typename Mask::Batch(std::bit_cast<typename Mask::Batch::register_type>(is_less.data))};
        }
        else
            return magnitude < bound;
    }

    friend Pack select(Mask condition, Pack if_true, Pack if_false)
    {
        return Pack(xsimd::select(condition.value, if_true.value, if_false.value));
    }

    // NaN and signed zeros come out as in the scalar lane. On x86 the order of the arguments ensures that;
    // NEON has a rule of its own.
#if defined(__ARM_NEON)
    friend Pack min(Pack a, Pack b) { return select(b < a, b, a); }
    friend Pack max(Pack a, Pack b) { return select(a < b, b, a); }
#else
    friend Pack min(Pack a, Pack b) { return Pack(xsimd::min(b.value, a.value)); }
    friend Pack max(Pack a, Pack b) { return Pack(xsimd::max(b.value, a.value)); }
#endif

    friend Pack abs(Pack a) { return Pack(xsimd::abs(a.value)); }
    friend Pack sqrt(Pack a)
    {
#if defined(__aarch64__) // its root, too, is a refined estimate
        if constexpr (sizeof(Number) == 4) return Pack(Batch(vsqrtq_f32(a.value.data)));
#endif
        return Pack(xsimd::sqrt(a.value));
    }
#if defined(FIRN_FUNCTIONS_BY_NUMBER)
    friend Pack floor(Pack a)
    {
        return by_number(a, [](Number x) { return std::floor(x); });
    }
    friend Pack exp(Pack a)
    {
        return by_number(a, [](Number x) { return std::exp(x); });
    }
    friend Pack log(Pack a)
    {
        return by_number(a, [](Number x) { return std::log(x); });
    }
#else
    friend Pack floor(Pack a) { return Pack(xsimd::floor(a.value)); }

    /// To 2 ulp; results below the smallest normal number are 0, those within a factor 1.5 of the largest, ∞.
    friend Pack exp(Pack a) { return Pack(xsimd::exp(a.value)); }

    /// To 1 ulp; −∞ for 0, NaN for negative numbers.
    friend Pack log(Pack a)
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

    friend Pack inverse_sqrt(Pack a) { return inverse_sqrt_of(a); }

    /// The largest of the numbers; NaN if one of them is.
    friend Number largest(Pack a)
    {
        if (any(a != a)) return std::numeric_limits<Number>::quiet_NaN();
        alignas(64) Number lanes[std::size_t(width)];
        a.value.store_aligned(lanes);
        for (int half = width / 2; half > 0; half /= 2) {
            for (int i = 0; i < half; ++i) lanes[i] = lanes[i] < lanes[i + half] ? lanes[i + half] : lanes[i];
        }
        return lanes[0];
    }

private:
#if defined(FIRN_FUNCTIONS_BY_NUMBER)
    template <class Function>
    static Pack by_number(Pack x, Function const& function)
    {
        Number lanes[width];
        x.store(lanes);
        for (Number& lane : lanes) lane = function(lane);
        return load(lanes);
    }
#endif

#if defined(__AVX2__) && !defined(__AVX512VL__)
    static constexpr int words = sizeof(Number) / 4; ///< of 32 bits in a lane
    static constexpr bool is_eight_words = width * words == 8;

    __m256 as_words() const
    {
        if constexpr (words == 1)
            return value.data;
        else
            return _mm256_castpd_ps(value.data);
    }
    static Pack of_words(__m256 all)
    {
        if constexpr (words == 1)
            return Pack(Batch(all));
        else
            return Pack(Batch(_mm256_castps_pd(all)));
    }
#endif

    template <int... place, int first>
    static Pack window_of(Pack low, Pack high, std::integer_sequence<int, place...>,
                          std::integral_constant<int, first>)
    {
        return Pack(Batch(__builtin_shufflevector(low.value.data, high.value.data, (first + place)...)));
    }

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

    /// 1/√x to 1.5 ulp: with y the estimate and e = 1 − x y², 1/√x = y (1 + e/2 + 3 e²/8 + …).
    static Pack inverse_sqrt_of(Pack x)
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
};

/// Whether one instruction can permute the numbers of a pack.
template <class Pack>
inline constexpr bool has_permutation = [] {
    [[maybe_unused]] constexpr std::size_t bytes = Pack::width * sizeof(typename Pack::Number);
#if defined(__AVX512VL__)
    return bytes >= 32;
#elif defined(__AVX2__)
    return bytes == 32;
#else
    return false;
#endif
}();

#if defined(__AVX2__) && !defined(__AVX512VL__)
/// The words of 32 bits that make up lanes of 64.
inline __m256i words_of_lanes(__m128i lanes)
{
    __m256i const first = _mm256_slli_epi64(_mm256_cvtepu32_epi64(lanes), 1);
    return _mm256_or_si256(first, _mm256_slli_epi64(_mm256_add_epi64(first, _mm256_set1_epi64x(1)), 32));
}
#endif

/// Loads one number per lane from places of an array that mostly lie in runs, possibly with gaps: a few
/// windows of two packs each, permuted. Reads up to two packs beyond the places (see Array::padding).
template <class Pack>
class RunsOfPlaces
{
    using Number = typename Pack::Number;
    using Mask = typename Pack::Mask;
    static constexpr int width = Pack::width;

public:
    /// `places` must outlive this object's loads.
    void follow(std::uint32_t const (&places)[std::size_t(width)])
    {
        places_ = places;
#if defined(__AVX512VL__) || defined(__AVX2__)
        if constexpr (has_permutation<Pack>) return find_windows();
#endif
        in_order_ = true;
        for (int l = 0; l < width; ++l) in_order_ &= places[l] == places[0] + std::uint32_t(l);
    }

    Pack load(Number const* array) const
    {
        if (in_order_) return Pack::load(array + places_[0]);
        if constexpr (has_permutation<Pack>) {
            Pack result = windows_ > 0 ? permuted(array + window_[0]) : Pack(Number(0));
            FIRN_KEEP_LOOP
            for (int w = 1; w < windows_; ++w)
                result = select(mask_[w], permuted(array + window_[w]), result);
            FIRN_KEEP_LOOP
            for (int w = width - 1; w >= width - singles_; --w)
                result = select(mask_[w], Pack(one_of(array, window_[w])), result);
            return result;
        }
        else {
            Number values[std::size_t(width)];
            for (int l = 0; l < width; ++l) values[l] = one_of(array, places_[l]);
            return Pack::load(values);
        }
    }

private:
    static Number one_of(Number const* array, std::uint32_t place)
    {
        Number bits; // of a number, or of an integer
        std::memcpy(&bits, array + place, sizeof bits);
        return bits;
    }

    std::uint32_t const* places_ = nullptr;
    bool in_order_ = false;

    int windows_ = 0, singles_ = 0;
    std::uint32_t window_[std::size_t(width)];
    Mask mask_[std::size_t(width)];

    /// Adds windows until they cover all lanes; `lay(window, remaining lanes)` returns the lanes that a
    /// window covers.
    template <class Lay>
    void cover(Lay const& lay)
    {
        windows_ = singles_ = 0;
        for (std::uint64_t rest = (std::uint64_t{1} << width) - 1; rest != 0;) {
            auto const place = places_[std::countr_zero(rest)];
            std::uint32_t const window = place > width / 2 ? place - width / 2 : 0;
            std::uint64_t const here = lay(window, rest);
            bool const is_single = (here & (here - 1)) == 0;
            int const w = is_single ? width - ++singles_ : windows_++;
            window_[w] = is_single ? place : window;
            mask_[w] = Mask::from_bits(here);
            rest &= ~here;
        }
    }

#if defined(__AVX512VL__)
    using Integer = std::conditional_t<sizeof(Number) == 4, std::int32_t, std::int64_t>;
    using Steps = typename xsimd::batch<Integer, typename Pack::Arch>::register_type;
    Steps steps_; ///< from the lane's window to its place

    void find_windows()
    {
        std::uint32_t const first = places_[0];
        if constexpr (width == 16) {
            __m512i const places = _mm512_loadu_si512(places_);
            __m512i const counted = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
            in_order_ =
                _mm512_cmpeq_epi32_mask(_mm512_sub_epi32(places, _mm512_set1_epi32(static_cast<int>(first))),
                                        counted) == 0xffff;
            if (in_order_) return;
            __m512i steps = _mm512_setzero_si512();
            cover([&](std::uint32_t window, std::uint64_t rest) {
                __m512i const step = _mm512_sub_epi32(places, _mm512_set1_epi32(static_cast<int>(window)));
                auto const here = _mm512_cmplt_epu32_mask(step, _mm512_set1_epi32(2 * width)) & rest;
                steps = _mm512_mask_mov_epi32(steps, static_cast<__mmask16>(here), step);
                return here;
            });
            steps_ = steps;
        }
        else {
            __m256i const places = load_places();
            __m256i const counted = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            constexpr unsigned all = (1u << width) - 1;
            in_order_ = (_mm256_cmpeq_epi32_mask(
                             _mm256_sub_epi32(places, _mm256_set1_epi32(static_cast<int>(first))), counted) &
                         all) == all;
            if (in_order_) return;
            __m256i steps = _mm256_setzero_si256();
            cover([&](std::uint32_t window, std::uint64_t rest) {
                __m256i const step = _mm256_sub_epi32(places, _mm256_set1_epi32(static_cast<int>(window)));
                auto const here = _mm256_cmplt_epu32_mask(step, _mm256_set1_epi32(2 * width)) & rest;
                steps = _mm256_mask_mov_epi32(steps, static_cast<__mmask8>(here), step);
                return here;
            });
            if constexpr (sizeof(Number) == 4)
                steps_ = steps;
            else if constexpr (width == 8)
                steps_ = _mm512_cvtepu32_epi64(steps);
            else
                steps_ = _mm256_cvtepu32_epi64(_mm256_castsi256_si128(steps));
        }
    }

    Pack permuted(Number const* from) const
    {
        auto const low = Pack::load(from).value.data, high = Pack::load(from + width).value.data;
        using Batch = typename Pack::Batch;
        if constexpr (sizeof(Number) == 4 && width == 16)
            return Pack(Batch(_mm512_permutex2var_ps(low, steps_, high)));
        else if constexpr (sizeof(Number) == 4)
            return Pack(Batch(_mm256_permutex2var_ps(low, steps_, high)));
        else if constexpr (width == 8)
            return Pack(Batch(_mm512_permutex2var_pd(low, steps_, high)));
        else
            return Pack(Batch(_mm256_permutex2var_pd(low, steps_, high)));
    }
#elif defined(__AVX2__)
    __m256i steps_; ///< of words, from the lane's window to its place

    void find_windows()
    {
        __m256i const places = load_places();
        __m256i const counted = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        in_order_ = lanes_of(_mm256_cmpeq_epi32(from_window(places, places_[0]), counted)) == all;
        if (in_order_) return;
        __m256i steps = _mm256_setzero_si256();
        cover([&](std::uint32_t window, std::uint64_t rest) {
            __m256i const step = from_window(places, window);
            __m256i const beyond = _mm256_and_si256(step, _mm256_set1_epi32(-2 * width));
            auto const here = lanes_of(_mm256_cmpeq_epi32(beyond, _mm256_setzero_si256())) & rest;
            __m256i const bit = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            __m256i const lanes = _mm256_and_si256(_mm256_set1_epi32(static_cast<int>(here)), bit);
            steps = _mm256_blendv_epi8(steps, step, _mm256_cmpeq_epi32(lanes, bit));
            return here;
        });
        if constexpr (sizeof(Number) == 4)
            steps_ = steps;
        else
            steps_ = words_of_lanes(_mm256_castsi256_si128(steps));
    }

    static constexpr std::uint64_t all = (1u << width) - 1;
    static __m256i from_window(__m256i places, std::uint32_t window)
    {
        return _mm256_sub_epi32(places, _mm256_set1_epi32(static_cast<int>(window)));
    }
    static std::uint64_t lanes_of(__m256i words)
    {
        return static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(words))) & all;
    }

    Pack permuted(Number const* from) const
    {
        __m256 const low = _mm256_permutevar8x32_ps(load_words(from), steps_);
        __m256 const high = _mm256_permutevar8x32_ps(load_words(from + width), steps_);
        // a step of 8 or more leads into the second register: shifted, its bit 3 becomes the sign
        __m256 const found = _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32(steps_, 28)));
        using Batch = typename Pack::Batch;
        if constexpr (sizeof(Number) == 4)
            return Pack(Batch(found));
        else
            return Pack(Batch(_mm256_castps_pd(found)));
    }
#endif

#if defined(__AVX2__)
    __m256i load_places() const
    {
        if constexpr (width == 8)
            return _mm256_loadu_si256(reinterpret_cast<__m256i const*>(places_));
        else
            return _mm256_castsi128_si256(_mm_loadu_si128(reinterpret_cast<__m128i const*>(places_)));
    }
#endif
};

/// Permutes the lanes of packs; a lane may go to several places.
template <class Pack>
class LanesInOrder
{
    using Number = typename Pack::Number;
    using Batch = typename Pack::Batch;
    static constexpr int width = Pack::width;

public:
    /// Whether one instruction can do it.
    static constexpr bool is_fast = has_permutation<Pack>;

    /// Lane l of the result will be lane from[l].
    void follow(std::uint32_t const* from)
    {
#if defined(__AVX512VL__)
        if constexpr (width == 16) {
            from_ = _mm512_loadu_si512(from);
            return;
        }
        else if constexpr (is_fast && width == 8) {
            auto const lanes = _mm256_loadu_si256(reinterpret_cast<__m256i const*>(from));
            if constexpr (sizeof(Number) == 4)
                from_ = lanes;
            else
                from_ = _mm512_cvtepu32_epi64(lanes);
            return;
        }
        else if constexpr (is_fast) {
            from_ = _mm256_cvtepu32_epi64(_mm_loadu_si128(reinterpret_cast<__m128i const*>(from)));
            return;
        }
#elif defined(__AVX2__)
        if constexpr (is_fast && width == 8) {
            from_ = _mm256_loadu_si256(reinterpret_cast<__m256i const*>(from));
            return;
        }
        else if constexpr (is_fast) {
            from_ = words_of_lanes(_mm_loadu_si128(reinterpret_cast<__m128i const*>(from)));
            return;
        }
#endif
        std::memcpy(&from_, from, sizeof from_);
    }

    Pack operator()(Pack const& lanes) const
    {
#if defined(__AVX512VL__)
        if constexpr (width == 16)
            return Pack(Batch(_mm512_permutexvar_ps(from_, lanes.value.data)));
        else if constexpr (is_fast && sizeof(Number) == 4)
            return Pack(Batch(_mm256_permutexvar_ps(from_, lanes.value.data)));
        else if constexpr (is_fast && width == 8)
            return Pack(Batch(_mm512_permutexvar_pd(from_, lanes.value.data)));
        else if constexpr (is_fast)
            return Pack(Batch(_mm256_permutexvar_pd(from_, lanes.value.data)));
#elif defined(__AVX2__)
        if constexpr (is_fast && sizeof(Number) == 4)
            return Pack(Batch(_mm256_permutevar8x32_ps(lanes.value.data, from_)));
        else if constexpr (is_fast)
            return Pack(
                Batch(_mm256_castps_pd(_mm256_permutevar8x32_ps(_mm256_castpd_ps(lanes.value.data), from_))));
#endif
        Number values[std::size_t(width)], moved[std::size_t(width)];
        std::uint32_t from[std::size_t(width)];
        std::memcpy(from, &from_, sizeof from);
        lanes.store(values);
        for (int l = 0; l < width; ++l) moved[l] = values[from[l]];
        return Pack::load(moved);
    }

private:
    static auto places()
    {
        if constexpr (is_fast) {
            using Integer = std::conditional_t<sizeof(Number) == 4, std::int32_t, std::int64_t>;
            return typename xsimd::batch<Integer, typename Pack::Arch>::register_type{};
        }
        else
            return std::array<std::uint32_t, std::size_t(width)>{};
    }
    decltype(places()) from_;
};

#pragma GCC diagnostic pop

namespace chosen
{

// For AVX-512 BW xsimd adds only integers of 8 and 16 bits, and 8.1 has an error there without optimisation.
template <class Arch>
using WithoutShortIntegers =
    std::conditional_t<std::derived_from<Arch, xsimd::avx512dq>, xsimd::avx512dq, Arch>;

template <class Number, int width, class Architectures>
struct ArchOfWidth
{
    static_assert(width < 0, "these compile flags give no pack of this width: 8 floats or 4 doubles need "
                             "AVX, twice as many AVX-512");
};

template <class Number, int width, class First, class... Others>
struct ArchOfWidth<Number, width, xsimd::arch_list<First, Others...>>
{
    static constexpr auto find()
    {
        if constexpr (xsimd::batch<Number, First>::size == width)
            return WithoutShortIntegers<First>{};
        else
            return ArchOfWidth<Number, width, xsimd::arch_list<Others...>>::find();
    }
};

} // namespace chosen

/// The widest pack that the compile flags allow.
template <class Number>
using NativePack = Pack<Number, chosen::WithoutShortIntegers<xsimd::default_arch>>;

/// The pack of `width` numbers with the best instructions that the compile flags allow: with AVX-512, eight
/// floats are PackOf<float, 8>. Narrow packs waste fewer lanes where cells are filled unevenly.
template <class Number, int width>
using PackOf =
    Pack<Number, decltype(chosen::ArchOfWidth<Number, width, xsimd::supported_architectures>::find())>;

/// The default lane type.
template <class Number>
using NativeLane = NativePack<Number>;

#else

/// The default lane type without xsimd: one number at a time.
template <class Number>
using NativeLane = Number;

// Defined for packs only.
template <class Pack>
class RunsOfPlaces;
template <class Pack>
class LanesInOrder;

#endif

/// The first `count` integers, and the last of them again in each lane beyond; reads nothing behind them.
/// Stored whole where possible, as it is loaded next: two stores would have to reach the cache before they
/// could be loaded into one register.
template <int lanes>
void copy_first(std::uint32_t const* from, int count, std::uint32_t (&to)[std::size_t(lanes)])
{
    std::uint32_t const last = from[count - 1];
#if defined(__AVX512VL__) && defined(FIRN_HAS_XSIMD)
    auto const first = (1u << count) - 1;
    if constexpr (lanes == 16)
        return _mm512_storeu_si512(to, _mm512_mask_loadu_epi32(_mm512_set1_epi32(static_cast<int>(last)),
                                                               static_cast<__mmask16>(first), from));
    if constexpr (lanes == 8)
        return _mm256_storeu_si256(reinterpret_cast<__m256i*>(to),
                                   _mm256_mask_loadu_epi32(_mm256_set1_epi32(static_cast<int>(last)),
                                                           static_cast<__mmask8>(first), from));
#endif
    for (int l = 0; l < lanes; ++l) to[l] = l < count ? from[l] : last;
}

/// The integers from `first` on, also stored whole.
template <int lanes>
void count_up(std::uint32_t first, std::uint32_t (&to)[std::size_t(lanes)])
{
#if defined(__AVX512VL__) && defined(FIRN_HAS_XSIMD)
    if constexpr (lanes == 16)
        return _mm512_storeu_si512(
            to, _mm512_add_epi32(_mm512_set1_epi32(static_cast<int>(first)),
                                 _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)));
#endif
    for (int l = 0; l < lanes; ++l) to[l] = first + static_cast<std::uint32_t>(l);
}

/// One bit for each of `lanes` counts that is above `rank`.
template <int lanes>
std::uint64_t lanes_above(std::uint32_t const* counts, std::uint32_t rank)
{
#if defined(__AVX512VL__) && defined(FIRN_HAS_XSIMD)
    if constexpr (lanes == 16)
        return number_of(
            _mm512_cmpgt_epu32_mask(_mm512_loadu_si512(counts), _mm512_set1_epi32(static_cast<int>(rank))));
    if constexpr (lanes == 8)
        return number_of(_mm256_cmpgt_epu32_mask(_mm256_loadu_si256(reinterpret_cast<__m256i const*>(counts)),
                                                 _mm256_set1_epi32(static_cast<int>(rank))));
#elif defined(__AVX2__) && defined(FIRN_HAS_XSIMD)
    // `counts` > `rank` as unsigned numbers: at least rank + 1
    if constexpr (lanes == 8) {
        __m256i const all = _mm256_loadu_si256(reinterpret_cast<__m256i const*>(counts));
        __m256i const more = _mm256_max_epu32(all, _mm256_set1_epi32(static_cast<int>(rank + 1)));
        return static_cast<unsigned>(_mm256_movemask_ps(_mm256_castsi256_ps(_mm256_cmpeq_epi32(all, more))));
    }
    if constexpr (lanes == 4) {
        __m128i const all = _mm_loadu_si128(reinterpret_cast<__m128i const*>(counts));
        __m128i const more = _mm_max_epu32(all, _mm_set1_epi32(static_cast<int>(rank + 1)));
        return static_cast<unsigned>(_mm_movemask_ps(_mm_castsi128_ps(_mm_cmpeq_epi32(all, more))));
    }
#endif
    std::uint64_t pattern = 0;
    for (int l = 0; l < lanes; ++l) pattern |= std::uint64_t(counts[l] > rank) << l;
    return pattern;
}

/// One bit for each of `lanes` counts that is above its `other`.
template <int lanes>
std::uint64_t lanes_above(std::uint32_t const* counts, std::uint32_t const* other)
{
#if defined(__AVX512VL__) && defined(FIRN_HAS_XSIMD)
    if constexpr (lanes == 16)
        return number_of(_mm512_cmpgt_epu32_mask(_mm512_loadu_si512(counts), _mm512_loadu_si512(other)));
    if constexpr (lanes == 8)
        return number_of(
            _mm256_cmpgt_epu32_mask(_mm256_loadu_si256(reinterpret_cast<__m256i const*>(counts)),
                                    _mm256_loadu_si256(reinterpret_cast<__m256i const*>(other))));
#endif
    std::uint64_t pattern = 0;
    for (int l = 0; l < lanes; ++l) pattern |= std::uint64_t(counts[l] > other[l]) << l;
    return pattern;
}

/// The largest of `lanes` counts. A plain loop, because compilers do not vectorise std::max_element.
template <int lanes>
std::uint32_t most_of(std::uint32_t const* counts)
{
    std::uint32_t most = 0;
    for (int l = 0; l < lanes; ++l) most = counts[l] > most ? counts[l] : most;
    return most;
}

/// Expands consecutive integers to the lanes of the pattern; the other places are undefined afterwards. Reads
/// up to `lanes` integers.
template <int lanes>
void expand(std::uint32_t const* from, std::uint64_t pattern, std::uint32_t* to)
{
#if defined(__AVX512VL__) && defined(FIRN_HAS_XSIMD)
    if constexpr (lanes == 16)
        return _mm512_storeu_si512(
            to, _mm512_maskz_expand_epi32(static_cast<__mmask16>(pattern), _mm512_loadu_si512(from)));
    if constexpr (lanes == 8)
        return _mm256_storeu_si256(
            reinterpret_cast<__m256i*>(to),
            _mm256_maskz_expand_epi32(static_cast<__mmask8>(pattern),
                                      _mm256_loadu_si256(reinterpret_cast<__m256i const*>(from))));
#elif defined(__AVX2__) && defined(FIRN_HAS_XSIMD)
    if constexpr (lanes == 8)
        return store_words(moved(load_words(from), words_by_pattern<1>.apart[pattern]), to);
#endif
    for (; pattern != 0; pattern &= pattern - 1) to[std::countr_zero(pattern)] = *from++;
}

/// The reverse: writes the integers in the lanes of the pattern side by side, and nothing beyond.
template <int lanes>
void compress(std::uint32_t const* from, std::uint64_t pattern, std::uint32_t* to)
{
#if defined(__AVX512VL__) && defined(FIRN_HAS_XSIMD)
    // Masked stores: compressing directly into memory is slow on some processors.
    auto const together = (std::uint64_t{1} << std::popcount(pattern)) - 1;
    if constexpr (lanes == 16)
        return _mm512_mask_storeu_epi32(
            to, static_cast<__mmask16>(together),
            _mm512_maskz_compress_epi32(static_cast<__mmask16>(pattern), _mm512_loadu_si512(from)));
    if constexpr (lanes == 8)
        return _mm256_mask_storeu_epi32(
            to, static_cast<__mmask8>(together),
            _mm256_maskz_compress_epi32(static_cast<__mmask8>(pattern),
                                        _mm256_loadu_si256(reinterpret_cast<__m256i const*>(from))));
#elif defined(__AVX2__) && defined(FIRN_HAS_XSIMD)
    if constexpr (lanes == 8) {
        __m256 const together = moved(load_words(from), words_by_pattern<1>.together[pattern]);
        return store_first_words(together, std::popcount(pattern), to);
    }
#endif
    for (; pattern != 0; pattern &= pattern - 1) *to++ = from[std::countr_zero(pattern)];
}

} // inline namespace of the instruction set
} // namespace firn::openmp

#if defined(FIRN_HAS_XSIMD)

template <class Number, class Arch>
struct firn::LaneTraits<firn::openmp::Pack<Number, Arch>>
{
    using Scalar = Number;
    using Mask = firn::openmp::PackMask<Number, Arch>;
    static constexpr int width = firn::openmp::Pack<Number, Arch>::width;

    static firn::openmp::Pack<Number, Arch> load(Number const* from)
    {
        return firn::openmp::Pack<Number, Arch>::load(from);
    }
    static void store(firn::openmp::Pack<Number, Arch> const& lane, Number* to) { lane.store(to); }
};

/// Lets a pack be the scalar of an Eigen matrix.
template <class Number, class Arch>
struct Eigen::NumTraits<firn::openmp::Pack<Number, Arch>>
    : Eigen::GenericNumTraits<firn::openmp::Pack<Number, Arch>>
{
    using Real = firn::openmp::Pack<Number, Arch>;
    using NonInteger = Real;
    using Nested = Real;
    using Literal = Real;
    enum
    {
        IsComplex = 0,
        IsInteger = 0,
        IsSigned = 1,
        RequireInitialization = 0,
        ReadCost = 1,
        AddCost = 1,
        MulCost = 1
    };
    static Real epsilon() { return Eigen::NumTraits<Number>::epsilon(); }
    static Real dummy_precision() { return Eigen::NumTraits<Number>::dummy_precision(); }
    static Real highest() { return Eigen::NumTraits<Number>::highest(); }
    static Real lowest() { return Eigen::NumTraits<Number>::lowest(); }
};

#endif

#include <firn/openmp/functions.hpp> // wherever packs are
#include <firn/openmp/pack_vectors.hpp>
