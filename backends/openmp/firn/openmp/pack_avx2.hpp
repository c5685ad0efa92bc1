// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/instruction_set.hpp>

#include <array>
#include <cstddef>
#include <cstring>

// Registers of AVX2 as eight words of 32 bits: how they are permuted, and loaded and stored in part.
#if defined(FIRN_HAS_XSIMD) && defined(__AVX2__) && !defined(__AVX512VL__)

namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

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

/// The words of 32 bits that make up lanes of 64.
inline __m256i words_of_lanes(__m128i lanes)
{
    __m256i const first = _mm256_slli_epi64(_mm256_cvtepu32_epi64(lanes), 1);
    return _mm256_or_si256(first, _mm256_slli_epi64(_mm256_add_epi64(first, _mm256_set1_epi64x(1)), 32));
}

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp

#endif
