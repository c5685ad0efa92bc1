// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/results_by_host.hpp>
#include <firn/distributed/parcel.hpp>

#include <vector>

namespace firn::distributed
{

/// Merges at once what a loop has found on the devices of all ranks: this rank's results are those of the
/// groups of threads for which `which[group]` is odd. Waits for the loop.
template <class Result, class C>
cuda::Partial<Result> share_at_once(C const& communicator, cuda::Results const& here,
                                    unsigned char const* which, cuda::ResultsByHost& by_host)
{
    if (communicator.size() == 1) return here.template partial<Result>();
    auto const own = by_host.template found<Result>(here, which);
    Parcel parcel;
    put(parcel, own.data(), own.size());
    std::vector<cuda::ResultOfGroup<Result>> all;
    for (Parcel const& of_rank : communicator.all_gather(parcel))
        for (Reader from(of_rank); !from.at_end();)
            all.push_back(from.template get<cuda::ResultOfGroup<Result>>());
    return by_host.merge(here.count(), all);
}

} // namespace firn::distributed
