// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/results_of_devices.hpp>
#include <firn/cuda/share_step.hpp>
#include <firn/cuda/side_queue.hpp>
#include <firn/cuda/strays.hpp>
#include <firn/distributed/communicator.hpp>
#include <firn/distributed/exchange_on_cuda.hpp>
#include <firn/distributed/results_at_once_on_cuda.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

// What the loops of a step have found on the devices of all ranks becomes known to all of these, once a step
// and behind what is queued. The host waits for it when it waits for the end of the step.
namespace firn::distributed
{

/// What a loop has found on this device and, in the end, on those of all ranks.
template <class ResultType>
struct Found
{
    using Result = ResultType;
    cuda::Results* here = nullptr; ///< null if there was nothing to find
    cuda::ResultsOfDevices* all = nullptr;
    unsigned char const* which = nullptr; ///< per group of threads: odd if its result is this rank's
    cuda::Partial<Result> merged{};

    /// Merges what all ranks have found at once, for what needs it within the step. Waits for the loop.
    template <class C>
    void share(C const& communicator)
    {
        if (here) merged = share_at_once<Result>(communicator, *here, which, all->by_host);
    }
};

/// What the search for new cells has found on each rank, and how many items it sends to each.
class SearchOfRanks
{
public:
    /// How many words one rank's is.
    static std::size_t words(int ranks) { return words_of_searched + static_cast<std::size_t>(ranks); }

    /// One rank's begins `stride` words behind the one before.
    SearchOfRanks(std::uint32_t const* first, std::size_t stride) : first_(first), stride_(stride) {}

    cuda::detail::Searched const& of(int rank) const
    {
        return *reinterpret_cast<cuda::detail::Searched const*>(at(rank));
    }
    std::uint32_t leaving(int rank, int to) const { return at(rank)[words_of_searched + std::size_t(to)]; }

    static constexpr std::size_t words_of_searched = sizeof(cuda::detail::Searched) / sizeof(std::uint32_t);

private:
    std::uint32_t const* at(int rank) const { return first_ + static_cast<std::size_t>(rank) * stride_; }

    std::uint32_t const* first_;
    std::size_t stride_;
};

/// Shares the results of a step. Each rank tells as many bytes: at first, for each order of cells, what the
/// search for new cells has found, and how many results of each loop are listed; then these. Beside that go
/// the strays, if there is room for them in messages of a length that ranks have agreed on.
class SharedResults
{
public:
    explicit SharedResults(cuda::Queue const& queue)
        : queue_(queue), side_(queue), own_(queue), all_(queue), heads_(queue), exchange_(queue)
    {}

    /// Called when the items of all orders have moved: queues the search for their new cells, what this rank
    /// tells, and merging what all have told. `again`: since more was listed than there was room for; new
    /// cells have been found.
    template <class C, class Order, std::size_t orders, class OfNodes, class OfItems, class... Others>
    void share(C const& communicator, std::array<Order*, orders> const& cells, Found<OfNodes>& of_nodes,
               std::tuple<Found<OfItems>, Others...>& of_items, bool again)
    {
        static_assert(orders == 1 + sizeof...(Others));
        cuda::OnDevice const here(queue_);
        auto const ranks = static_cast<std::uint32_t>(communicator.size());
        std::size_t const of_order = SearchOfRanks::words(communicator.size()), searches = orders * of_order,
                          words = searches + 1 + orders;
        std::size_t const head = (words * sizeof(std::uint32_t) + 15) / 16 * 16;
        std::size_t bytes = head;
        bool const are_more = ranks > 1;
        if (are_more)
            for_each_loop(of_nodes, of_items, [&]<class Result>(Found<Result>& of, std::size_t) {
                if (of.here) bytes += of.all->template bytes<Result>();
            });
        own_.resize(bytes, std::min(head, own_.size()));
        auto* const told = reinterpret_cast<std::uint32_t*>(own_.data());
        if (std::exchange(cleared_, 0) < head) own_.fill_bytes(0, head, 0);
        if (again) // the host has heard it
            cuda::copy_queued(queue_, told,
                              heads_.get<std::uint32_t const>() + std::size_t(communicator.rank()) * words,
                              searches);

        std::size_t next = head;
        cuda::detail::TellStep<OfNodes, OfItems, orders> tell{};
        if (are_more) {
            for_each_loop(of_nodes, of_items, [&]<class Result>(Found<Result>& of, std::size_t loop) {
                if (!of.here) return;
                loop_of<Result>(tell, loop) = of.all->template tell<Result>(
                    *of.here, of.which, told + searches + loop, own_.data() + next);
                next += of.all->template bytes<Result>();
            });
            // beside the search, and not a part of it: see TellStep
            cuda::Queue const beside = side_.begin();
            cuda::OnDevice const with(beside);
            cuda::launch_after("tell_step", beside, cuda::detail::tell_step<OfNodes, OfItems, orders>,
                               tell.groups, cuda::detail::telling_threads, tell);
        }
        if (!again) search(cells, told, of_order);
        std::vector<DeviceMessage> to, from; // of strays
        bool are_packed = false;             // some, on any rank
        if (are_more && !again)
            for (std::size_t k = 0; k < orders; ++k)
                are_packed = cells[k]->pack_early(told + k * of_order, to, from) || are_packed;
        if (are_more) side_.end();
        unsigned char const* all = own_.data();
        if (are_more) {
            all_.renew(bytes * ranks);
            bytes_ = bytes;
            exchange_.gather(communicator, own_.data(), bytes, all_.data(), are_packed, to, from);
            all = all_.data();
        }

        cuda::detail::HearStep<OfNodes, OfItems, orders> hear{};
        next = head;
        for_each_loop(of_nodes, of_items, [&]<class Result>(Found<Result>& of, std::size_t loop) {
            if (!of.here) return;
            if (!are_more) {
                of.merged = of.here->template partial<Result>();
                return;
            }
            auto const* const counts = reinterpret_cast<std::uint32_t const*>(all) + searches + loop;
            auto& merge = loop_of<Result>(hear, loop);
            merge = of.all->template merge<Result>(of.here->count(), ranks, counts, all + next, bytes);
            of.merged = {merge.results.of_bunches, merge.results.bunches(), merge.held};
            next += of.all->template bytes<Result>();
        });
        hear.set_groups();
        words_ = words;
        cuda::detail::Heads const heads{all,
                                        bytes,
                                        words,
                                        ranks,
                                        heads_.as<std::uint32_t>(words * ranks),
                                        told,
                                        head / sizeof(std::uint32_t)};
        constexpr unsigned loops = 1 + orders;
        cuda::launch_after("hear_step", queue_, cuda::detail::hear_step<OfNodes, OfItems, orders>,
                           ranks + loops * hear.putting, cuda::detail::MergeTold<OfNodes>::putting_threads,
                           hear, heads);
        if (hear.merging > 0)
            cuda::launch_after("merge_step", queue_, cuda::detail::merge_step<OfNodes, OfItems, orders>,
                               loops * hear.merging, cuda::detail::MergeTold<OfNodes>::merging_threads, hear);
        cleared_ = head;
    }

    /// Called when the step is queued as a whole: lets orders go on with what has come to them.
    template <class Order, std::size_t orders>
    void go_on_early(std::array<Order*, orders> const& cells) const
    {
        for (std::size_t k = 0; k < orders; ++k)
            cells[k]->take_in_early(reinterpret_cast<std::uint32_t const*>(all_.data()) +
                                        k * SearchOfRanks::words(cells[k]->communicator().size()),
                                    bytes_ / sizeof(std::uint32_t));
    }

    /// Called when the host has waited, while all ranks have had room for their leavers: whether there was
    /// room for all that was listed. There is if it is shared again.
    template <class C, class OfNodes, class OfItems>
    bool had_room(C const& communicator, Found<OfNodes>& of_nodes, OfItems& of_items)
    {
        if (communicator.size() == 1) return true;
        bool had = true;
        for_each_loop(of_nodes, of_items, [&](auto& of, std::size_t loop) {
            if (!of.here) return;
            std::vector<std::uint32_t> counts;
            for (int rank = 0; rank < communicator.size(); ++rank)
                counts.push_back(heads_.get<std::uint32_t>()[std::size_t(rank) * words_ + words_ -
                                                             (1 + std::tuple_size_v<OfItems>)+loop]);
            had = of.all->had_room(counts) && had;
        });
        return had;
    }
    /// What the search has found for an order of cells.
    SearchOfRanks search(std::size_t order, int ranks) const
    {
        return {heads_.get<std::uint32_t>() + order * SearchOfRanks::words(ranks), words_};
    }

    std::size_t memory() const { return own_.memory() + all_.memory(); }

private:
    template <class OfNodes, class OfItems, class Use>
    static void for_each_loop(OfNodes& of_nodes, OfItems& of_items, Use const& use)
    {
        use(of_nodes, std::size_t{0});
        std::size_t loop = 0;
        std::apply([&](auto&... of) { (use(of, ++loop), ...); }, of_items);
    }

    /// Queues the search for the new cells of all orders' items.
    template <class Order, std::size_t orders>
    void search(std::array<Order*, orders> const& cells, std::uint32_t* told, std::size_t of_order)
    {
        std::array<decltype(cells[0]->search(told)), orders> search{};
        unsigned each = 0;
        for (std::size_t k = 0; k < orders; ++k) {
            search[k] = cells[k]->search(told + k * of_order);
            each = std::max(each, search[k].groups());
        }
        if (each > 0)
            cuda::launch_after(
                "search_step", queue_, cuda::detail::search_step<decltype(cells[0]->search(told)), orders>,
                static_cast<unsigned>(orders) * each, cuda::detail::searching_threads, search, each);
    }
    /// What is to be done with the results of a loop of this number, in a step.
    template <class Result, class Step>
    static auto& loop_of(Step& step, std::size_t loop)
    {
        if constexpr (std::is_same_v<decltype(step.nodes), std::remove_cvref_t<decltype(step.items[0])>>)
            return loop == 0 ? step.nodes : step.items[loop - 1];
        else if constexpr (std::is_same_v<Result, typename Step::OfNodes>)
            return step.nodes;
        else
            return step.items[loop - 1];
    }

    cuda::Queue queue_;
    cuda::SideQueue side_;
    cuda::Array<unsigned char> own_, all_;
    std::size_t bytes_ = 0;   ///< of each rank in these
    std::size_t cleared_ = 0; ///< bytes at the beginning of what this rank tells that are 0
    cuda::HostMemory heads_;  ///< what each rank tells at first
    std::size_t words_ = 0;   ///< of one rank
    DeviceExchange exchange_;
};

} // namespace firn::distributed
