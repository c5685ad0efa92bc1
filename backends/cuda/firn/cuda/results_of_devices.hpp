// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/readback.hpp>
#include <firn/cuda/results_by_host.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>

// How the results of a loop that several devices share become known to all of them. Each device tells what
// its groups of threads have found; what all have told comes to each of them, and is merged there, in the
// order of the groups.
namespace firn::cuda
{

namespace detail
{
template <class Result>
inline constexpr char kind_of{}; ///< its address tells kinds of results apart

inline constexpr unsigned telling_threads = 256, telling_groups = 32;

/// Where things lie in what a device tells of a loop: the merged results that have no place among others, by
/// group of the telling loop, and behind them a list of those that have one.
template <class Result>
struct Telling
{
    static constexpr std::size_t listed = telling_groups * sizeof(Result);
    static_assert(listed % alignof(ResultOfGroup<Result>) == 0);
    static constexpr std::size_t bytes(std::size_t room)
    {
        constexpr std::size_t alignment = 16;
        return (listed + room * sizeof(ResultOfGroup<Result>) + alignment - 1) / alignment * alignment;
    }
};

/// What a device tells of a loop: the results that have a place among others are listed, in any order, and
/// the rest are merged; those of the groups for which `which[group]` is odd. If there are more than `room`,
/// they are only counted.
template <class Result>
struct TellResults
{
    Partial<Result> of;
    unsigned char const* which;
    std::uint32_t room;
    std::uint32_t* listed_count; ///< 0 before
    unsigned char* to;           ///< null: nothing is told

    /// Called by all threads of `telling_groups` groups.
    __device__ void operator()(std::uint32_t group) const
    {
        if (to == nullptr) return;
        auto* const rest = reinterpret_cast<Result*>(to);
        auto* const listed = reinterpret_cast<ResultOfGroup<Result>*>(to + Telling<Result>::listed);
        Result mine{};
        for (std::uint32_t i = group * telling_threads + threadIdx.x; i < of.count;
             i += telling_groups * telling_threads) {
            if ((which[i] & 1) == 0) continue;
            Result const one = load_words(of.of + i);
            if (one.has_a_place()) {
                std::uint32_t const at = atomicAdd(listed_count, 1u);
                if (at >= room) continue;
                listed[at].group = i;
                store_words(one, &listed[at].result);
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
        mine =
            merged_in_warp(threadIdx.x < telling_threads / 32 ? load_shared(parts + threadIdx.x) : Result{});
        if (threadIdx.x == 0) store_words(mine, rest + group);
    }
};

/// What all devices have told of a loop, each so many bytes behind the one before.
struct ToldByDevices
{
    unsigned char const* first;
    std::uint32_t const* count; ///< of listed results
    std::size_t stride;
    std::uint32_t devices, room;

    __device__ unsigned char const* of(std::uint32_t device) const { return first + device * stride; }
    __device__ std::uint32_t count_of(std::uint32_t device) const
    {
        return *reinterpret_cast<std::uint32_t const*>(reinterpret_cast<unsigned char const*>(count) +
                                                       device * stride);
    }
};

/// What all devices have told of a loop is merged as one device would have done that had found it.
template <class Result>
struct MergeTold
{
    ToldByDevices told{};
    ResultsOfGroups<Result> results{}; ///< with no groups, nothing is told
    std::uint32_t* held = nullptr;     ///< see Partial

    static constexpr unsigned putting_threads = 128, merging_threads = 128;
    /// How many groups of threads put results.
    unsigned groups_that_put() const
    {
        return results.groups == 0 ? 0 : groups_of(std::size_t(told.devices) * told.room, putting_threads);
    }

    /// How many merge them.
    unsigned groups_that_merge() const
    {
        return results.groups == 0 ? 0 : groups_of(std::size_t(results.bunches()) * 32, merging_threads);
    }

    /// Puts the results that devices have listed to their groups.
    __device__ void put(std::uint32_t group) const
    {
        if (results.groups == 0) return;
        std::uint32_t const i = group * putting_threads + threadIdx.x, device = i / told.room,
                            at = i % told.room;
        if (device >= told.devices || at >= told.count_of(device)) return;
        auto const* const listed =
            reinterpret_cast<ResultOfGroup<Result> const*>(told.of(device) + Telling<Result>::listed) + at;
        store_words(load_words(&listed->result), results.of_groups + listed->group);
    }

    /// Merges the results of all groups on a warp for each bunch. The groups are left with no results.
    __device__ void merge(std::uint32_t b) const
    {
        if (results.groups == 0 || b >= results.bunches()) return;
        bool any = false; // else there is nothing but what has no place
        for (std::uint32_t device = 0; device < told.devices; ++device)
            any = any || told.count_of(device) > 0;
        if (b > 0 && !any) return;
        std::uint32_t const first = b * results.bunch, lane = threadIdx.x % 32;
        if (b == 0) {
            Result rest{};
            for (std::uint32_t device = 0; device < told.devices; ++device)
                if (lane < telling_groups)
                    rest.merge(load_words(reinterpret_cast<Result const*>(told.of(device)) + lane));
            rest = merged_in_warp(rest);
            if (lane == 0) *held = any ? results.bunches() : 1;
            if (!any) {
                if (lane == 0) store_words(rest, results.of_bunches);
                return;
            }
            if (lane == 0) { // comes with the first group's
                Result of_first = load_words(results.of_groups);
                of_first.merge(rest);
                store_words(of_first, results.of_groups);
            }
        }
        __syncwarp();
        results.merge_bunch(b);
        __syncwarp();
        for (std::uint32_t i = lane; i < results.size(b); i += 32)
            store_words(Result{}, results.of_groups + first + i);
    }
};
} // namespace detail

/// What the groups of threads of a loop have found on this device and, in the end, on all.
class ResultsOfDevices
{
    static constexpr std::uint32_t fewest = 256;

public:
    explicit ResultsOfDevices(Queue const& queue)
        : by_host(queue), queue_(queue), of_groups_(queue), of_bunches_(queue), held_(queue)
    {}

    ResultsByHost by_host; ///< where they are needed at once

    /// How many bytes a device tells, which is the same on all.
    template <class Result>
    std::size_t bytes() const
    {
        return detail::Telling<Result>::bytes(room_);
    }

    /// What tells the results of the groups for which `which[group]` is odd, at `to`. `count` is 0 before,
    /// and then says how many of them are listed.
    template <class Result>
    detail::TellResults<Result> tell(Results const& here, unsigned char const* which, std::uint32_t* count,
                                     unsigned char* to) const
    {
        return {here.partial<Result>(), which, room_, count, to};
    }

    /// What merges the results of `groups` groups on all devices: what all have told by tell(), each `stride`
    /// bytes behind the one before.
    template <class Result>
    detail::MergeTold<Result> merge(std::uint32_t groups, std::uint32_t devices, std::uint32_t const* count,
                                    unsigned char const* told, std::size_t stride)
    {
        OnDevice const device(queue_);
        detail::ResultsOfGroups<Result> results{};
        results.groups = groups;
        results.bunch = (groups + Results::most_bunches - 1) / Results::most_bunches;
        if (of_groups_.size() < groups * sizeof(Result) || of_ != &detail::kind_of<Result>) {
            of_ = &detail::kind_of<Result>;
            of_groups_.renew((groups + groups / 8) * sizeof(Result)); // all devices wait while one allocates
            std::size_t const all = of_groups_.memory() / sizeof(Result);
            of_groups_.renew(all * sizeof(Result));
            launch_after("fill", queue_, detail::fill<Result>, groups_of(all, 256), 256,
                         reinterpret_cast<Result*>(of_groups_.data()), all, Result{});
        }
        of_bunches_.renew(std::max(results.bunches() * sizeof(Result), of_bunches_.size()));
        held_.renew(1);
        results.of_groups = reinterpret_cast<Result*>(of_groups_.data());
        results.of_bunches = reinterpret_cast<Result*>(of_bunches_.data());
        return {{told, count, stride, devices, room_}, results, held_.data()};
    }

    /// When the host knows how many results each device has listed: whether there was room for all. There is
    /// then, or the next time. All devices have the same room.
    bool had_room(std::span<std::uint32_t const> counts)
    {
        std::uint32_t most = 0;
        for (auto const count : counts) most = std::max(most, count);
        bool const had = most <= room_;
        // shrinks slowly, since what touches an obstacle in one step mostly does in the next
        room_ = std::max({most + most / 4, room_ - room_ / 64, fewest});
        return had;
    }

    std::size_t memory() const
    {
        return of_groups_.memory() + of_bunches_.memory() + held_.memory() + by_host.memory();
    }

private:
    Queue queue_;
    Array<unsigned char> of_groups_, of_bunches_; ///< of all devices; those of groups are empty between calls
    Array<std::uint32_t> held_;                   ///< see Partial
    void const* of_ = nullptr;                    ///< which kind of results they are
    std::uint32_t room_ = fewest;                 ///< for so many listed results
};

} // namespace firn::cuda
