// SPDX-License-Identifier: MIT
#pragma once

// For a program of its own: here `new` fails when it is told to.
#include <atomic>
#include <cstdlib>
#include <new>

namespace
{
std::atomic<int> allowed = -1; ///< so many more may succeed; below 0: all

void* allocated_or_null(std::size_t bytes, std::size_t alignment)
{
    for (int left = allowed; left >= 0;) {
        if (left == 0) return nullptr;
        if (allowed.compare_exchange_weak(left, left - 1)) break;
    }
    return std::aligned_alloc(alignment, (bytes / alignment + 1) * alignment);
}
void* allocated(std::size_t bytes, std::size_t alignment)
{
    void* const memory = allocated_or_null(bytes, alignment);
    if (!memory) throw std::bad_alloc{};
    return memory;
}
} // namespace

void* operator new(std::size_t bytes) { return allocated(bytes, 16); }
void* operator new(std::size_t bytes, std::nothrow_t const&) noexcept { return allocated_or_null(bytes, 16); }
void* operator new(std::size_t bytes, std::align_val_t alignment)
{
    return allocated(bytes, static_cast<std::size_t>(alignment));
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::align_val_t) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t, std::align_val_t) noexcept { std::free(memory); }
