// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

// Elements of many arrays that are copied in one loop.
namespace firn::cuda::detail
{

/// Arrays that are copied at once, each from place to place in elements of its own size.
struct CopiedArrays
{
    static constexpr unsigned most = 32;
    struct Of
    {
        unsigned char const* from;
        unsigned char* to;
        std::uint32_t bytes; ///< of an element
    };
    Of of[most];
};

/// Which elements: listed ones, or as they come if there is no list.
struct CopiedPlaces
{
    std::uint32_t const *from, *to;
    std::uint32_t const* count; ///< null: all for which there are threads
    std::uint32_t most;
};

/// Copies an element of so many bytes from the place `from` of an array to the place `to` of another. All
/// elements are aligned for vectors of 16 bytes if they consist of these.
__device__ inline void copy_element(unsigned char const* array, std::size_t from, unsigned char* other,
                                    std::size_t to, std::uint32_t bytes)
{
    struct alignas(16) Some
    {
        std::uint32_t of[4];
    };
    auto const copy = [&]<class Word>(Word) {
        std::uint32_t const words = bytes / sizeof(Word);
        for (std::uint32_t w = 0; w < words; ++w)
            reinterpret_cast<Word*>(other)[to * words + w] =
                reinterpret_cast<Word const*>(array)[from * words + w];
    };
    if (bytes % sizeof(Some) == 0)
        copy(Some{});
    else if (bytes % 4 == 0)
        copy(std::uint32_t{});
    else
        copy(std::uint8_t{});
}

/// Copies elements of `count` arrays, with `groups` groups of threads for each, and calls `also(i)` for the
/// number of each element on as many groups more, if there are any.
template <class Also>
__global__ void copy_elements(CopiedArrays arrays, CopiedPlaces places, unsigned groups, unsigned count,
                              Also also)
{
    std::uint32_t const i = blockIdx.x % groups * blockDim.x + threadIdx.x, which = blockIdx.x / groups;
    if (i >= (places.count != nullptr ? *places.count : places.most)) return;
    if (which == count) {
        also(i);
        return;
    }
    CopiedArrays::Of const& array = arrays.of[which];
    copy_element(array.from, places.from != nullptr ? places.from[i] : i, array.to,
                 places.to != nullptr ? places.to[i] : i, array.bytes);
}

/// Does nothing for an element.
struct NothingAlso
{
    __device__ void operator()(std::uint32_t) const {}
};

} // namespace firn::cuda::detail
