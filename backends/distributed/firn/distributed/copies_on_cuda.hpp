// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/check.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

// Copies of memory that a device reaches, its own and that of others, in one loop.
namespace firn::distributed
{

namespace detail
{
struct CopiedPart
{
    std::byte* to;
    std::byte const* from;
    std::size_t bytes;
};
struct CopiedParts
{
    static constexpr unsigned most = 16;
    std::array<CopiedPart, most> of;
};

struct alignas(16) SixteenBytes
{
    std::uint64_t low, high;
};

/// Copies every `stride`th value from the one with number `first` on; returns how many bytes all of them
/// have.
template <class Value>
__device__ std::size_t copy_values(CopiedPart const& part, std::size_t first, std::size_t stride)
{
    std::size_t const count = part.bytes / sizeof(Value);
    auto const* const from = reinterpret_cast<Value const*>(part.from);
    auto* const to = reinterpret_cast<Value*>(part.to);
    for (std::size_t i = first; i < count; i += stride) to[i] = from[i];
    return count * sizeof(Value);
}

/// Each part has so many groups of threads, one part behind the other.
static __global__ void copy_reached(CopiedParts const parts, unsigned groups)
{
    CopiedPart part = parts.of[blockIdx.x / groups];
    std::size_t const first = std::size_t(blockIdx.x % groups) * blockDim.x + threadIdx.x,
                      stride = std::size_t(groups) * blockDim.x;
    auto const address =
        reinterpret_cast<std::uintptr_t>(part.to) | reinterpret_cast<std::uintptr_t>(part.from);
    std::size_t done = 0;
    if (address % sizeof(SixteenBytes) == 0)
        done = copy_values<SixteenBytes>(part, first, stride);
    else if (address % sizeof(std::uint32_t) == 0)
        done = copy_values<std::uint32_t>(part, first, stride);
    copy_values<std::byte>({part.to + done, part.from + done, part.bytes - done}, first, stride);
}
} // namespace detail

/// Collects copies for one loop, in a stream of the current device.
class CopiesOnDevice
{
public:
    explicit CopiesOnDevice(cuda::Queue const& queue) : queue_(queue) {}

    void add(std::byte* to, std::byte const* from, std::size_t bytes)
    {
        if (bytes == 0) return;
        parts_.of[count_++] = {to, from, bytes};
        most_bytes_ = std::max(most_bytes_, bytes);
        if (count_ == detail::CopiedParts::most) start();
    }
    /// Queues what has been added.
    void start()
    {
        constexpr unsigned threads = 256,
                           most_groups = 512; // memory of other devices is far: much is under way
        if (count_ > 0) {
            unsigned const groups =
                std::min(most_groups, cuda::groups_of(most_bytes_, threads * sizeof(detail::SixteenBytes)));
            cuda::launch_after("copy_reached", queue_, detail::copy_reached, groups * count_, threads, parts_,
                               groups);
        }
        count_ = 0;
        most_bytes_ = 0;
    }

private:
    cuda::Queue queue_;
    detail::CopiedParts parts_{};
    unsigned count_ = 0;
    std::size_t most_bytes_ = 0;
};

} // namespace firn::distributed
