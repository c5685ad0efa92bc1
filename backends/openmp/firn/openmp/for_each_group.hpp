// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/cell_group.hpp>
#include <firn/openmp/items.hpp>
#include <firn/openmp/tuning.hpp>

#include <cassert>
#include <cstddef>
#include <type_traits>

// How loops visit the groups of cells of a block.
namespace firn::openmp::detail
{

/// A group of cells. The type is the same for a const grid, so that the code inlined into it is compiled
/// once.
template <class Lane, class GridType>
using GroupOf = CellGroup<Lane, std::remove_const_t<GridType>>;

/// Calls `use(items, how many)` for the items of some groups of cells, each with its own nodes. Out of line:
/// it is rare, and stands between loops that are not.
template <class Lane, class GridType, class Order, class Number, class Use>
[[gnu::noinline]] void use_alone(Order const& cells, std::size_t b, std::size_t slot, std::size_t count,
                                 Scratch<Lane, GridType::dimension>& scratch, Number const* read,
                                 Number* write, Use const& use)
{
    assert(count > 0 && count <= lane_width<Lane> && "items that go alone are one pack");
    int places[lane_width<Lane>];
    cells.find_places(b, slot, static_cast<int>(count), places);
    ScatteredItems<Lane, std::remove_const_t<GridType>> items(places, static_cast<int>(count), scratch, read,
                                                              write);
    use(items, count);
}

/// Calls `use(group, number behind its last item)` for each non-empty group of cells from `first` up to
/// `behind`, or once for the items of all of them if these are few in many groups. The groups' items lie side
/// by side; `read` and `write` as in CellGroup.
template <class Lane, class GridType, class Order, class Number, class Use>
void for_each_group(Order const& cells, std::size_t b, int first, int behind,
                    Scratch<Lane, GridType::dimension>& scratch, Number const* read, Number* write,
                    Use const& use)
{
    std::size_t const begin = cells.group_begin(b, first);
    if constexpr (may_go_alone<GridType::dimension, lane_width<Lane>>)
        if (behind - first > 1) {
            std::size_t filled = 0;
            for (int g = first; g < behind; ++g) filled += cells.group_end(b, g) > cells.group_begin(b, g);
            if (go_alone(1, filled))
                return use_alone<Lane, GridType>(cells, b, begin, cells.group_end(b, behind - 1) - begin,
                                                 scratch, read, write, use);
        }
    for (int g = first; g < behind; ++g) {
        std::size_t const from = cells.group_begin(b, g), to = cells.group_end(b, g);
        if (from == to) continue;
        GroupOf<Lane, GridType> group(cells.counts(b, g), g, scratch, from - begin, read, write);
        use(group, to - begin);
    }
}

} // namespace firn::openmp::detail
