// SPDX-License-Identifier: MIT
#pragma once

// Refuses compilers that cannot compile the library, each with one sentence. Define FIRN_ANY_COMPILER to try
// one that is not supported.
#if !defined(FIRN_ANY_COMPILER)
#if defined(_MSC_VER) && !defined(__clang__)
#error                                                                                                       \
    "firn: MSVC is not supported: compile with g++ 12, clang 16 or newer, or define FIRN_ANY_COMPILER to try."
#elif defined(__clang__) && __clang_major__ < 16
#error "firn: this clang is too old: it needs clang 16 or newer, or define FIRN_ANY_COMPILER to try."
#elif defined(__GNUC__) && !defined(__clang__) && __GNUC__ < 12
#error "firn: this g++ is too old: it needs g++ 12 or newer, or define FIRN_ANY_COMPILER to try."
#elif __cplusplus < 202002L
#error "firn: it is written in C++20: compile with -std=c++20 or newer."
#endif
#endif
