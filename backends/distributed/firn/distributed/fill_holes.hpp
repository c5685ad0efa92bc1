// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// Lets the last of all items fill the places of those that are `gone`: `count` of `all` are left. They are
/// then at `place[where it lay - count]` in the order, and moved by `move(from, to)`.
template <class Order, class Move>
void fill_holes(Order& order, std::vector<std::uint32_t> const& gone, std::size_t all, std::uint32_t count,
                Move const& move)
{
    if (gone.empty()) return;
    std::vector<char> is_hole(all, 0);
    for (std::uint32_t const place : gone) is_hole[place] = 1;
    std::vector<std::uint32_t> from, to, place(all - count);
    std::uint32_t hole = 0;
    for (std::uint32_t at = count; at < all; ++at) {
        if (is_hole[at]) continue;
        while (!is_hole[hole]) ++hole;
        place[at - count] = hole;
        from.push_back(at);
        to.push_back(hole++);
    }
    order.relocate(count, place);
    move(std::as_const(from), std::as_const(to));
}

} // namespace firn::distributed
