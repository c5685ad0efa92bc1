// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>
#include <firn/cuda/parts_of_tiles.hpp>
#include <firn/distributed/communicator.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace firn::distributed
{

/// Parts of tiles by rank.
template <int d>
using PartsOfRanks = std::vector<std::vector<cuda::detail::PartOfTile<d>>>;

/// All of a block's tile, which has `width` nodes along each axis.
template <int d, int width>
cuda::detail::PartOfTile<d> whole_tile(std::uint32_t block)
{
    cuda::detail::PartOfTile<d> part{block, 0, {}, {}};
    part.end.fill(width);
    return part;
}

/// Parts of tiles that go to other ranks, or come from them, rank by rank.
template <int d>
class SwappedParts
{
    using Part = cuda::detail::PartOfTile<d>;

public:
    cuda::Array<Part> there;
    std::size_t count = 0;
    std::vector<std::size_t> begin{0}; ///< by rank: where its nodes begin among all

    explicit SwappedParts(cuda::Queue const& queue) : there(queue), queue_(queue), here_(queue) {}

    /// Adds what goes to each rank, or comes from it; `packed` are all parts.
    template <class Sums>
    void add_messages(std::vector<DeviceMessage>& to, cuda::Array<Sums>& packed) const
    {
        packed.renew_amply(begin.back());
        for (std::size_t r = 0; r + 1 < begin.size(); ++r)
            if (begin[r] < begin[r + 1])
                to.push_back({static_cast<int>(r), reinterpret_cast<std::byte*>(packed.data() + begin[r]),
                              (begin[r + 1] - begin[r]) * sizeof(Sums)});
    }
    /// Uploads what has been listed by rank. The host has waited since this was called last.
    void set(PartsOfRanks<d> const& of_ranks)
    {
        count = 0;
        for (auto const& of_rank : of_ranks) count += of_rank.size();
        if (count > room_) room_ = 2 * count; // all ranks wait while one allocates
        auto* const all = here_.template as<Part>(room_);
        auto* next = all;
        begin.assign(1, 0);
        for (auto const& of_rank : of_ranks) {
            begin.push_back(begin.back());
            for (Part part : of_rank) {
                part.first = static_cast<std::uint32_t>(begin.back());
                begin.back() += part.nodes();
                *next++ = part;
            }
        }
        there.renew_amply(count);
        cuda::copy_queued(queue_, there.data(), static_cast<Part const*>(all), count);
    }
    /// So many have been listed on the device, of so many nodes for each rank; returns whether there was
    /// room. There is then.
    bool had_room(std::size_t listed, std::vector<std::size_t> const& begins)
    {
        count = listed;
        begin = begins;
        if (count <= there.size()) return true;
        there.renew(2 * count);
        return false;
    }

private:
    cuda::Queue queue_;
    cuda::HostMemory here_; ///< one rank's behind the other's, on the way to the device
    std::size_t room_ = 0;  ///< for so many there
};

} // namespace firn::distributed
