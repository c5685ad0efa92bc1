// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/readback.hpp>
#include <firn/cuda/results_by_host.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

// How the results of a loop that several devices share reach the host, and come back when those of all
// devices are known.
namespace firn::cuda
{

/// The result of one group of threads.
template <class Result>
struct OfGroup
{
    std::uint32_t group;
    Result result;
};

namespace detail
{
inline constexpr unsigned telling_threads = 256, telling_groups = 32;

/// Lists the results that have a place among others, in any order, and merges the rest: of the groups for
/// which `which[group]` is 1.
template <class Result>
__global__ void __launch_bounds__(telling_threads)
    tell_results(Partial<Result> of, unsigned char const* which, Result* rest, std::uint32_t* listed_count,
                 OfGroup<Result>* listed)
{
    Result mine{};
    for (std::uint32_t i = blockIdx.x * telling_threads + threadIdx.x; i < of.count;
         i += telling_groups * telling_threads) {
        if (which[i] != 1) continue;
        Result const one = load_words(of.of + i);
        if (one.has_a_place()) {
            OfGroup<Result>& to = listed[atomicAdd(listed_count, 1u)];
            to.group = i;
            store_words(one, &to.result);
        }
        else
            mine.merge(one);
    }
    __shared__ __align__(16) unsigned char memory[telling_threads / 32 * sizeof(Result)];
    auto* const parts = reinterpret_cast<Result*>(memory);
    mine = merged_in_warp(mine);
    if (threadIdx.x % 32 == 0) store_words(mine, parts + threadIdx.x / 32);
    __syncthreads();
    if (threadIdx.x >= 32) return;
    mine = merged_in_warp(threadIdx.x < telling_threads / 32 ? load_shared(parts + threadIdx.x) : Result{});
    if (threadIdx.x == 0) store_words(mine, rest + blockIdx.x);
}

template <class Result>
__global__ void put_results(OfGroup<Result> const* from, std::uint32_t count, Result* to)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) store_words(load_words(&from[i].result), to + from[i].group);
}
} // namespace detail

/// What the groups of threads of a loop have found on this device, on its way to the host and back.
class ResultsOfDevices
{
public:
    explicit ResultsOfDevices(Queue const& queue)
        : by_host(queue), queue_(queue), told_(queue), come_(queue), go_(queue), all_(queue)
    {}

    ResultsByHost by_host; ///< where they are needed at once

    /// Sends the results of the groups for which `which[group]` is 1 to the host. It has them when it has
    /// waited: see told().
    template <class Result>
    void tell(Results const& here, unsigned char const* which)
    {
        OnDevice const device(queue_);
        auto const found = here.partial<Result>();
        told_.renew(Layout<Result>::bytes(found.count));
        told_.fill_bytes(0, Layout<Result>::rest, 0);
        auto* const begin = told_.data();
        launch_after("tell_results", queue_, detail::tell_results<Result>, detail::telling_groups,
                     detail::telling_threads, found, which,
                     reinterpret_cast<Result*>(begin + Layout<Result>::rest),
                     reinterpret_cast<std::uint32_t*>(begin),
                     reinterpret_cast<OfGroup<Result>*>(begin + Layout<Result>::listed));
        at_once_ = std::min(found.count, at_once_);
        std::size_t const bytes = Layout<Result>::bytes(at_once_);
        copy_queued(queue_, come_.as<unsigned char>(bytes), begin, bytes);
    }

    /// What was told: the results that have a place among others, behind the rest of them, which is merged
    /// and comes first.
    template <class Result>
    std::vector<OfGroup<Result>> told()
    {
        auto const* const here = come_.get<unsigned char>();
        std::uint32_t const count = *reinterpret_cast<std::uint32_t const*>(here);
        std::vector<OfGroup<Result>> results(1 + std::size_t(count));
        results[0] = {};
        auto const* const rest = reinterpret_cast<Result const*>(here + Layout<Result>::rest);
        for (unsigned i = 0; i < detail::telling_groups; ++i) results[0].result.merge(rest[i]);
        auto const* const listed = reinterpret_cast<OfGroup<Result> const*>(here + Layout<Result>::listed);
        std::uint32_t const came = std::min(count, at_once_);
        std::copy(listed, listed + came, results.begin() + 1);
        if (came < count) { // seldom: next time there is room for them
            copy_queued(queue_, results.data() + 1 + came,
                        reinterpret_cast<OfGroup<Result> const*>(told_.data() + Layout<Result>::listed) +
                            came,
                        count - came);
            queue_.wait();
        }
        at_once_ = std::max(at_once_, count + count / 4);
        return results;
    }

    /// Merges the results of `groups` groups on all devices, as one device would that had found them. Those
    /// that are not listed have found nothing.
    template <class Result>
    Partial<Result> merge(std::uint32_t groups, std::vector<OfGroup<Result>> const& found)
    {
        OnDevice const device(queue_);
        auto const results = all_.expect<Result>(groups);
        launch_after("fill", queue_, detail::fill<Result>, groups_of(groups, 256), 256, results.of_groups,
                     std::size_t{groups}, Result{});
        auto const count = static_cast<std::uint32_t>(found.size());
        std::size_t const bytes = count * sizeof(OfGroup<Result>);
        auto* const here = go_.as<unsigned char>(std::max(bytes, going_));
        going_ = std::max(bytes, going_);
        std::copy(found.begin(), found.end(), reinterpret_cast<OfGroup<Result>*>(here));
        told_.renew(std::max(bytes, told_.size())); // it has been read
        copy_queued(queue_, told_.data(), here, bytes);
        launch_after("put_results", queue_, detail::put_results<Result>, groups_of(count, 128), 128,
                     reinterpret_cast<OfGroup<Result> const*>(told_.data()), count, results.of_groups);
        return all_.merge_bunches(results);
    }

    std::size_t memory() const { return told_.memory() + all_.memory() + by_host.memory(); }

private:
    /// Where things lie in what is told: how many results are listed, the rest of them, and the list.
    template <class Result>
    struct Layout
    {
        static constexpr std::size_t rest = 16, listed = rest + detail::telling_groups * sizeof(Result);
        static_assert(listed % alignof(OfGroup<Result>) == 0);
        static constexpr std::size_t bytes(std::size_t count)
        {
            return listed + count * sizeof(OfGroup<Result>);
        }
    };

    Queue queue_;
    Array<unsigned char> told_;
    HostMemory come_, go_; ///< what has come to the host, and what it sends back
    Results all_;          ///< of all devices
    std::size_t going_ = 0;
    std::uint32_t at_once_ = 256; ///< so many listed results come with the rest
};

} // namespace firn::cuda
