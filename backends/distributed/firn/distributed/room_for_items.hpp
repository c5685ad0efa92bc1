// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firn::distributed
{

/// For how many items messages between ranks have room that are sent before anybody knows how many there are.
/// All ranks get to know how many go from any one to any other, step by step, and so agree on it.
class RoomForItems
{
public:
    /// Messages for more than so many items gain nothing by being sent early.
    static constexpr std::uint32_t most = 1u << 15;
    /// Room is a multiple of this.
    static constexpr std::uint32_t unit = 16;

    explicit RoomForItems(int ranks) : ranks_(static_cast<std::size_t>(ranks)), of_(ranks_ * ranks_) {}

    /// For how many items there is room in messages from one rank to another; 0: there is no message.
    std::uint32_t operator()(int from, int to) const { return of_[at(from, to)].room; }
    bool is_any() const
    {
        return std::ranges::any_of(of_, [](Of const& one) { return one.room > 0; });
    }

    /// Takes note of a step in which `leaving(from, to)` items have gone.
    template <class Leaving>
    void count_step(Leaving const& leaving)
    {
        constexpr int often = 32;
        bool const shrinks = ++steps_ % often == 0;
        for (std::size_t i = 0; i < of_.size(); ++i) {
            auto& [room, largest] = of_[i];
            std::uint32_t const count = leaving(static_cast<int>(i / ranks_), static_cast<int>(i % ranks_));
            if (count <= most) largest = std::max(largest, count);
            if (count > room && count <= most) room = with_spare(count);
            if (!shrinks) continue;
            if (room > with_spare(largest + largest / 8)) room = with_spare(largest);
            largest = 0;
        }
    }

private:
    struct Of
    {
        std::uint32_t room = 0, largest = 0; ///< the most items of a step, of late
    };
    static std::uint32_t with_spare(std::uint32_t count)
    {
        return count == 0 ? 0 : (count + count / 8 + 2 * unit) / unit * unit;
    }
    std::size_t at(int from, int to) const
    {
        return static_cast<std::size_t>(from) * ranks_ + static_cast<std::size_t>(to);
    }

    std::size_t ranks_;
    std::vector<Of> of_;
    int steps_ = 0;
};

} // namespace firn::distributed
