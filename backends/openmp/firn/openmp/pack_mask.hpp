// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/instruction_set.hpp>

#include <bit>
#include <concepts>
#include <cstddef>
#include <cstdint>

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

#pragma GCC diagnostic pop

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp

#endif
