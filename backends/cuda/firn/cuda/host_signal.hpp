// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/signal.hpp>

#include <chrono>
#include <cstdint>
#include <utility>

// How the host learns that queued loops have stopped or how far they are, and lets them work again.
namespace firn::cuda::detail
{

/// The host's side of a Signal: where it lies, and what the host does about it.
class HostSignal
{
public:
    explicit HostSignal(Queue queue) : queue_(queue), stopped_(queue), told_(queue) {}

    /// The signal as loops see it.
    Signal view()
    {
        if (stopped_.size() == 0) {
            OnDevice const here(queue_);
            stopped_.renew(Signal::count);
            stopped_.fill_bytes(0, Signal::count, 0);
            told_.as<Told>();
        }
        return std::as_const(*this).view();
    }
    Signal view() const ///< once the other one was called
    {
        return {const_cast<std::uint32_t*>(stopped_.data()), told_.get<Told>()};
    }

    /// The number of the next loop that finishes a step early.
    std::uint32_t next_number() { return early_ = early_ % (1u << 31) + 1; }

    /// Waits until at most two of the queued steps, those that finish early, are still to come. Returns false
    /// if steps have stopped, since what is queued behind that is queued in vain. Gives up after a hundredth
    /// of a second: steps are long, or a device has failed, which its next call reports.
    bool throttle() const
    {
        constexpr std::uint32_t few = 2;
        using Clock = std::chrono::steady_clock;
        auto const* const told = told_.get<Told>();
        auto const now = [](std::uint32_t const& word) { // the device writes it
            return *static_cast<std::uint32_t const volatile*>(&word);
        };
        Clock::time_point end{};
        for (unsigned tries = 1; now(told->stop.stopped) == 0; ++tries) {
            if (early_ - now(told->chosen) <= few) return true;
            if (tries % 1024 != 0) continue;
            if (tries == 1024) end = Clock::now() + std::chrono::milliseconds(10);
            if (Clock::now() >= end) return true;
        }
        return false;
    }

    /// Called when the host has waited: returns what it was told, and lets loops work again if they have
    /// stopped.
    Stop poll()
    {
        auto* const told = told_.as<Told>();
        told->chosen = early_; // stopped steps did not report it
        Stop const stop = told->stop;
        if (stop.stopped == 0) return stop;
        told->stop = {};
        stopped_.fill_bytes(0, Signal::count, 0);
        return stop;
    }

private:
    Queue queue_;
    std::uint32_t early_ = 0;      ///< number of the last loop that finishes a step early
    Array<std::uint32_t> stopped_; ///< whether loops have nothing to do until the host has polled
    HostMemory told_;              ///< why, and how far the device is
};

} // namespace firn::cuda::detail
