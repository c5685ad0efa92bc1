// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/lanes.hpp>

#include <cmath>
#include <limits>

// The lanes of the backend: packs as wide as possible, or single numbers.
namespace firn::openmp
{

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
