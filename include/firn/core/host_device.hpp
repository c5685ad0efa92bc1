// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/compiler.hpp>

#include <cstdint>

#if defined(__GNUC__) && !defined(__EXCEPTIONS) && !defined(__CUDACC__)
#error "firn: it throws errors, which -fno-exceptions forbids: compile without that flag."
#endif

// Defined in code that is compiled for a device.
#if defined(__CUDA_ARCH__)
#define FIRN_FOR_DEVICE
#endif

/// Marks functions that run on the host and on a device.
#if defined(__CUDACC__)
#define FIRN_HOST_DEVICE __host__ __device__
#else
#define FIRN_HOST_DEVICE
#endif

// Before a loop over the components of vectors and matrices: unrolls it, so that they are registers.
// Compilers do not where the body is long. The host's pass of nvcc has no such pragma.
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

// For a function that few particles need, in a loop that needs all of its registers: inlined, it would make
// every particle spill some.
#if defined(__CUDA_ARCH__)
#define FIRN_NOINLINE_ON_DEVICE __noinline__
#else
#define FIRN_NOINLINE_ON_DEVICE
#endif

// Before a loop over the nodes of a stencil. On a device arrays must be indexed by constants to be registers,
// and packs would run out of registers if the loop were unrolled for them.
#if defined(__CUDA_ARCH__)
#define FIRN_UNROLL_ON_DEVICE _Pragma("unroll")
#else
#define FIRN_UNROLL_ON_DEVICE
#endif

// Before a loop that is not to be unrolled on a device, where all turns at once would need too many
// registers: few particles need it, so arrays that its turns index may lie in memory.
#if defined(__CUDA_ARCH__)
#define FIRN_ROLLED_ON_DEVICE _Pragma("unroll 1")
#else
#define FIRN_ROLLED_ON_DEVICE
#endif

// For a function of the host outside the loops of a step, called at most once in it: compiled for size, which
// takes a compiler less time. With nvcc most of that time goes into the functions of the device.
#if defined(__GNUC__) && !defined(__CUDACC__)
#define FIRN_COLD [[gnu::cold]]
#else
#define FIRN_COLD
#endif

// For a function that loops over arrays and stores to what others point to: g++ 12 may find at -O1 that it
// stores nothing, since it takes an address that it has split into parts for null, and leaves calls out.
#if defined(__GNUC__) && !defined(__clang__) && !defined(__CUDACC__)
#define FIRN_OPAQUE [[gnu::noipa]]
#else
#define FIRN_OPAQUE
#endif

// Defined where a compiler has vectors of numbers of its own: four of them are a type.
#if defined(__GNUC__) && !defined(__CUDACC__)
#define FIRN_VECTOR_TYPES
#endif

namespace firn
{

/// Adds to a number to which several parts of a loop may add at the same time. Integers come to the same sum
/// in any order.
FIRN_HOST_DEVICE inline void add_in_any_order(std::int64_t& to, std::int64_t value)
{
#if defined(__CUDA_ARCH__)
    atomicAdd(reinterpret_cast<unsigned long long*>(&to), static_cast<unsigned long long>(value));
#else
    __atomic_fetch_add(&to, value, __ATOMIC_RELAXED);
#endif
}
/// The same where parts that a device runs together mostly add to the same number: by one addition for all.
FIRN_HOST_DEVICE inline void add_together_in_any_order(std::int64_t& to, std::int64_t value)
{
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 800
    auto all = static_cast<unsigned long long>(value);
    unsigned const parts = __activemask();
    int is_same = 0;
    __match_all_sync(parts, reinterpret_cast<unsigned long long>(&to), &is_same);
    if (is_same) { // 22 bits at a time, so that the sums of 32 parts have room
        unsigned const of_all[]{__reduce_add_sync(parts, static_cast<unsigned>(all) & 0x3fffff),
                                __reduce_add_sync(parts, static_cast<unsigned>(all >> 22) & 0x3fffff),
                                __reduce_add_sync(parts, static_cast<unsigned>(all >> 44))};
        unsigned lane = 0;
        asm("mov.u32 %0, %%laneid;" : "=r"(lane));
        if (lane + 1 != static_cast<unsigned>(__ffs(static_cast<int>(parts)))) return;
        all = of_all[0] + (static_cast<unsigned long long>(of_all[1]) << 22) +
              (static_cast<unsigned long long>(of_all[2]) << 44);
    }
    add_in_any_order(to, static_cast<std::int64_t>(all));
#else
    add_in_any_order(to, value);
#endif
}

/// The nearest whole number. Halves go away from zero, but on a device, which has one operation for it, to
/// the even one.
FIRN_HOST_DEVICE inline std::int32_t nearest_whole(float number)
{
#if defined(__CUDA_ARCH__)
    return __float2int_rn(number);
#else
    auto const whole = static_cast<std::int32_t>(number);
    float const rest = number - static_cast<float>(whole);
    return whole + (rest >= 0.5f) - (rest <= -0.5f);
#endif
}

/// A number that other parts of a loop may set at the same time.
FIRN_HOST_DEVICE inline std::uint32_t read_shared(std::uint32_t const& number)
{
#if defined(__CUDA_ARCH__)
    return *static_cast<std::uint32_t const volatile*>(&number);
#else
    return __atomic_load_n(&number, __ATOMIC_RELAXED);
#endif
}
/// Sets a number that other parts of a loop may set at the same time, to the same.
FIRN_HOST_DEVICE inline void write_shared(std::uint32_t& number, std::uint32_t value)
{
#if defined(__CUDA_ARCH__)
    *static_cast<std::uint32_t volatile*>(&number) = value;
#else
    __atomic_store_n(&number, value, __ATOMIC_RELAXED);
#endif
}

/// Sets a number that is 0 to another one, and returns whether it was 0: of several parts of a loop, for one.
FIRN_HOST_DEVICE inline bool claim(std::uint32_t& number, std::uint32_t value)
{
#if defined(__CUDA_ARCH__)
    return atomicCAS(&number, 0u, value) == 0;
#else
    std::uint32_t expected = 0;
    return __atomic_compare_exchange_n(&number, &expected, value, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
#endif
}

/// Counts up by so many, and returns the number before: each part of a loop gets others.
FIRN_HOST_DEVICE inline std::uint32_t next_number(std::uint32_t& count, std::uint32_t so_many = 1)
{
#if defined(__CUDA_ARCH__)
    return atomicAdd(&count, so_many);
#else
    return __atomic_fetch_add(&count, so_many, __ATOMIC_RELAXED);
#endif
}

/// The same where many parts of a loop count in one number, of which each must pass the same: those that a
/// device runs together ask once.
FIRN_HOST_DEVICE inline std::uint32_t next_number_of_all(std::uint32_t& count, std::uint32_t so_many = 1)
{
#if defined(__CUDA_ARCH__)
    unsigned const together = __activemask();
    int const leader = __ffs(static_cast<int>(together)) - 1,
              lane = static_cast<int>((threadIdx.x + blockDim.x * (threadIdx.y + blockDim.y * threadIdx.z)) %
                                      32);
    std::uint32_t before = 0, all = 0;
    for (unsigned rest = together; rest != 0; rest &= rest - 1) {
        int const of = __ffs(static_cast<int>(rest)) - 1;
        std::uint32_t const its = __shfl_sync(together, so_many, of);
        before += of < lane ? its : 0;
        all += its;
    }
    std::uint32_t first = 0;
    if (lane == leader) first = atomicAdd(&count, all);
    return __shfl_sync(together, first, leader) + before;
#else
    return next_number(count, so_many);
#endif
}

} // namespace firn
