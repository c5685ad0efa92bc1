// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// Lets the last of all items fill the places of those that are `gone`: `count` of `all` are left. They are
/// then at `place[where it lay - count]` in the order, and moved by `move(from, to)`. The work is that of few
/// items.
template <class Order, class Move>
void fill_holes(Order& order, std::vector<std::uint32_t> gone, std::size_t all, std::uint32_t count,
                Move const& move)
{
    if (gone.empty()) return;
    std::ranges::sort(gone);
    auto hole = gone.begin(), behind = std::ranges::lower_bound(gone, count); // those behind stay empty
    std::vector<std::uint32_t> from, to, place(all - count);
    for (std::uint32_t at = count; at < all; ++at) {
        if (behind != gone.end() && *behind == at) {
            ++behind;
            continue;
        }
        place[at - count] = *hole;
        from.push_back(at);
        to.push_back(*hole++);
    }
    order.relocate(count, place);
    move(std::as_const(from), std::as_const(to));
}

} // namespace firn::distributed
