// SPDX-License-Identifier: MIT
#pragma once

#include "support/test_lane.hpp"

#if __has_include(<firn/openmp/native_lane.hpp>)
#include <firn/openmp/native_lane.hpp>
#endif

#include <tuple>

namespace firn::test
{

// Tests of functions over lanes are compiled for packs in the program `lanes`, and for the lanes that every
// user has in the program `math`. Without FIRN_TESTS_ALL `lanes` has both, which share what lanes do not
// change.
#if !__has_include(<firn/openmp/native_lane.hpp>) || !__has_include(<xsimd/xsimd.hpp>)
#if defined(FIRN_TESTS_ALL) || defined(__CUDACC__)
using LaneTypes = std::tuple<float, double, TestLane<float>, TestLane<double>>;
#else
using LaneTypes = std::tuple<double, TestLane<double>>;
#endif
#elif defined(__AVX512F__) && defined(FIRN_TESTS_ALL) // with those that a processor with AVX has
using LaneTypes = std::tuple<openmp::NativePack<float>, openmp::NativePack<double>, openmp::PackOf<float, 8>,
                             openmp::PackOf<double, 4>, openmp::PackOf<float, 4>, openmp::PackOf<double, 2>>;
#elif defined(__AVX__) && defined(FIRN_TESTS_ALL)
using LaneTypes = std::tuple<openmp::NativePack<float>, openmp::NativePack<double>, openmp::PackOf<float, 4>,
                             openmp::PackOf<double, 2>>;
#elif defined(FIRN_TESTS_ALL)
using LaneTypes = std::tuple<openmp::NativePack<float>, openmp::NativePack<double>>;
#elif defined(__AVX__) // of packs the widest and the narrowest, one of each precision
using LaneTypes = std::tuple<double, TestLane<double>, openmp::NativePack<float>, openmp::PackOf<double, 2>>;
#else
using LaneTypes = std::tuple<double, TestLane<double>, openmp::NativePack<float>, openmp::NativePack<double>>;
#endif

} // namespace firn::test
