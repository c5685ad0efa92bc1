// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/instruction_set.hpp>
#include <firn/openmp/pack.hpp>
#include <firn/openmp/pack_avx2.hpp>

#include <array>
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

#else

// Defined for packs only.
template <class Pack>
class LanesInOrder;

#endif

} // namespace FIRN_INSTRUCTION_SET
} // namespace firn::openmp
