// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <omp.h>

namespace firn::openmp::detail
{

/// The time since some moment in the past [s]. It is OpenMP's, since <chrono> takes long to compile.
inline double clock_time() { return omp_get_wtime(); }

/// A thread that others wait for longer than this [s] has lost its core. It is longer than a piece of work
/// takes, and shorter than the time slice of another program.
inline constexpr double stall = 400e-6;

/// Whether a loop gains from its threads, learned from how long its leader waits for the others.
///
/// When other programs want the cores, a thread of the team loses its core for some milliseconds in the
/// middle of a piece of work, and the others wait for that piece: two threads are then slower than one. Large
/// loops tolerate it, since others do most of what that thread would have done.
class Efficiency
{
public:
    /// Threads that stall are left out below this share of the work that as many free cores would do.
    static constexpr double least = 0.55;

    /// Records a finished loop of so many threads. Its leader did this share of the work, (0, 1], and then
    /// waited for the others. Times in s.
    void add(int threads, double worked, double waited, double share)
    {
        if (all_ > window * threads) alone_ *= 0.5, all_ *= 0.5; // older loops count less
        // one thread would have needed as long for all of it as the leader for its share, scaled up
        alone_ += worked / share;
        all_ += (worked + waited) * threads;
    }
    bool is_low() const { return alone_ < least * all_; }
    /// Other threads take part from now on.
    void forget() { *this = {}; }

private:
    static constexpr double window = 4e-3; ///< time span of the loops that are remembered [s]
    /// The time of one thread alone, and of all threads together [s]. The initial values are those of
    /// efficient loops.
    double alone_ = window, all_ = window;
};

/// Decides when a thread that lost its core takes part again: once it has had a core to itself for some
/// milliseconds. It tries this after a pause, which doubles with each failure.
class Bench
{
public:
    static constexpr double shortest = 5e-3, longest = 160e-3; ///< pauses [s]

    bool is_on() const { return is_on_; }
    /// The thread lost its core.
    void sit(double now)
    {
        pause_ = now - since_ > 8 * pause_ ? shortest : std::min(2 * pause_, longest);
        trial_ = now + pause_;
        is_on_ = true;
    }
    /// Whether the thread should try now; if so, schedules the next trial.
    bool is_to_try(double now)
    {
        if (!is_on_ || now < trial_) return false;
        pause_ = std::min(2 * pause_, longest);
        trial_ = now + pause_;
        return true;
    }
    /// The thread had a core to itself.
    void leave(double now)
    {
        is_on_ = false;
        since_ = now;
    }

private:
    bool is_on_ = false;
    double trial_ = 0, since_ = 0; ///< when it tries next; when it last took part again
    double pause_ = shortest;
};

/// Whether the calling thread has a core to itself: it spins for some milliseconds and checks the clock for
/// gaps. Programs that share a core take turns of 1.4 to 3 ms with current Linux schedulers.
inline bool has_free_core()
{
    constexpr double trial = 4e-3;
    double const begin = clock_time();
    for (double before = begin;;) {
        double const now = clock_time();
        if (now - before > stall) return false;
        if (now - begin > trial) return true;
        before = now;
    }
}

} // namespace firn::openmp::detail
