// SPDX-License-Identifier: MIT
#pragma once

#include <firn/distributed/communicator.hpp>
#include <firn/distributed/parcel.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

// How the results of loops are merged over all ranks, with the same bits for any number of them.
namespace firn::distributed
{

/// The values of all ranks, one rank's behind the other's.
template <class T, class C>
std::vector<T> of_all_ranks(C const& communicator, std::vector<T> const& own)
{
    Parcel parcel;
    put(parcel, own.data(), own.size());
    std::vector<T> all;
    for (Parcel const& of_rank : communicator.all_gather(parcel))
        for (Reader from(of_rank); !from.at_end();) all.push_back(from.template get<T>());
    return all;
}
template <class C>
std::size_t sum_of_ranks(C const& communicator, std::size_t own)
{
    std::size_t sum = 0;
    for (auto const of_rank : of_all_ranks(communicator, std::vector<std::uint64_t>{own}))
        sum += static_cast<std::size_t>(of_rank);
    return sum;
}

/// The result of a part of a loop, and where it comes in the order of all parts.
template <class Result>
struct Part
{
    std::uint64_t layer, key;
    Result result;

    bool operator<(Part const& other) const
    {
        return layer != other.layer ? layer < other.layer : key < other.key;
    }
};

/// A result that says whether it must be merged in its place among others; if not, the order does not matter.
template <class Result>
concept HasAPlace = requires(Result const& result)
{
    bool{result.has_a_place()};
};

/// The parts of all ranks that matter, in their order.
template <class Result, class C>
std::vector<Part<Result>> parts_of_ranks(C const& communicator, std::vector<Part<Result>> parts)
{
    Result const none{};
    if constexpr (HasAPlace<Result>) { // of the others one part of each rank is enough
        Part<Result> own{0, 0, none};
        std::erase_if(parts, [&](Part<Result> const& part) {
            if (part.result.has_a_place()) return false;
            own.result.merge(part.result);
            return true;
        });
        parts.push_back(own);
    }
    else
        std::erase_if(parts, [&](Part<Result> const& part) {
            return std::memcmp(static_cast<void const*>(&part.result), static_cast<void const*>(&none),
                               sizeof none) == 0;
        });
    auto all = of_all_ranks(communicator, parts);
    std::sort(all.begin(), all.end());
    return all;
}

/// Merges the results of the parts of all ranks, in the order of the parts.
template <class Result, class C>
Result merge_over_ranks(C const& communicator, std::vector<Part<Result>> parts)
{
    Result merged{};
    for (auto const& part : parts_of_ranks(communicator, std::move(parts))) merged.merge(part.result);
    return merged;
}

} // namespace firn::distributed
