// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace firn::openmp
{

/// Divides the blocks among threads: each partition ends at the block boundary nearest to its share of items.
/// For `bounds` see parallel_for.
template <class Block>
void find_partitions(std::span<Block const> blocks, int threads, std::vector<std::uint32_t>& bounds)
{
    std::size_t const items = blocks.empty() ? 0 : blocks.back().end;
    bounds.assign(1, 0);
    std::uint64_t const of = static_cast<std::uint64_t>(threads);
    for (std::uint64_t part = 1; part < of; ++part) {
        auto const lies_before = [&](Block const& block) { // its middle
            return (std::uint64_t{block.begin} + block.end) * of < 2 * items * part;
        };
        auto const at = std::partition_point(blocks.begin() + bounds.back(), blocks.end(), lies_before);
        bounds.push_back(static_cast<std::uint32_t>(at - blocks.begin()));
    }
    bounds.push_back(static_cast<std::uint32_t>(blocks.size()));
}

} // namespace firn::openmp
