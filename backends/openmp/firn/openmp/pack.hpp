// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/instruction_set.hpp>
#include <firn/openmp/pack_avx2.hpp>
#include <firn/openmp/pack_functions.hpp>
#include <firn/openmp/pack_mask.hpp>

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>

#if defined(FIRN_HAS_XSIMD)

namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

// g++ 12 mistakes the "undefined" registers inside its own AVX-512 intrinsics for errors (its bug 105593).
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

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
    friend Pack floor(Pack a) { return PackFunctions<Pack>::floor(a); }
    friend Pack exp(Pack a) { return PackFunctions<Pack>::exp(a); }
    friend Pack log(Pack a) { return PackFunctions<Pack>::log(a); }
    friend Pack inverse_sqrt(Pack a) { return PackFunctions<Pack>::inverse_sqrt(a); }

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
};

#pragma GCC diagnostic pop

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp

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

#endif

#include <firn/openmp/pack_vectors.hpp> // wherever packs are
