// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/openmp/executor.hpp>
#include <firn/openmp/free_cores.hpp>

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <memory>
#include <new>
#include <omp.h>
#include <pthread.h>
#include <utility>

namespace firn::openmp
{

/// The threads that a loop may use: how many, and the host's executor if they are not OpenMP's.
struct Threads
{
    int count = 1;
    Executor executor{};

    Threads(int most, Executor runs = {}) : count(most), executor(std::move(runs)) {}
    Threads limited_to(int most) const { return {most < count ? most : count, executor}; }
};

namespace detail
{

class SharedIndices;

/// What each thread of a loop does; returns the share of the loop that it did, in [0, 1].
struct ThreadWork
{
    double (*run)(void const* context, SharedIndices& indices, int thread, int threads);
    void const* context;
};

/// The first exception that any of several threads threw.
class FirstFailure
{
public:
    /// Calls `work()` and stores what it throws.
    template <class Work>
    void guard(Work const& work) noexcept
    {
        try {
            work();
        }
        catch (...) {
            if (!has_failed_.test_and_set()) failure_ = std::current_exception();
        }
    }
    /// Throws it; to be called once no thread is at work any more.
    void rethrow()
    {
        if (!failure_) return;
        has_failed_.clear();
        std::rethrow_exception(std::exchange(failure_, nullptr));
    }

private:
    std::atomic_flag has_failed_;
    std::exception_ptr failure_; ///< written by the thread that set the flag
};

/// Whether the calling thread is working for a loop: a nested loop runs on this thread alone.
inline thread_local bool is_in_loop = false;

class InLoop
{
public:
    InLoop() : before_(std::exchange(is_in_loop, true)) {}
    ~InLoop() { is_in_loop = before_; }
    InLoop(InLoop const&) = delete;
    InLoop& operator=(InLoop const&) = delete;

private:
    bool before_;
};

/// A team of OpenMP threads that wait for the loops of one host thread, their leader.
///
/// They belong to one parallel region, which stays open between loops and calls: to open one takes longer
/// than many a loop, and threads that leave one stay awake for milliseconds. A thread of the team waits awake
/// for the next loop for a tenth of a millisecond and then sleeps. The region is opened by a thread of its
/// own; the leader takes the place of that thread within the team (OMP_PLACES).
///
/// A loop is offered to the threads. A late thread finds the offer withdrawn and is not waited for: another
/// program may have its core. Threads that lose their cores in the middle of a loop are left out for a while,
/// if loops are slower for it (Efficiency, Bench).
class ThreadTeam
{
public:
    /// Up to `threads` threads run `work` and share `indices`. An exception in one of them is rethrown when
    /// all have finished.
    static void run(int threads, ThreadWork const& work, SharedIndices& indices)
    {
        ThreadTeam* const team = of_this_thread(threads);
        if (team != nullptr) return team->lead(threads, work, indices);
        InLoop const mark;
        work.run(work.context, indices, 0, 1);
    }

    explicit ThreadTeam(int threads)
        : size_(threads), workers_(std::make_unique<Worker[]>(static_cast<std::size_t>(threads - 1)))
    {
        // not by <thread>, which takes every host program long to compile
        auto const begin = [](void* team) -> void* {
            static_cast<ThreadTeam*>(team)->open_region();
            return nullptr;
        };
        if (pthread_create(&region_, nullptr, begin, this) != 0) throw std::bad_alloc();
    }
    ~ThreadTeam()
    {
        for (int i = 0; i + 1 < size_; ++i) {
            Worker& worker = worker_at(i);
            worker.state.store(dismissed);
            worker.state.notify_one();
        }
        pthread_join(region_, nullptr);
    }
    ThreadTeam(ThreadTeam const&) = delete;
    ThreadTeam& operator=(ThreadTeam const&) = delete;

private:
    enum State : std::uint32_t
    {
        idle,
        offered,  ///< by the leader, which may withdraw the offer
        taken,    ///< by the worker, which is now waited for
        on_trial, ///< the worker must find out whether it has a core
        dismissed
    };
    struct alignas(64) Worker
    {
        std::atomic<std::uint32_t> state{idle};
        std::atomic<bool> sleeps{false}, has_core{false};
        // used by the leader alone
        Bench bench;
        bool is_asked = false, has_stalled = false; ///< in the current loop
    };

    Worker& worker_at(int i) { return workers_[static_cast<std::size_t>(i)]; }

    /// The team that the calling thread leads, with at least so many threads. Null if the thread is itself
    /// working for a loop, or if OpenMP would not give it further threads.
    static ThreadTeam* of_this_thread(int threads)
    {
        /// Loops may still come after a thread's own objects were destroyed; these run on one thread.
        struct Owner
        {
            std::unique_ptr<ThreadTeam> team;
            int process = processes();
            ~Owner()
            {
                forget_after_fork();
                is_over_ = true;
            }
            /// After a fork the threads are those of the parent process: the team is leaked, not joined.
            void forget_after_fork()
            {
                if (std::exchange(process, processes()) != processes()) static_cast<void>(team.release());
            }
        };
        if (is_in_loop || is_over_ || omp_get_active_level() >= omp_get_max_active_levels()) return nullptr;
        thread_local Owner owner;
        owner.forget_after_fork();
        if (owner.team == nullptr || owner.team->size_ < threads) try {
                owner.team.reset(); // frees the threads before new ones start
                owner.team = std::make_unique<ThreadTeam>(threads);
            }
            catch (std::exception const&) { // no memory or no thread available: this thread does the work
            }
        return owner.team.get();
    }

    /// Offers work to threads that have cores, and has the others test whether they have; returns how many
    /// may work.
    int ask(int threads, double now)
    {
        int active = 1;
        for (int i = 0; i + 1 < threads; ++i) {
            Worker& one = worker_at(i);
            if (one.bench.is_on() && one.has_core.exchange(false, std::memory_order_relaxed))
                one.bench.leave(now);
            one.is_asked = !one.bench.is_on();
            if (one.is_asked)
                ++active, one.state.store(offered, std::memory_order_release);
            else if (one.state.load(std::memory_order_relaxed) == idle && one.bench.is_to_try(now))
                one.state.store(on_trial, std::memory_order_release);
        }
        // either a thread that goes to sleep sees the offer, or the leader sees that it sleeps
        std::atomic_thread_fence(std::memory_order_seq_cst);
        for (int i = 0; i + 1 < threads; ++i) {
            Worker& one = worker_at(i);
            if (one.sleeps.load(std::memory_order_relaxed)) one.state.notify_one();
        }
        return active;
    }

    void lead(int threads, ThreadWork const& work, SharedIndices& indices)
    {
        double const begin = clock_time();
        work_ = work;
        indices_ = &indices;
        threads_ = threads;
        int const active = ask(threads, begin);
        double share = 1;
        failure_.guard([&] {
            InLoop const mark;
            share = work.run(work.context, indices, 0, active > 1 ? threads : 1);
        });
        double const done = clock_time();
        double now = done;
        bool have_stalled = false;
        for (int i = 0; i + 1 < threads; ++i) {
            Worker& one = worker_at(i);
            one.has_stalled = false;
            if (!one.is_asked) continue;
            std::uint32_t seen = one.state.load(std::memory_order_acquire);
            if (seen == offered && one.state.compare_exchange_strong(seen, idle, std::memory_order_acq_rel))
                continue;                // the thread is late
            if (seen != taken) continue; // the thread is through
            double const since = now;
            if (most_awake() == 0 || !changes_soon(one.state, taken))
                sleep_until_changed(one.state, taken, leader_sleeps_);
            now = clock_time();
            one.has_stalled = now - since > stall;
            have_stalled = have_stalled || one.has_stalled;
        }
        if (active > 1 && share > 0) efficiency_.add(active, done - begin, now - done, share);
        if (have_stalled && efficiency_.is_low()) {
            for (int i = 0; i + 1 < threads; ++i)
                if (Worker& one = worker_at(i); one.has_stalled) one.bench.sit(now);
            efficiency_.forget();
        }
        failure_.rethrow();
    }

    void open_region()
    {
#pragma omp parallel num_threads(size_)
        if (int const thread = omp_get_thread_num(); thread > 0) serve(worker_at(thread - 1), thread);
    }

    void serve(Worker& own, int thread)
    {
        for (awake_.fetch_add(1, std::memory_order_relaxed);;) {
            bool const may_look = awake_.load(std::memory_order_relaxed) < most_awake();
            if (!may_look || !changes_soon(own.state, idle)) {
                awake_.fetch_sub(1, std::memory_order_relaxed);
                sleep_until_changed(own.state, idle, own.sleeps);
                awake_.fetch_add(1, std::memory_order_relaxed);
            }
            std::uint32_t seen = offered;
            if (own.state.compare_exchange_strong(seen, taken, std::memory_order_acq_rel)) {
                failure_.guard([&] {
                    InLoop const mark;
                    work_.run(work_.context, *indices_, thread, threads_);
                });
                // unless it was dismissed meanwhile: the leader's work may have ended the program
                seen = taken;
                own.state.compare_exchange_strong(seen, idle, std::memory_order_acq_rel);
                std::atomic_thread_fence(std::memory_order_seq_cst);
                if (leader_sleeps_.load(std::memory_order_relaxed)) own.state.notify_one();
            }
            else if (seen == on_trial) {
                if (has_free_core()) own.has_core.store(true, std::memory_order_relaxed);
                own.state.compare_exchange_strong(seen, idle, std::memory_order_relaxed);
            }
            else if (seen == dismissed)
                break;
        }
        awake_.fetch_sub(1, std::memory_order_relaxed);
    }

    /// Changes if this process is a child of fork(), which inherits only the thread that called it.
    static int processes()
    {
        static std::atomic<int> forks{0};
        static int const watched = pthread_atfork(nullptr, nullptr, [] { ++forks; });
        static_cast<void>(watched);
        return forks.load(std::memory_order_relaxed);
    }

    /// How many threads may wait awake: one per core, or none if the environment asks OpenMP's threads to
    /// sleep.
    static int most_awake()
    {
        static int const most = [] {
            char const* const policy = std::getenv("OMP_WAIT_POLICY");
            bool const is_passive = policy != nullptr && (*policy == 'p' || *policy == 'P');
            return is_passive ? 0 : omp_get_num_procs();
        }();
        return most;
    }

    /// Spins until a state changes, for about a tenth of a millisecond; true if it did.
    static bool changes_soon(std::atomic<std::uint32_t> const& state, std::uint32_t old)
    {
        for (int looks = 5000; looks > 0; --looks) {
            if (state.load(std::memory_order_acquire) != old) return true;
#if defined(__x86_64__)
            __builtin_ia32_pause();
#elif defined(__aarch64__)
            asm volatile("isb");
#endif
        }
        return false;
    }
    /// Sleeps until it changes; the thread that changes it must wake this one if `sleeps` is set.
    static void sleep_until_changed(std::atomic<std::uint32_t> const& state, std::uint32_t old,
                                    std::atomic<bool>& sleeps)
    {
        sleeps.store(true, std::memory_order_relaxed);
        std::atomic_thread_fence(std::memory_order_seq_cst);
        state.wait(old, std::memory_order_acquire);
        sleeps.store(false, std::memory_order_relaxed);
    }

    static inline thread_local bool is_over_ = false; ///< the calling thread's team has been destroyed
    static inline std::atomic<int> awake_{0};         ///< threads of all teams, without leaders

    int const size_; ///< threads, the leader included
    std::unique_ptr<Worker[]> workers_;
    pthread_t region_{};
    Efficiency efficiency_;
    FirstFailure failure_;
    // Read by threads that have accepted an offer; written before it is made.
    alignas(64) ThreadWork work_{};
    SharedIndices* indices_ = nullptr;
    int threads_ = 1;
    alignas(64) std::atomic<bool> leader_sleeps_{false};
};

/// The same on threads of the host.
inline void run_on(Executor const& executor, int threads, ThreadWork const& work, SharedIndices& indices)
{
    if (is_in_loop) {
        work.run(work.context, indices, 0, 1);
        return;
    }
    FirstFailure failure;
    std::atomic<int> through = 0;
    auto const begun = std::make_unique<std::atomic<bool>[]>(static_cast<std::size_t>(threads));
    executor(threads, [&](int thread) {
        if (thread < 0 || thread >= threads || begun[static_cast<std::size_t>(thread)].exchange(true)) return;
        failure.guard([&] {
            InLoop const mark;
            work.run(work.context, indices, thread, threads);
        });
        through.fetch_add(1, std::memory_order_acq_rel);
    });
    failure.rethrow();
    require(through.load(std::memory_order_acquire) == threads,
            "the executor returned before it had called each job", "OpenMP",
            "Let it call job(i) once for every i in [0, count), and return when all of these calls have.");
}

} // namespace detail
} // namespace firn::openmp
