// SPDX-License-Identifier: MIT
#pragma once

namespace firn::openmp
{

/// Threads share the indices from 0 to `count`, `chunk` at a time: each calls `make()` once and what that
/// returns for every index it gets.
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
#pragma omp parallel num_threads(threads)
    {
        auto work = make();
#pragma omp for schedule(dynamic, chunk) nowait
        for (Index i = 0; i < count; ++i) work(i);
    }
}

} // namespace firn::openmp
