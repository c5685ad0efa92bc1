// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

// What an order of cells knows of items that have left their cells: in one block while it is being worked on
// (LeaverNotes), and then of each block until all have their places (Outgoing, Outflow).
namespace firn::openmp
{

/// The blocks about one, and itself: -1, 0 or 1 along each axis, the first one's place value the highest.
template <int d>
inline constexpr int directions = 3 * directions<d - 1>;
/// The end of the product: a point has itself alone.
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

/// Makes room in a list for more: there is one for each block, and together they would waste much if each
/// grew to twice its size.
template <class T>
void make_room(std::vector<T>& list, std::size_t more)
{
    std::size_t const needed = list.size() + more;
    if (needed > list.capacity()) list.reserve(std::max(needed, list.capacity() + list.capacity() / 8));
}

/// Adds some at the end of a list.
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
    std::uint16_t place;        ///< its cell now, in the block where that is
    std::uint16_t direction;    ///< in which that block lies, see neighbour()
    Number const* contribution; ///< what it gives, its offset in the new cell first
};

/// Where an item was that has left its cell.
struct Departure
{
    std::uint32_t slot;
    std::uint32_t at; ///< in its group: its rank times `lanes`, and its lane
};

/// Items of a block that have left their cells since the last follow(); the loops that move items write
/// this.
template <class Number>
struct Outgoing
{
    std::vector<Departure> from; ///< of all, in the order of slots
    std::vector<Leaver<Number>>
        scattered_inside;                ///< who is in another cell of the block and gave there, by cell
    std::vector<Leaver<Number>> leavers; ///< the others, by direction
    std::vector<Number> contribution;    ///< by them

    void clear()
    {
        from.clear();
        scattered_inside.clear();
        leavers.clear();
        contribution.clear();
    }
};

/// What of that is asked for block by block, in as few lines of the cache as there can be: another thread
/// has written them.
template <class Number, int d>
struct alignas(64) Outflow
{
    std::uint32_t outgoing = 0, inside = 0;        ///< how many there are in the first two lists
    Leaver<Number> const* leavers = nullptr;       ///< the third list, and
    std::array<std::uint32_t, directions<d>> to{}; ///< how many of it go in each direction
};

/// Those that have left their cells in one block, while it is being worked on: as they left, `count` of
/// them. (Lists of a thread, that stay as long as they once were: who leaves is noted without a
/// question.)
template <class Number>
struct LeaverNotes
{
    std::size_t count = 0, channels = 0;
    std::vector<Departure> from;
    std::vector<Leaver<Number>> leavers;
    std::vector<Number> contribution;             ///< so many channels of each, see Leaver
    std::vector<std::uint32_t> at;                ///< of all items of a group, see Departure
    std::vector<Leaver<Number>> inside, in_order; ///< who gives at once, as they left and by cell

    /// Begins with a block of so many items.
    void start(std::size_t items)
    {
        count = 0;
        if (from.size() < items) from.resize(items), leavers.resize(items);
    }
    /// Makes room for some more that give so many channels.
    void expect(std::size_t more, std::size_t of)
    {
        channels = of;
        if (contribution.size() < (count + more) * channels)
            contribution.resize(2 * (count + more) * channels);
    }
};

} // namespace firn::openmp
