// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/instruction_set.hpp>
#include <firn/openmp/pack_avx2.hpp>
#include <firn/openmp/pack_mask.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>

// Integers that say where items are, as many as there are lanes: compressed, expanded, counted, compared.
namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

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

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp
