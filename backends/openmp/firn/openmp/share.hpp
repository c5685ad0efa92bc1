// SPDX-License-Identifier: MIT
#pragma once

#include <exception>
#include <optional>

namespace firn::openmp
{

namespace detail
{
/// Keeps what a thread threw, for the one that may let it out of the team.
class Failure
{
public:
    template <class Work>
    void keep(Work const& work) noexcept
    {
        try {
            work();
        }
        catch (...) {
            keep_current();
        }
    }
    void rethrow() const
    {
        if (first_) std::rethrow_exception(first_);
    }

private:
    void keep_current() noexcept
    {
#pragma omp critical(firn_failure)
        if (!first_) first_ = std::current_exception();
    }

    std::exception_ptr first_;
};
} // namespace detail

/// Threads share the indices from 0 to `count`, `chunk` at a time: each calls `make()` once and what that
/// returns for every index it gets. If one of these calls throws, so does this, and work is undone.
///
/// One thread alone forms no team: even one of one ends each of its loops by a system call.
template <class Index, class Make>
void share(int threads, Index count, int chunk, Make const& make)
{
    if (threads == 1) {
        auto work = make();
        for (Index i = 0; i < count; ++i) work(i);
        return;
    }
    detail::Failure failure;
#pragma omp parallel num_threads(threads)
    {
        std::optional<decltype(make())> work;
        failure.keep([&] { work.emplace(make()); });
#pragma omp for schedule(dynamic, chunk) nowait
        for (Index i = 0; i < count; ++i)
            if (work) failure.keep([&] { (*work)(i); });
    }
    failure.rethrow();
}

} // namespace firn::openmp
