// SPDX-License-Identifier: MIT
#pragma once

#include <concepts>
#include <cstddef>
#include <span>
#include <vector>

namespace firn
{

/// What one rank sends to another one.
using Parcel = std::vector<std::byte>;

/// A part of a device's memory that goes to a rank, or that is to hold what comes from it.
struct DeviceMessage
{
    int rank;
    std::byte* data;
    std::size_t bytes;
};

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

/// A communicator that also sends what lies on devices, without the host: its calls queue that behind what is
/// in the stream of a device, and return at once. `exchange_on_device(stream, to, from)` sends messages and
/// receives others: both ranks of a message know how long it is, and those between two ranks are in the same
/// order on both. `gather_on_device(stream, own, bytes, all)` lets all ranks have what each has, as many
/// bytes of each, by rank. Ranks without messages make these calls, too. A communicator that does both at
/// once in less time has `gather_beside(stream, own, bytes, all, to, from)`, too. Other communicators get
/// copies in the host's memory.
template <class C, class Stream>
concept DeviceCommunicator = Communicator<C> &&
    requires(C const communicator, Stream const& stream, std::span<DeviceMessage const> messages,
             void const* own, std::size_t bytes, void* all)
{
    communicator.exchange_on_device(stream, messages, messages);
    communicator.gather_on_device(stream, own, bytes, all);
};

} // namespace firn
