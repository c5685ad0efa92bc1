// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/copy_elements.hpp>
#include <firn/cuda/strays.hpp>

#include <cstddef>
#include <cstdint>

// Strays are packed on the device as soon as they have been found, before the host knows how many there are.
namespace firn::cuda::detail
{

/// A message for another device: it has room for so many items, which is a multiple of 16.
struct MessageOfItems
{
    std::byte* data;
    std::uint32_t room;
};

/// What is packed of each item, or unpacked: elements of arrays, of which each has its section in a message.
/// `before` is how many bytes an item has in the sections before.
struct PackedArrays
{
    static constexpr unsigned most = 48;
    struct Of
    {
        unsigned char* elements;
        std::uint32_t bytes, before;
    };
    Of of[most];
};

/// What is packed of strays beside them: where they come from and their cells there, which are the first two
/// sections; and what they scatter, which is an array by leavers.
struct StraysToPack
{
    Stray const* list;
    std::uint32_t const* count;
    std::uint32_t const* owners; ///< which device has a block
    MessageOfItems const* to;    ///< by device
    std::uint32_t* places;       ///< where they lie, if there is room for them
    std::uint32_t most;          ///< room for so many there
};

/// Packs strays with `groups` groups of threads for each of the arrays, of which the first is by leavers, and
/// as many more. Those for which a message has no room are left out: the host hears of it.
template <int d, class Number>
__global__ void pack_strays(StraysToPack strays, PackedArrays arrays, unsigned groups)
{
    std::uint32_t const which = blockIdx.x / groups, count = *strays.count;
    for (std::uint32_t i = blockIdx.x % groups * blockDim.x + threadIdx.x; i < count;
         i += groups * blockDim.x) {
        Stray const stray = strays.list[i];
        if (which == 0 && i < strays.most) strays.places[i] = stray.slot;
        if (stray.block == absent) continue;
        MessageOfItems const message = strays.to[strays.owners[stray.block]];
        if (stray.at >= message.room) continue;
        if (which > 0) {
            PackedArrays::Of const& array = arrays.of[which - 1];
            copy_element(array.elements, which == 1 ? stray.leaver : stray.slot,
                         reinterpret_cast<unsigned char*>(message.data) +
                             std::size_t(message.room) * array.before,
                         stray.at, array.bytes);
            continue;
        }
        constexpr std::uint32_t of_block = BlockShape<d>::cells;
        WayOut<d> const out(stray.cell % of_block, stray.way);
        auto* const origins = reinterpret_cast<std::uint64_t*>(message.data);
        auto* const cells = reinterpret_cast<std::uint32_t*>(origins + message.room);
        origins[stray.at] = Leavers<Number>::origin_of(stray.way, stray.slot);
        cells[stray.at] = stray.block * of_block + out.place;
    }
}

/// What all devices have told of their searches for new cells: one's Searched, and behind it how many strays
/// go to each device; the next one's begin `stride` words further.
struct ToldOfStrays
{
    std::uint32_t const* first;
    std::size_t stride;
    std::uint32_t devices, own;

    __device__ Searched const& searched(std::uint32_t device) const
    {
        return *reinterpret_cast<Searched const*>(first + device * stride);
    }
    __device__ std::uint32_t leaving(std::uint32_t from, std::uint32_t to) const
    {
        return first[from * stride + sizeof(Searched) / sizeof(std::uint32_t) + to];
    }
};

/// Finds out whether some strays have not come with the messages that were packed early: these had room for
/// `rooms[from * devices + to]`.
static __global__ void look_for_strays_left(ToldOfStrays told, std::uint32_t const* rooms,
                                            std::uint32_t* are_any)
{
    bool any = false;
    for (std::uint32_t i = threadIdx.x; i < told.devices * told.devices; i += blockDim.x) {
        std::uint32_t const from = i / told.devices, to = i % told.devices;
        any = any || told.leaving(from, to) > rooms[i] || told.searched(from).births > 0 ||
              told.searched(from).lacks_room != 0;
    }
    any = __syncthreads_or(any);
    if (threadIdx.x == 0) *are_any = any;
}

/// Takes in what a message has brought, with `groups` groups of threads for each of its arrays, as
/// pack_strays() does: the items come to lie at `place` and behind it, one device's behind the other's.
template <class Number>
__global__ void take_in(std::uint32_t const* are_left, ToldOfStrays told, std::uint32_t sender,
                        MessageOfItems message, LeaversOfDevices<Number> leavers, Changes changes,
                        std::uint64_t* origins, std::uint32_t place, PackedArrays arrays, unsigned groups)
{
    if (*are_left != 0) return;
    std::uint32_t const i = blockIdx.x % groups * blockDim.x + threadIdx.x, which = blockIdx.x / groups;
    if (i >= told.leaving(sender, told.own)) return;
    std::uint32_t before = 0;
    for (std::uint32_t other = 0; other < sender; ++other) before += told.leaving(other, told.own);
    auto* const data = reinterpret_cast<unsigned char*>(message.data);
    if (which > 0) {
        PackedArrays::Of const& array = arrays.of[which - 1];
        copy_element(data + std::size_t(message.room) * array.before, i, array.elements,
                     (which == 1 ? leavers.first : place) + before + i, array.bytes);
        return;
    }
    auto const* const from = reinterpret_cast<std::uint64_t const*>(data);
    Admit<Number>{
        leavers, changes, from,          reinterpret_cast<std::uint32_t const*>(from + message.room),
        origins, before,  place + before}(i);
}

} // namespace firn::cuda::detail
