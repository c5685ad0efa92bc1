// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/readback.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

// Results of a loop that several devices share, where they are needed within a step: through the host, which
// waits for them.
namespace firn::cuda
{

/// The result of one group of threads, among those of all devices.
template <class Result>
struct ResultOfGroup
{
    std::uint32_t group;
    Result result;
};

namespace detail
{
/// Merges results that the host has put to their groups, bunch by bunch on a warp each.
template <class Result>
__global__ void __launch_bounds__(32) merge_put(ResultsOfGroups<Result> results)
{
    results.merge_bunch(blockIdx.x);
}
} // namespace detail

/// Brings the results of a loop's groups of threads to the host, and those of all devices back.
class ResultsByHost
{
public:
    explicit ResultsByHost(Queue const& queue) : queue_(queue), come_(queue), go_(queue), all_(queue) {}

    /// The results of the groups for which `which[group]` is odd and that have found something. Waits for the
    /// loop.
    template <class Result>
    std::vector<ResultOfGroup<Result>> found(Results const& here, unsigned char const* which)
    {
        auto const results = here.partial<Result>();
        auto* const from = come_.as<unsigned char>(results.count * (sizeof(Result) + 1));
        auto* const of_groups = reinterpret_cast<Result*>(from);
        auto* const is_own = from + results.count * sizeof(Result);
        copy_queued(queue_, of_groups, results.of, results.count);
        copy_queued(queue_, is_own, which, results.count);
        queue_.wait();
        std::vector<ResultOfGroup<Result>> found;
        Result rest{};
        for (std::uint32_t group = 0; group < results.count; ++group)
            if ((is_own[group] & 1) != 0) {
                if (of_groups[group].has_a_place())
                    found.push_back({group, of_groups[group]});
                else
                    rest.merge(of_groups[group]);
            }
        if (found.empty() || found.front().group != 0) found.insert(found.begin(), {0, Result{}});
        found.front().result.merge(rest); // which needs no place
        return found;
    }

    /// Merges the results of `groups` groups on all devices, as one device would that had found them.
    template <class Result>
    Partial<Result> merge(std::uint32_t groups, std::vector<ResultOfGroup<Result>> const& found)
    {
        OnDevice const device(queue_);
        auto* const of_groups = go_.as<Result>(groups);
        std::fill_n(of_groups, groups, Result{});
        for (auto const& of : found) of_groups[of.group].merge(of.result);
        auto const results = all_.expect<Result>(groups);
        copy_queued(queue_, results.of_groups, static_cast<Result const*>(of_groups), groups);
        if (results.bunch > 1)
            launch_after("merge_put", queue_, detail::merge_put<Result>, results.bunches(), 32, results);
        return all_.partial<Result>();
    }

    std::size_t memory() const { return all_.memory(); }

private:
    Queue queue_;
    HostMemory come_, go_;
    Results all_; ///< of all devices
};

} // namespace firn::cuda
