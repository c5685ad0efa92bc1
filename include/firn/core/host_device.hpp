// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/compiler.hpp>

#if defined(__GNUC__) && !defined(__EXCEPTIONS) && !defined(__CUDACC__)
#error "firn: it throws errors, which -fno-exceptions forbids: compile without that flag."
#endif

// In what is compiled for a device.
#if defined(__CUDA_ARCH__)
#define FIRN_FOR_DEVICE
#endif

/// Marks what runs both on the host and on a device.
#if defined(__CUDACC__)
#define FIRN_HOST_DEVICE __host__ __device__
#else
#define FIRN_HOST_DEVICE
#endif

// Before a loop over the components of vectors and matrices: unrolled, so that they are registers. Compilers
// stop short of it where the body is long. (What nvcc hands on to the compiler of the host has none.)
#if defined(__CUDA_ARCH__)
#define FIRN_UNROLL _Pragma("unroll")
#elif defined(__CUDACC__)
#define FIRN_UNROLL
#elif defined(__clang__)
#define FIRN_UNROLL _Pragma("clang loop unroll(full)")
#elif defined(__GNUC__)
#define FIRN_UNROLL _Pragma("GCC unroll 16")
#else
#define FIRN_UNROLL
#endif

// For a function that few need, called in a loop that needs all of its registers: within it, it would have
// them spilt for everybody.
#if defined(__CUDA_ARCH__)
#define FIRN_NOINLINE_ON_DEVICE __noinline__
#else
#define FIRN_NOINLINE_ON_DEVICE
#endif

// Before a loop over the nodes of a stencil: a device has no memory near enough for arrays that are indexed
// by what is not known to the compiler, and packs would run out of registers.
#if defined(__CUDA_ARCH__)
#define FIRN_UNROLL_ON_DEVICE _Pragma("unroll")
#else
#define FIRN_UNROLL_ON_DEVICE
#endif

// Before a loop that is not to be unrolled on a device, where all turns at once would need too many
// registers: few need it, and arrays that its turns index may lie in memory.
#if defined(__CUDA_ARCH__)
#define FIRN_ROLLED_ON_DEVICE _Pragma("unroll 1")
#else
#define FIRN_ROLLED_ON_DEVICE
#endif

// For a function of the host outside the loops of a step, called once in it at most: to compile it for its
// size takes a compiler less time. (With nvcc that time is the device's functions'.)
#if defined(__GNUC__) && !defined(__CUDACC__)
#define FIRN_COLD [[gnu::cold]]
#else
#define FIRN_COLD
#endif
