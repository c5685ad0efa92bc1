// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/instruction_set.hpp>
#include <firn/openmp/pack.hpp>
#include <firn/openmp/pack_avx2.hpp>
#include <firn/openmp/permutation.hpp>
#include <firn/openmp/tuning.hpp>

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <type_traits>

namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

#if defined(FIRN_HAS_XSIMD)

// As in pack.hpp: warnings about g++ 12's own intrinsics.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
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

#pragma GCC diagnostic pop

#else

// Defined for packs only.
template <class Pack>
class RunsOfPlaces;

#endif

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp
