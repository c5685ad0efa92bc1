// SPDX-License-Identifier: MIT
#pragma once

// Packs exist where xsimd is installed, unless FIRN_NO_XSIMD is defined.
#if !defined(FIRN_NO_XSIMD) && __has_include(<xsimd/xsimd.hpp>)
#if defined(__NVCC__)
#error "nvcc does not compile firn/openmp.hpp with xsimd: include it in a .cpp file."
#endif
#define FIRN_HAS_XSIMD
#include <xsimd/xsimd.hpp>
#endif

// Everything that runs on lanes is a template over a type of the namespace FIRN_INSTRUCTION_SET, so that its
// name is part of every symbol. Files of one program compiled for different processors then never share a
// function.
#if defined(__AVX512VL__) && defined(__AVX512DQ__) && defined(__AVX512BW__)
#define FIRN_INSTRUCTION_SET avx512
#elif defined(__AVX512F__)
#define FIRN_INSTRUCTION_SET avx512f
#elif defined(__AVX2__) && defined(__FMA__)
#define FIRN_INSTRUCTION_SET avx2_fma
#elif defined(__AVX2__)
#define FIRN_INSTRUCTION_SET avx2
#elif defined(__AVX__)
#define FIRN_INSTRUCTION_SET avx
#elif defined(__SSE4_2__)
#define FIRN_INSTRUCTION_SET sse4
#elif defined(__SSE2__)
#define FIRN_INSTRUCTION_SET sse2
#elif defined(__ARM_NEON)
#define FIRN_INSTRUCTION_SET neon
#else
#define FIRN_INSTRUCTION_SET plain
#endif
