// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>

#include <chrono>
#include <cstdint>

namespace firn::cuda
{

/// A number that loops write, and at which the host looks while they are at work.
class WatchedNumber
{
public:
    template <class Backend>
    explicit WatchedNumber(Backend const& backend) : queue_(backend.queue()), number_(backend.queue())
    {}

    /// Sets it to 0. No loop that writes it may be at work.
    void begin() { *static_cast<std::uint32_t volatile*>(number_.as<std::uint32_t>()) = 0; }
    /// Where loops write it, after begin().
    std::uint32_t* there() const { return number_.get<std::uint32_t>(); }

    /// The number, once `enough(number)` is true. After a hundredth of a second waits for all loops instead:
    /// they are long, or the device has failed, which is reported.
    template <class Enough>
    std::uint32_t look(Enough const& enough) const
    {
        using Clock = std::chrono::steady_clock;
        auto const now = [&] { return *static_cast<std::uint32_t const volatile*>(there()); };
        Clock::time_point end{};
        for (unsigned tries = 1;; ++tries) {
            if (std::uint32_t const number = now(); enough(number)) return number;
            if (tries % 1024 != 0) continue;
            if (tries == 1024) end = Clock::now() + std::chrono::milliseconds(10);
            if (Clock::now() < end) continue;
            queue_.wait();
            return now();
        }
    }

private:
    Queue queue_;
    HostMemory number_;
};

} // namespace firn::cuda
