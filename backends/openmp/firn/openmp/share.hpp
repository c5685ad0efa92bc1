// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <exception>

namespace firn::openmp
{

namespace detail
{
/// Indices that threads share, some at a time. (What one thread wrote others read behind the end of the team:
/// that orders all, the counter nothing.)
class SharedIndices
{
public:
    SharedIndices(std::int64_t count, std::int64_t chunk) : count_(count), chunk_(chunk) {}

    /// Calls `work(i)` for every index that the calling thread gets.
    template <class Index, class Work>
    void for_each(Work& work)
    {
        for (;;) {
            std::int64_t const begin = next_.fetch_add(chunk_, std::memory_order_relaxed);
            if (begin >= count_) return;
            std::int64_t const end = std::min(begin + chunk_, count_);
            for (std::int64_t i = begin; i < end; ++i) work(static_cast<Index>(i));
        }
    }

private:
    std::atomic<std::int64_t> next_ = 0;
    std::int64_t count_, chunk_;
};

/// What a thread of a team does.
struct ThreadWork
{
    void (*run)(void const* context, SharedIndices& indices);
    void const* context;
};

/// Each thread of a team does the same work; what one of them throws leaves when all are through.
inline void run_team(int threads, ThreadWork const& work, SharedIndices& indices)
{
    std::exception_ptr first;
#pragma omp parallel num_threads(threads)
    {
        try {
            work.run(work.context, indices);
        }
        catch (...) {
#pragma omp critical(firn_failure)
            if (!first) first = std::current_exception();
        }
    }
    if (first) std::rethrow_exception(first);
}
} // namespace detail

/// Threads share the indices from 0 to `count`, `chunk` at a time: each calls `make()` once and what that
/// returns for every index it gets. If one of these calls throws, so does this, and work is undone.
///
/// One thread alone forms no team: even one of one ends each of its loops by a system call. (The team does
/// not know the type of the work: or compilers make the body of each loop twice, for one thread and for
/// several.)
template <class Index, class Make>
void share(int threads, Index count, int chunk, Make const& make)
{
    detail::ThreadWork const work{[](void const* context, detail::SharedIndices& indices) {
                                      auto work_on = (*static_cast<Make const*>(context))();
                                      indices.for_each<Index>(work_on);
                                  },
                                  &make};
    if (threads == 1) {
        detail::SharedIndices all(count, count);
        work.run(work.context, all);
    }
    else {
        detail::SharedIndices indices(count, chunk);
        detail::run_team(threads, work, indices);
    }
}

} // namespace firn::openmp
