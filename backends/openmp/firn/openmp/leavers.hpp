// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

// What an order of cells records about items that have left their cells: in one block while a thread works on
// it (LeaverNotes), and then of each block until all are in the new order (Outgoing, Outflow).
namespace firn::openmp
{

/// The number of blocks around one, itself included: -1, 0 or 1 along each axis, the first axis in the
/// highest digit.
template <int d>
inline constexpr int directions = 3 * directions<d - 1>;
/// The end of the recursion.
template <>
inline constexpr int directions<0> = 1;
/// The direction of the block itself.
template <int d>
inline constexpr int here = directions<d> / 2;

/// The neighbour of a block that lies in a direction.
template <int d>
Coordinates<d> neighbour(Coordinates<d> block, int direction)
{
    for (int a = d - 1; a >= 0; --a, direction /= 3) block[a] += direction % 3 - 1;
    return block;
}

/// Makes room for more in a list. It grows by an eighth only: there is one list per block, and if each
/// doubled, together they would waste much memory.
template <class T>
void make_room(std::vector<T>& list, std::size_t more)
{
    std::size_t const needed = list.size() + more;
    if (needed > list.capacity()) list.reserve(std::max(needed, list.capacity() + list.capacity() / 8));
}

/// Appends items, and lets the list grow by an eighth at least.
template <class T>
void append(T const* from, std::size_t count, std::vector<T>& list)
{
    make_room(list, count);
    list.insert(list.end(), from, from + count);
}

/// An item that has changed its cell.
template <class Number>
struct Leaver
{
    std::uint32_t source;       ///< where the item lies
    std::uint16_t place;        ///< its new cell, by the place in its block
    std::uint16_t direction;    ///< of that block from the old one, see neighbour()
    Number const* contribution; ///< what it scatters, its offset in the new cell first
};

/// Where an item was before it left its cell.
struct OutgoingSlot
{
    std::uint32_t slot;
    std::uint32_t at; ///< in its group: its rank times `lanes`, and its lane
};

/// Items of a block that have left their cells since the last rebin(); written by the loops that move items.
template <class Number>
struct Outgoing
{
    std::vector<OutgoingSlot> from; ///< all of them, in the order of slots
    std::vector<Leaver<Number>>
        scattered_inside; ///< those in another cell of the block that have scattered there, by cell
    std::vector<Leaver<Number>> leavers; ///< the others, by direction
    std::vector<Number> contribution;    ///< of the others

    void clear()
    {
        from.clear();
        scattered_inside.clear();
        leavers.clear();
        contribution.clear();
    }
};

/// The part of that which is read block by block, in as few cache lines as possible: another thread has
/// written them.
template <class Number, int d>
struct alignas(64) Outflow
{
    std::uint32_t outgoing = 0, inside = 0;        ///< sizes of the first two lists
    Leaver<Number> const* leavers = nullptr;       ///< the third list
    std::array<std::uint32_t, directions<d>> to{}; ///< how many of these go in each direction
};

/// The leavers of one block while a thread works on it, `count` of them in the order in which they left. The
/// lists belong to the thread and never shrink, so that a leaver is recorded without checking for room.
template <class Number>
struct LeaverNotes
{
    std::size_t count = 0, channels = 0;
    std::vector<OutgoingSlot> from;
    std::vector<Leaver<Number>> leavers;
    std::vector<Number> contribution;             ///< `channels` numbers of each, see Leaver
    std::vector<std::uint32_t> at;                ///< for all items of a group, see OutgoingSlot
    std::vector<Leaver<Number>> inside, in_order; ///< those that scatter at once, as they left and by cell

    /// Starts a block of so many items.
    void start(std::size_t items)
    {
        count = 0;
        if (from.size() < items) from.resize(items), leavers.resize(items);
    }
    /// Makes room for some more leavers with so many channels.
    void expect(std::size_t more, std::size_t of)
    {
        channels = of;
        if (contribution.size() < (count + more) * channels)
            contribution.resize(2 * (count + more) * channels);
    }
};

} // namespace firn::openmp
