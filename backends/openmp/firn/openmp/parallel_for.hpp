// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/thread_team.hpp>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace firn::openmp
{

namespace detail
{
/// Indices that threads share, some at a time. Each thread goes through a partition of its own from the
/// front; when that is done it helps with the others, from their backs. So a thread works on much the same
/// indices in one loop after another, and finds their data in its own cache. Atomics here are relaxed: what
/// one thread writes others read only after the end of the team's loop, which orders everything.
class SharedIndices
{
public:
    static constexpr int most_parts = 64; ///< more threads than that share partitions

    /// `chunk` indices at a time, for so many threads.
    SharedIndices(std::int64_t count, std::int64_t chunk, int threads)
        : count_(count), chunk_(chunk), partitions_(std::clamp(threads, 1, most_parts))
    {
        std::int64_t const chunks = (count + chunk - 1) / chunk;
        for (int part = 0; part < partitions_; ++part)
            set(part, std::uint32_t(chunks * part / partitions_),
                std::uint32_t(chunks * (part + 1) / partitions_));
    }
    /// One index at a time; the partitions begin at these bounds, and the last bound ends the last partition.
    explicit SharedIndices(std::span<std::uint32_t const> bounds)
        : count_(bounds.back()), chunk_(1), partitions_(static_cast<int>(bounds.size()) - 1)
    {
        for (int part = 0; part < partitions_; ++part)
            set(part, bounds[std::size_t(part)], bounds[std::size_t(part) + 1]);
    }

    /// Prefetches the partition that a thread is about to use, which the leader has just written.
    void expect(int thread, int threads) const { __builtin_prefetch(&part_[own_part(thread, threads)], 1); }

    /// Calls `work(i)` for every index that the calling thread gets, as number `thread` of `threads`; returns
    /// its share of all indices.
    template <class Index, class Work>
    double for_each(int thread, int threads, Work& work)
    {
        int const own = own_part(thread, threads);
        std::int64_t done = 0;
        for (int i = 0; i < partitions_; ++i) {
            int const part = (own + i) % partitions_;
            for (std::int64_t taken; (taken = take(part, i == 0, threads == 1)) >= 0;) {
                std::int64_t const begin = taken * chunk_, end = std::min(begin + chunk_, count_);
                for (std::int64_t at = begin; at < end; ++at) work(static_cast<Index>(at));
                done += end - begin;
            }
        }
        return count_ > 0 ? static_cast<double>(done) / static_cast<double>(count_) : 1;
    }

private:
    struct Range
    {
        std::uint32_t begin, end; ///< of chunks
    };
    struct alignas(64) Part
    {
        std::atomic<Range> left;
    };

    int own_part(int thread, int threads) const
    {
        return static_cast<int>(std::int64_t(thread) * partitions_ / threads);
    }
    void set(int part, std::uint32_t begin, std::uint32_t end)
    {
        std::construct_at(&part_[part], Range{begin, end});
    }

    /// The next chunk of a partition, from its front or its back, or -1 if none is left. A thread that is
    /// `alone` needs no compare-and-swap, which would wait for all its earlier stores.
    std::int64_t take(int part, bool from_front, bool alone)
    {
        auto& shared = part_[part].left;
        Range left = shared.load(std::memory_order_relaxed);
        while (left.begin < left.end) {
            Range rest = left;
            std::uint32_t const taken = from_front ? rest.begin++ : --rest.end;
            if (alone) {
                shared.store(rest, std::memory_order_relaxed);
                return taken;
            }
            if (shared.compare_exchange_weak(left, rest, std::memory_order_relaxed)) return taken;
        }
        return -1;
    }

    std::int64_t count_, chunk_;
    int partitions_;
    union // so that unused partitions, most of them, need not be constructed
    {
        Part part_[most_parts];
    };
};

/// Threads do `make`'s work for all indices, each calling it once; `all` hands out the indices.
template <class Index, class Make>
void share_out(Threads const& threads, SharedIndices& all, Make const& make)
{
    // The type of the work is hidden from the team; otherwise compilers would compile the body of each loop
    // twice, for one thread and for several.
    ThreadWork const work{[](void const* context, SharedIndices& indices, int thread, int of) {
                              indices.expect(thread, of);
                              auto work_on = (*static_cast<Make const*>(context))(thread);
                              return indices.for_each<Index>(thread, of, work_on);
                          },
                          &make};
    if (threads.count == 1) // no team
        work.run(work.context, all, 0, 1);
    else if (threads.executor)
        run_on(threads.executor, threads.count, work, all);
    else
        ThreadTeam::run(threads.count, work, all);
}
} // namespace detail

/// Threads share the indices from 0 to `count`, at most `chunk` at a time, or fewer if there are not enough
/// for all. Each calls `make(its number)` once, and what that returns for every index it gets. If one of
/// these calls throws, so does this, and some of the work may be left undone.
template <class Index, class Make>
void parallel_for(Threads const& threads, Index count, int chunk, Make const& make)
{
    if (count <= 1 && threads.count > 1) return parallel_for(Threads(1), count, chunk, make);
    // small chunks, so that others can help a late thread
    Index const fair = count / Index(4 * threads.count);
    Index const at_once =
        threads.count == 1 ? std::max(count, Index(1)) : std::clamp(fair, Index(1), Index(chunk));
    detail::SharedIndices all(count, at_once, threads.count);
    detail::share_out<Index>(threads, all, make);
}

/// The same one index at a time, in partitions that begin at `bounds`; the last bound ends the last
/// partition. If the bounds are not for so many threads and indices, the partitions are equal.
template <class Index, class Make>
void parallel_for(Threads const& threads, Index count, std::span<std::uint32_t const> bounds,
                  Make const& make)
{
    bool const fit = threads.count <= detail::SharedIndices::most_parts &&
                     bounds.size() == static_cast<std::size_t>(threads.count) + 1 &&
                     bounds.back() == static_cast<std::uint32_t>(count);
    if (threads.count == 1 || count <= 1 || !fit) return parallel_for(threads, count, 1, make);
    detail::SharedIndices all(bounds);
    detail::share_out<Index>(threads, all, make);
}

/// Calls `body(i)` for each i below `count`, in any order and on several threads.
template <class Body>
void for_each(Threads const& threads, std::size_t count, Body const& body)
{
    parallel_for(threads.limited_to(count > 256 ? threads.count : 1), static_cast<std::int64_t>(count), 256,
                 [&](int) { return [&](std::int64_t i) { body(static_cast<std::size_t>(i)); }; });
}

} // namespace firn::openmp
