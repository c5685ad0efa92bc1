// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

namespace firn::openmp
{

/// What the threads of a loop work with, kept for the next one: an allocator takes longer to give a dozen
/// lists, and to take them back, than a thread to go through a small scene. Objects by their type, one for
/// each thread; what they hold from before is to be overwritten.
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

    /// The thread's own object, made when it is asked for first.
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
    /// Its address stands for the type.
    template <class T>
    static inline char const name_of = 0;

    std::vector<std::vector<std::pair<void const*, std::shared_ptr<void>>>> of_threads_;
};

} // namespace firn::openmp
