// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <cstddef>
#include <vector>

namespace firn
{

/// What one rank sends to another one.
using Parcel = std::vector<std::byte>;

/// What connects the ranks of a distributed solver: processes, or threads of one process. All ranks call the
/// same members in the same order, and each call returns when what it needs from the others has come.
///
/// A communicator is copied to all that uses it; its copies are one and the same. Where a rank cannot go on,
/// the calls of all ranks throw an Error, or the program ends: none waits for ever.
template <class C>
concept Communicator = std::copy_constructible<C> &&
    requires(C const communicator, std::vector<Parcel> const& to, Parcel const& own, char const* why)
{
    int{communicator.rank()}; // of the caller, from 0 on
    int{communicator.size()}; // how many ranks there are
    // sends `to[r]` to each rank r; returns, by rank, what came from it
    std::vector<Parcel>{communicator.exchange(to)};
    // returns what each rank passed, by rank
    std::vector<Parcel>{communicator.all_gather(own)};
    communicator.abort(why); // this rank cannot go on
};

} // namespace firn
