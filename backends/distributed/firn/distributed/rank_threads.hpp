// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/distributed/communicator.hpp>

#include <condition_variable>
#include <cstddef>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace firn
{

/// The communicator of ranks that are threads of one process: see run_ranks().
class RankThreads
{
    /// What the ranks share.
    struct Shared
    {
        explicit Shared(int ranks) : count(ranks), parcels(static_cast<std::size_t>(ranks)) {}

        /// Waits until all ranks are here.
        void meet()
        {
            std::unique_lock lock(mutex);
            long const round = rounds;
            if (aborted.empty() && ++waiting == count) { // what a rank that has ended sent is gone
                waiting = 0;
                ++rounds;
                all_here.notify_all();
            }
            else
                all_here.wait(lock, [&] { return rounds != round || !aborted.empty(); });
            if (rounds == round) throw Error{aborted, "RankThreads", "See the error of the rank that ended."};
        }

        int count;
        std::mutex mutex;
        std::condition_variable all_here;
        int waiting = 0;
        long rounds = 0;
        std::string aborted;                             ///< why a rank ended; empty: none did
        std::vector<std::function<void()>> to_end;       ///< what else ranks may wait for
        std::vector<std::vector<Parcel> const*> parcels; ///< by rank that sends
    };

public:
    int rank() const { return rank_; }
    int size() const { return shared_->count; }

    std::vector<Parcel> exchange(std::vector<Parcel> const& to) const
    {
        shared_->parcels[static_cast<std::size_t>(rank_)] = &to;
        shared_->meet();
        std::vector<Parcel> came;
        came.reserve(static_cast<std::size_t>(size()));
        for (auto const* const from : shared_->parcels)
            came.push_back((*from)[static_cast<std::size_t>(rank_)]);
        shared_->meet(); // until then the others read what this rank sent
        return came;
    }
    std::vector<Parcel> all_gather(Parcel const& own) const
    {
        std::vector<Parcel> const list{own};
        shared_->parcels[static_cast<std::size_t>(rank_)] = &list;
        shared_->meet();
        std::vector<Parcel> came;
        came.reserve(static_cast<std::size_t>(size()));
        for (auto const* const from : shared_->parcels) came.push_back(from->front());
        shared_->meet();
        return came;
    }
    /// The ranks that wait now, or will, throw an Error with this reason.
    void abort(char const* why) const
    {
        std::vector<std::function<void()>> to_end;
        {
            std::lock_guard const lock(shared_->mutex);
            if (shared_->aborted.empty())
                shared_->aborted = "rank " + std::to_string(rank_) + " has ended: " + why;
            to_end.swap(shared_->to_end);
            shared_->all_here.notify_all();
        }
        for (auto const& end : to_end) end();
    }
    /// Throws that Error if a rank has ended.
    void require_all() const
    {
        std::lock_guard const lock(shared_->mutex);
        if (!shared_->aborted.empty())
            throw Error{shared_->aborted, "RankThreads", "See the error of the rank that ended."};
    }
    /// Calls `end` when a rank ends, on its thread, or at once if one has: it ends what ranks wait for
    /// elsewhere, such as messages between devices.
    void when_one_ends(std::function<void()> end) const
    {
        {
            std::lock_guard const lock(shared_->mutex);
            if (shared_->aborted.empty()) {
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
