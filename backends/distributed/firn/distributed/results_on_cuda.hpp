// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/results_of_devices.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/distributed/results_at_once.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <type_traits>
#include <vector>

// What the loops of a step have found on the devices of all ranks becomes known to all of them, once a step.
namespace firn::distributed
{

/// What a loop has found on this device and, in the end, on those of all ranks.
template <class Result>
struct Found
{
    using Type = Result;
    cuda::Results* here = nullptr; ///< null if there was nothing to find
    cuda::ResultsOfDevices* all = nullptr;
    unsigned char const* which = nullptr; ///< per group of threads: 1 if its result is this rank's
    cuda::Partial<Result> merged{};

    void tell() const
    {
        if (here) all->template tell<Result>(*here, which);
    }
    void put_told(Parcel& to) const
    {
        if (!here) return;
        auto const told = all->template told<Result>();
        put(to, static_cast<std::uint64_t>(told.size()));
        put(to, told.data(), told.size());
    }
    /// Merges what all ranks have told.
    void merge(std::vector<Reader>& told)
    {
        if (!here) return;
        std::vector<cuda::OfGroup<Result>> found(1, cuda::OfGroup<Result>{});
        for (Reader& of_rank : told) {
            auto const count = of_rank.template get<std::uint64_t>();
            found[0].result.merge(of_rank.template get<cuda::OfGroup<Result>>().result);
            std::size_t const before = found.size();
            found.resize(before + count - 1);
            of_rank.get(found.data() + before, count - 1);
        }
        auto const first =
            std::find_if(found.begin() + 1, found.end(), [](auto const& of) { return of.group == 0; });
        if (first != found.end()) { // what needs no place comes with the first group's
            first->result.merge(found[0].result);
            found.erase(found.begin());
        }
        merged = all->merge(here->count(), found);
    }
    /// Merges what all ranks have found at once, for what needs it within the step. Waits for the loop.
    template <class C>
    void share(C const& communicator)
    {
        if (here) merged = share_at_once<Result>(communicator, *here, which, all->by_host);
    }
};

/// Called when the items of all orders have moved. Waits for what loops have found, and merges it with what
/// those of all other ranks have. Returns false if a rank had no room for all of its leavers: items then have
/// to move once more.
template <class C, class Queue, class Order, std::size_t orders, class OfNodes, class... OfItems>
bool share_results(C const& communicator, Queue const& queue, std::array<Order*, orders> const& cells,
                   Found<OfNodes>& of_nodes, std::tuple<Found<OfItems>...>& of_items)
{
    auto const for_each_loop = [&](auto const& use) {
        use(of_nodes);
        std::apply([&](auto&... of) { (use(of), ...); }, of_items);
    };
    bool const are_more = communicator.size() > 1;
    if (are_more) for_each_loop([](auto const& found) { found.tell(); });
    for (auto* const order : cells) order->search();
    queue.wait();
    Parcel own;
    for (auto* const order : cells) order->put_searched(own);
    if (are_more) for_each_loop([&](auto const& found) { found.put_told(own); });
    auto const all = communicator.all_gather(own);
    std::vector<Reader> told(all.begin(), all.end());
    bool had_room = true;
    for (auto* const order : cells) had_room = order->hear(told) && had_room;
    if (!had_room) return false;
    for_each_loop([&](auto& found) {
        if (are_more)
            found.merge(told);
        else if (found.here)
            found.merged =
                found.here->template partial<typename std::remove_cvref_t<decltype(found)>::Type>();
    });
    for (auto* const order : cells) order->create_missing();
    return true;
}

} // namespace firn::distributed
