// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <functional>
#include <memory>
#include <type_traits>
#include <utility>

namespace firn
{

/// A host's own threads (its job system), in place of OpenMP's.
///
/// Made of a call `executor(count, job)`, which calls `job(i)` once for every i in [0, count), in any order,
/// on any threads, concurrently or one after another, and returns when all of these calls have returned. A
/// job throws nothing. Jobs share the work of one loop: a job that begins late finds less of it left, or
/// nothing. The call itself may come from several threads at the same time if several solvers run.
class Executor
{
public:
    using Job = std::function<void(int)>;

    Executor() = default;
    template <std::invocable<int, Job const&> Run>
        requires(!std::same_as<std::remove_cvref_t<Run>, Executor>)
    Executor(Run&& run) // NOLINT: `.executor = a lambda` is what a host writes
        : run_(std::make_shared<std::function<void(int, Job const&)> const>(std::forward<Run>(run)))
    {}

    explicit operator bool() const { return run_ != nullptr && *run_ != nullptr; }
    void operator()(int count, Job const& job) const { (*run_)(count, job); }

private:
    std::shared_ptr<std::function<void(int, Job const&)> const> run_; ///< cheap to copy
};

} // namespace firn
