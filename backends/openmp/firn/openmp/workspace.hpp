// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/objects_by_type.hpp>

#include <cstddef>
#include <vector>

namespace firn::openmp
{

/// What the threads of a loop work with, reused by the next loop: allocating and freeing a dozen lists takes
/// longer than a thread needs for a small scene. Objects are found by their type, one for each thread. They
/// hold what the last loop left, which is to be overwritten.
class Workspace
{
public:
    /// Makes room for so many threads, before they begin.
    Workspace& for_threads(int threads)
    {
        if (of_threads_.size() < static_cast<std::size_t>(threads))
            of_threads_.resize(static_cast<std::size_t>(threads));
        return *this;
    }

    /// The thread's own object, created on first use.
    template <class T>
    T& of(int thread)
    {
        return of_threads_[static_cast<std::size_t>(thread)].of<T>();
    }

private:
    std::vector<ObjectsByType> of_threads_;
};

} // namespace firn::openmp
