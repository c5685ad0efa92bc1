// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/instruction_set.hpp>
#include <firn/openmp/pack.hpp>

#include <cmath>
#include <concepts>
#include <limits>
#include <type_traits>

// The lanes of the backend: packs as wide as possible, or single numbers.
namespace firn::openmp
{
inline namespace FIRN_INSTRUCTION_SET
{

#if defined(FIRN_HAS_XSIMD)

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

#endif

} // namespace FIRN_INSTRUCTION_SET

/// Lanes as wide as the compile flags allow.
struct NativeLanes
{
    template <class Number>
    using Lane = NativeLane<Number>;
};

/// One number at a time.
struct ScalarLanes
{
    template <class Number>
    using Lane = Number;
};

/// Whether exponentials, logarithms and roundings of packs are correct. xsimd's break under
/// -fassociative-math, and clang has no macro by which that flag could be refused.
template <class Number>
bool functions_hold()
{
    using Real = NativeLane<Number>;
    static bool const hold = [] {
        bool all = true;
        for (double const number : {0.3, 1.7, 5.7, 40.1}) {
            Number volatile const unknown = Number(number); // hidden from the compiler
            Number const x = unknown;
            auto const is = [&](Real lanes, Number should) {
                Number found[lane_width<Real>];
                LaneTraits<Real>::store(lanes, found);
                all = all && std::abs(found[0] - should) <=
                                 256 * std::numeric_limits<Number>::epsilon() * std::abs(should);
            };
            using firn::exp, firn::floor, firn::log;
            is(exp(Real(x)), std::exp(x));
            is(log(Real(x)), std::log(x));
            is(floor(Real(x)), std::floor(x));
        }
        return all;
    }();
    return hold;
}

} // namespace firn::openmp

#include <firn/openmp/pack_pow_sin_tanh.hpp> // wherever packs are
