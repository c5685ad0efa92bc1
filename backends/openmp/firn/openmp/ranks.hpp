// SPDX-License-Identifier: MIT
#pragma once

#include <firn/openmp/compress.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firn::openmp
{

/// The sources of a group's items while one thread changes them: a row of lanes for each rank.
template <int lanes>
class Ranks
{
public:
    /// Starts without items, in cells that had `before` of them. `counts` are the new numbers; items that
    /// leave are still in them and are subtracted later.
    void start(std::uint32_t const* before, std::uint32_t const* counts)
    {
        before_ = before;
        counts_ = counts;
        std::copy_n(before, lanes, end_.begin());
        first_hole_.fill(none);
        std::size_t const most = std::max(most_of<lanes>(before), most_of<lanes>(counts));
        if (at_.size() < most * lanes) at_.resize(most * lanes), next_hole_.resize(most * lanes);
    }

    std::uint32_t* row(std::uint32_t rank) { return &at_[std::size_t(rank) * lanes]; }

    /// Removes the item at `at`, a rank times `lanes` plus a lane; those of one cell come by rising rank.
    void leave(std::uint32_t at)
    {
        std::uint32_t const lane = at % lanes;
        (first_hole_[lane] == none ? first_hole_[lane] : next_hole_[last_hole_[lane]]) = at;
        last_hole_[lane] = at;
        next_hole_[at] = none;
        at_[at] = hole;
    }

    /// Puts a new item into the first hole of its cell, or behind its items.
    void fill(int lane, std::uint32_t source)
    {
        std::uint32_t const first = first_hole_[std::size_t(lane)];
        bool const is_behind = first == none;
        at_[is_behind ? end_[std::size_t(lane)] * lanes + std::uint32_t(lane) : first] = source;
        end_[std::size_t(lane)] += is_behind;
        first_hole_[std::size_t(lane)] = is_behind ? none : next_hole_[first];
    }

    /// Fills the remaining holes with the last items of their cells.
    void close_holes()
    {
        for (std::uint64_t fewer = lanes_above<lanes>(before_, counts_); fewer != 0; fewer &= fewer - 1) {
            auto const lane = static_cast<std::uint32_t>(std::countr_zero(fewer));
            std::uint32_t const end = counts_[lane] * lanes;
            std::uint32_t last = before_[lane] * lanes + lane;
            for (std::uint32_t at = first_hole_[lane]; at < end; at = next_hole_[at]) {
                do last -= lanes;
                while (at_[last] == hole);
                at_[at] = at_[last];
            }
        }
    }

private:
    static constexpr std::uint32_t hole = ~std::uint32_t(0), none = hole;

    std::uint32_t const *before_ = nullptr, *counts_ = nullptr;
    std::array<std::uint32_t, std::size_t(lanes)> end_; ///< behind the last rank of each cell
    std::array<std::uint32_t, std::size_t(lanes)> first_hole_, last_hole_;
    std::vector<std::uint32_t> at_, next_hole_;
};

} // namespace firn::openmp
