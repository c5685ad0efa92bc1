// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
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
        auto& objects = of_threads_[static_cast<std::size_t>(thread)];
        for (auto const& [type, object] : objects)
            if (type == &name_of<T>) return *static_cast<T*>(object.get());
        objects.emplace_back(&name_of<T>, std::make_shared<T>());
        return *static_cast<T*>(objects.back().second.get());
    }

private:
    /// The address of this variable identifies the type.
    template <class T>
    static inline char const name_of = 0;

    std::vector<std::vector<std::pair<void const*, std::shared_ptr<void>>>> of_threads_;
};

} // namespace firn::openmp
