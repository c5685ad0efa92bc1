// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/distributed/communicator.hpp>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <typeinfo>
#include <utility>
#include <vector>

namespace firn
{

/// The communicator of ranks that are threads of one process: see run_ranks().
class RankThreads
{
    /// What a rank lets the others see.
    struct Seen
    {
        void const* value = nullptr;
        std::type_info const* type = nullptr;
    };
    /// Where ranks wait for each other, again and again.
    struct Gate
    {
        int waiting = 0;
        std::atomic<long> rounds = 0;
    };

    /// What the ranks share.
    struct Shared
    {
        explicit Shared(int ranks) : count(ranks), shown(static_cast<std::size_t>(ranks)) {}

        /// Waits until all ranks have come, and returns whether they have: if it `may_end`, a rank that has
        /// ended is not waited for.
        bool pass(Gate& gate, bool may_end)
        {
            long round = 0;
            {
                std::lock_guard const lock(mutex);
                if (may_end && has_ended) return false;
                round = gate.rounds;
                if (++gate.waiting == count) {
                    gate.waiting = 0;
                    ++gate.rounds;
                    all_here.notify_all();
                    return true;
                }
            }
            auto const is_over = [&] { return gate.rounds != round || (may_end && has_ended); };
            // the others mostly come soon, and a thread that sleeps takes long to wake
            auto const until = std::chrono::steady_clock::now() + std::chrono::microseconds(50);
            while (!is_over() && std::chrono::steady_clock::now() < until) std::this_thread::yield();
            if (!is_over()) {
                std::unique_lock lock(mutex);
                all_here.wait(lock, is_over);
            }
            return gate.rounds != round;
        }
        /// Throws an Error that says which rank has ended, and why.
        void throw_ended()
        {
            std::lock_guard const lock(mutex);
            throw Error{aborted, "RankThreads", "See the error of the rank that ended."};
        }

        int count;
        std::mutex mutex;
        std::condition_variable all_here;
        Gate shows, has_read;
        std::atomic<bool> has_ended = false;
        std::string aborted;                       ///< why a rank has ended
        std::vector<std::function<void()>> to_end; ///< what else ranks may wait for
        std::vector<Seen> shown;                   ///< by rank
    };

public:
    int rank() const { return rank_; }
    int size() const { return shared_->count; }

    /// Lets each rank see what the others have in this process: calls `read(of)` when all ranks have come,
    /// where `of(rank)` is what that rank passed. Returns when all of them have read, even where an error
    /// ends one of them then. Throws an Error if ranks wait for each other in different calls.
    template <class T, class Read>
    void show(T const& own, Read const& read) const
    {
        shared_->shown[static_cast<std::size_t>(rank_)] = {&own, &typeid(T)};
        if (!shared_->pass(shared_->shows, true)) shared_->throw_ended();
        struct UntilAllHaveRead
        {
            Shared& shared;
            ~UntilAllHaveRead() { shared.pass(shared.has_read, false); }
        } const until_then{*shared_};
        for (Seen const& seen : shared_->shown)
            require(*seen.type == typeid(T), "not all ranks make the same call", "RankThreads",
                    "Run the same program on all ranks.");
        read([&](int rank) -> T const& {
            return *static_cast<T const*>(shared_->shown[static_cast<std::size_t>(rank)].value);
        });
    }

    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const
    {
        std::vector<Parcel> came(static_cast<std::size_t>(size()));
        show(to, [&](auto const& of) {
            for (std::size_t rank = 0; rank < came.size(); ++rank)
                came[rank] = of(static_cast<int>(rank))[static_cast<std::size_t>(rank_)];
        });
        return came;
    }
    std::vector<Parcel> all_gather(Parcel const& own) const
    {
        std::vector<Parcel> came(static_cast<std::size_t>(size()));
        show(own, [&](auto const& of) {
            for (std::size_t rank = 0; rank < came.size(); ++rank) came[rank] = of(static_cast<int>(rank));
        });
        return came;
    }
    /// The ranks that wait now, or will, throw an Error with this reason.
    void abort(char const* why) const
    {
        std::vector<std::function<void()>> to_end;
        {
            std::lock_guard const lock(shared_->mutex);
            if (!shared_->has_ended)
                shared_->aborted = "rank " + std::to_string(rank_) + " has ended: " + why;
            shared_->has_ended = true;
            to_end.swap(shared_->to_end);
            shared_->all_here.notify_all();
        }
        for (auto const& end : to_end) end();
    }
    /// Throws that Error if a rank has ended.
    void require_all() const
    {
        if (shared_->has_ended) shared_->throw_ended();
    }
    /// Calls `end` when a rank ends, on its thread, or at once if one has: it ends what ranks wait for
    /// elsewhere, such as messages between devices.
    void when_one_ends(std::function<void()> end) const
    {
        {
            std::lock_guard const lock(shared_->mutex);
            if (!shared_->has_ended) {
                shared_->to_end.push_back(std::move(end));
                return;
            }
        }
        end();
    }

private:
    RankThreads(std::shared_ptr<Shared> shared, int rank) : shared_(std::move(shared)), rank_(rank) {}
    template <class Work>
    friend void run_ranks(int, Work const&);

    std::shared_ptr<Shared> shared_;
    int rank_;
};

/// Runs `work(communicator)` on so many ranks, each a thread, and waits for all of them. If one of them
/// throws, the others throw where they wait for it, and then so does this.
template <class Work>
void run_ranks(int ranks, Work const& work)
{
    require(ranks > 0, "the number of ranks is not positive", "run_ranks", "Pass 1 or more.");
    auto const shared = std::make_shared<RankThreads::Shared>(ranks);
    std::exception_ptr first; // the error that ended a rank before all others
    auto const run = [&](int rank) {
        RankThreads const communicator(shared, rank);
        auto const end = [&](char const* why) {
            {
                std::lock_guard const lock(shared->mutex);
                if (!first) first = std::current_exception();
            }
            communicator.abort(why);
        };
        try {
            work(communicator);
        }
        catch (std::exception const& error) {
            end(error.what());
        }
        catch (...) {
            end("an exception of unknown type");
        }
    };
    std::vector<std::thread> threads;
    threads.reserve(static_cast<std::size_t>(ranks));
    for (int rank = 0; rank < ranks; ++rank) threads.emplace_back(run, rank);
    for (auto& thread : threads) thread.join();
    if (first) std::rethrow_exception(first);
}

} // namespace firn
