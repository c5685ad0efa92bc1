// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/migration.hpp>

#include <cstddef>
#include <cstdint>

// The memory on a device for what changes in cells, and for the items that leave them.
namespace firn::cuda::detail
{

/// The arrays of Changes.
struct ChangeArrays
{
    Array<std::uint32_t> stay, incoming, first_incoming, group_left, block_stay, block_arrived;

    explicit ChangeArrays(Queue queue)
        : stay(queue), incoming(queue), first_incoming(queue), group_left(queue), block_stay(queue),
          block_arrived(queue)
    {}

    /// Room for so many blocks of cells.
    void resize(std::uint32_t blocks)
    {
        std::uint32_t const cells = blocks * 64;
        stay.resize(cells);
        incoming.resize(cells);
        first_incoming.resize(cells);
        group_left.resize(blocks * 2);
        block_stay.resize(blocks);
        block_arrived.resize(blocks);
    }

    Changes view()
    {
        return {stay.data(),       incoming.data(),   first_incoming.data(),
                group_left.data(), block_stay.data(), block_arrived.data()};
    }

    std::size_t memory() const
    {
        return stay.memory() + incoming.memory() + first_incoming.memory() + group_left.memory() +
               block_stay.memory() + block_arrived.memory();
    }
};

/// The arrays of Leavers.
template <class Number>
struct LeaverArrays
{
    std::size_t most = 0;
    Array<LeaverCounters> counters;
    Array<std::uint32_t> slot, cell, next;
    Array<std::uint8_t> way;
    Array<Number> contribution;

    explicit LeaverArrays(Queue queue)
        : counters(queue), slot(queue), cell(queue), next(queue), way(queue), contribution(queue)
    {}

    void renew(std::size_t room, int channels)
    {
        most = room;
        if (counters.size() == 0) {
            counters.renew(1);
            counters.fill_bytes(0, 1, 0);
        }
        for (auto* const array : {&slot, &cell, &next}) make_room(*array, room);
        make_room(way, room);
        make_room(contribution, room * static_cast<std::size_t>(channels));
    }

    /// The same, and keeps the leavers that are listed.
    void grow(std::size_t room, int channels)
    {
        if (room <= most) return;
        std::size_t const before = most;
        most = room;
        for (auto* const array : {&slot, &cell, &next}) array->resize(room, before);
        way.resize(room, before);
        contribution.resize(room * static_cast<std::size_t>(channels),
                            before * static_cast<std::size_t>(channels));
    }

    /// Room for `more` behind those, which are not listed as leavers are; keeps these.
    void make_room_behind(std::size_t more, int channels)
    {
        std::size_t const room = most + more;
        if (room <= slot.size()) return;
        for (auto* const array : {&slot, &cell, &next}) array->resize(room, most);
        way.resize(room, most);
        contribution.resize(room * static_cast<std::size_t>(channels),
                            most * static_cast<std::size_t>(channels));
    }

    /// For exactly `room` elements: callers have added the spare.
    template <class T>
    static void make_room(Array<T>& array, std::size_t room)
    {
        if (room <= array.size()) return;
        array.clear();
        array.resize(room);
    }

    Leavers<Number> view(int channels) const
    {
        auto const at = []<class T>(Array<T> const& array) { return const_cast<T*>(array.data()); };
        return {const_cast<LeaverCounters*>(counters.data()),
                static_cast<std::uint32_t>(most),
                channels,
                at(slot),
                at(cell),
                at(way),
                at(next),
                const_cast<Number*>(contribution.data())};
    }

    std::size_t memory() const
    {
        return slot.memory() + cell.memory() + way.memory() + next.memory() + contribution.memory();
    }
};

} // namespace firn::cuda::detail
