// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <chrono>

namespace firn::openmp::detail
{

using Clock = std::chrono::steady_clock;

/// A thread that others wait for so long has lost its core: longer than a piece of work takes, and shorter
/// than the turn of another program.
inline constexpr Clock::duration stall = std::chrono::microseconds(400);

/// Whether a loop is worth while the threads that it has, learned from how long its leader waits for them.
///
/// Where other programs want the cores, a thread of a team loses its own in the middle of a piece of work for
/// some milliseconds, and the others wait for that piece: two threads are then slower than one. Large loops
/// bear it, since others do most of what that thread would have done.
class Efficiency
{
public:
    /// The share of what as many free cores would do below which threads that stall are left out.
    static constexpr double least = 0.55;

    /// A loop of so many threads is through. Its leader did this share of the work, (0, 1], and then waited
    /// for the others.
    void add(int threads, Clock::duration worked, Clock::duration waited, double share)
    {
        if (all_ > window * threads) alone_ *= 0.5, all_ *= 0.5; // what was long ago counts less
        // one thread would have taken as long for all as the leader did for its share
        alone_ += std::chrono::duration<double>(worked).count() / share;
        all_ += std::chrono::duration<double>(worked + waited).count() * threads;
    }
    bool is_low() const { return alone_ < least * all_; }
    /// Other threads are left from now on.
    void forget() { *this = {}; }

private:
    static constexpr double window = 4e-3; ///< of loops that are remembered [s]
    /// The time of one thread, and of all together [s]: until there have been loops, of some that went well.
    double alone_ = window, all_ = window;
};

/// When a thread that lost its core takes part again: once it had one for itself for some milliseconds, which
/// it tries after a pause. The pause doubles while that goes wrong.
class Bench
{
public:
    static constexpr Clock::duration shortest = std::chrono::milliseconds(5),
                                     longest = std::chrono::milliseconds(160);

    bool is_on() const { return is_on_; }
    /// The thread lost its core.
    void sit(Clock::time_point now)
    {
        pause_ = now - since_ > 8 * pause_ ? shortest : std::min(2 * pause_, longest);
        trial_ = now + pause_;
        is_on_ = true;
    }
    /// Whether it is to try now; the next trial is later.
    bool is_to_try(Clock::time_point now)
    {
        if (!is_on_ || now < trial_) return false;
        pause_ = std::min(2 * pause_, longest);
        trial_ = now + pause_;
        return true;
    }
    /// It had a core for itself.
    void leave(Clock::time_point now)
    {
        is_on_ = false;
        since_ = now;
    }

private:
    bool is_on_ = false;
    Clock::time_point trial_{}, since_{}; ///< when it tries next; when it left last
    Clock::duration pause_ = shortest;
};

/// Whether the calling thread has a core for itself: it is awake for some milliseconds and looks whether time
/// passes without it. (Turns of programs that share a core are 1.4 to 3 ms with Linux' scheduler of today.)
inline bool has_free_core()
{
    constexpr Clock::duration trial = std::chrono::milliseconds(4);
    auto const begin = Clock::now();
    for (auto before = begin;;) {
        auto const now = Clock::now();
        if (now - before > stall) return false;
        if (now - begin > trial) return true;
        before = now;
    }
}

} // namespace firn::openmp::detail
