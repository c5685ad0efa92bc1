// SPDX-License-Identifier: MIT
#pragma once

#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <omp.h>
#include <utility>

namespace firn::openmp::detail
{

class SharedIndices;

/// What a thread of a team does.
struct ThreadWork
{
    void (*run)(void const* context, SharedIndices& indices, int thread, int threads);
    void const* context;
};

/// Threads that stay together from one loop to the next: a parallel region for each loop takes longer to
/// begin, and a step of a small scene has three loops of a few microseconds each.
class Team
{
public:
    /// Calls `work()`; the loops that it has done meanwhile are shared by so many threads. In a loop of
    /// OpenMP of the work's own there is one thread: the others are here.
    template <class Work>
    static void together(int threads, Work const& work)
    {
        if (threads == 1 || current_ != nullptr) {
            work();
            return;
        }
        Team team(threads);
        std::exception_ptr failure;
#pragma omp parallel num_threads(threads)
        {
            if (int const thread = omp_get_thread_num(); thread > 0)
                team.serve(thread);
            else {
                team.size_ = omp_get_num_threads();
                current_ = &team;
                try {
                    work();
                }
                catch (...) {
                    failure = std::current_exception();
                }
                current_ = nullptr;
                team.dismiss();
            }
        }
        if (failure) std::rethrow_exception(failure);
    }

    /// Up to `threads` threads do the same work; what one of them throws leaves when all are through. Those
    /// of the team that the calling thread leads, if it does, or others that come for this work alone.
    static void run(int threads, ThreadWork const& work, SharedIndices& indices)
    {
        if (current_ != nullptr)
            current_->run_loop(threads, work, indices);
        else
            together(threads, [&] { current_->run_loop(threads, work, indices); });
    }

    /// How many threads the team has that the calling thread leads, 0 if it leads none.
    static int size_of_current() { return current_ != nullptr ? current_->size_ : 0; }

private:
    explicit Team(int threads) : asked_for_(threads) { in_teams_ += threads; }
    ~Team() { in_teams_ -= asked_for_; }
    Team(Team const&) = delete;
    Team& operator=(Team const&) = delete;

    void run_loop(int threads, ThreadWork const& work, SharedIndices& indices)
    {
        work_ = work;
        indices_ = &indices;
        working_ = threads < size_ ? threads : size_;
        // what is above is seen by who sees this
        std::uint32_t const turn = turn_.fetch_add(1, std::memory_order_release) + 1;
        turn_.notify_all();
        // a loop within the loop has one thread: the team is at work
        Team* const self = std::exchange(current_, nullptr);
        take_part(0);
        current_ = self;
        for (std::uint32_t done; (done = done_.load(std::memory_order_acquire)) != done_by(turn);)
            watch(done_, done);
        if (failure_) std::rethrow_exception(std::exchange(failure_, nullptr));
    }

    void serve(int thread)
    {
        for (std::uint32_t seen = 0;; ++seen) {
            watch(turn_, seen);
            if (is_dismissed_) return;
            take_part(thread);
            if (done_.fetch_add(1, std::memory_order_acq_rel) + 1 == done_by(seen + 1)) done_.notify_one();
        }
    }

    /// What `done_` is when all others are through with a turn. (Both begin anew beyond the largest number:
    /// no turns but neighbours are to be told apart.)
    std::uint32_t done_by(std::uint32_t turn) const { return turn * static_cast<std::uint32_t>(size_ - 1); }

    void take_part(int thread)
    {
        if (thread >= working_) return;
        try {
            work_.run(work_.context, *indices_, thread, working_);
        }
        catch (...) {
#pragma omp critical(firn_failure)
            if (!failure_) failure_ = std::current_exception();
        }
    }

    void dismiss()
    {
        is_dismissed_ = true;
        turn_.fetch_add(1, std::memory_order_release);
        turn_.notify_all();
    }

    /// How many threads may wait awake: one for each core, or none where the environment asks OpenMP's to
    /// sleep meanwhile.
    static int most_awake()
    {
        static int const most = [] {
            char const* const policy = std::getenv("OMP_WAIT_POLICY");
            bool const is_passive = policy != nullptr && (*policy == 'p' || *policy == 'P');
            return is_passive ? 0 : omp_get_num_procs();
        }();
        return most;
    }

    /// Waits until a number is another one: awake for a tenth or two of a millisecond, where each thread of
    /// all teams has a core of its own.
    template <class Number>
    void watch(std::atomic<Number> const& number, Number old) const
    {
        bool const stays_awake = in_teams_.load(std::memory_order_relaxed) <= most_awake();
        for (int looks = stays_awake ? 5000 : 0; looks > 0; --looks) {
            if (number.load(std::memory_order_acquire) != old) return;
#if defined(__x86_64__)
            __builtin_ia32_pause();
#endif
        }
        number.wait(old, std::memory_order_acquire);
    }

    static inline thread_local Team* current_ = nullptr; ///< that the calling thread leads
    static inline std::atomic<int> in_teams_{0};         ///< threads that have been asked for

    int asked_for_;
    std::exception_ptr failure_;
    // What threads look at while others work, in lines of the cache of their own: that of the turn has all
    // that it is about, and nobody but who leads writes there.
    alignas(64) std::atomic<std::uint32_t> turn_{0};
    int size_ = 1, working_ = 1;
    bool is_dismissed_ = false;
    ThreadWork work_{};
    SharedIndices* indices_ = nullptr;
    alignas(64) std::atomic<std::uint32_t> done_{0}; ///< by the others: see done_by()
};

} // namespace firn::openmp::detail
