// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// The bits of a number with `gaps` zeros between one and the next.
template <int gaps>
constexpr std::uint64_t spread(std::uint64_t bits)
{
    static_assert(gaps == 1 || gaps == 2);
    if constexpr (gaps == 1) { // each step moves the upper half of all groups by half of their distance
        bits = (bits | bits << 16) & 0x0000ffff0000ffffu;
        bits = (bits | bits << 8) & 0x00ff00ff00ff00ffu;
        bits = (bits | bits << 4) & 0x0f0f0f0f0f0f0f0fu;
        bits = (bits | bits << 2) & 0x3333333333333333u;
        return (bits | bits << 1) & 0x5555555555555555u;
    }
    else {
        bits = (bits | bits << 32) & 0x001f00000000ffffu;
        bits = (bits | bits << 16) & 0x001f0000ff0000ffu;
        bits = (bits | bits << 8) & 0x100f00f00f00f00fu;
        bits = (bits | bits << 4) & 0x10c30c30c30c30c3u;
        return (bits | bits << 2) & 0x1249249249249249u;
    }
}

/// A block's place on a curve through all blocks, on which neighbours lie close together (Morton 1966): the
/// digits of its coordinates by turns.
template <int d>
std::uint64_t place_on_curve(Coordinates<d> const& block)
{
    constexpr int bits = block_key_bits<d>;
    std::uint64_t const key = block_key<d>(block), all = (std::uint64_t{1} << bits) - 1;
    std::uint64_t place = 0;
    for (int a = 0; a < d; ++a) place |= spread<d - 1>((key >> ((d - 1 - a) * bits)) & all) << (d - 1 - a);
    return place;
}

/// Which rank has which blocks of space: each has a part of the curve through all of them. All ranks know the
/// same partition.
class Partition
{
public:
    /// What a block counts beside its items: its nodes are updated, too.
    static constexpr std::uint64_t weight_of_block = 32; // items

    bool is_set() const { return is_set_; }
    /// The rank that has the block at a place on the curve; before it is set, rank 0 has all.
    int owner(std::uint64_t place) const
    {
        return static_cast<int>(std::upper_bound(begins_.begin(), begins_.end(), place) - begins_.begin());
    }

    /// Divides the curve so that each rank gets about as much: `places` are those of all items.
    void set(std::vector<std::uint64_t> places, int ranks)
    {
        std::sort(places.begin(), places.end());
        std::vector<Weight> weights;
        for (std::uint64_t const place : places) {
            if (weights.empty() || weights.back().place != place) weights.push_back({place, weight_of_block});
            ++weights.back().weight;
        }
        begins_ = divided(weights, ranks);
        is_set_ = true;
    }

    /// What a block on the curve counts.
    struct Weight
    {
        std::uint64_t place, weight;
    };
    /// Divides the curve anew by the weights of all blocks, if the heaviest part becomes lighter for it by a
    /// fiftieth. Returns whether it did.
    bool divide_anew(std::vector<Weight> weights, int ranks)
    {
        std::ranges::sort(weights, {}, &Weight::place);
        auto const heaviest = [&](std::vector<std::uint64_t> const& begins) {
            std::vector<std::uint64_t> of_rank(static_cast<std::size_t>(ranks), 0);
            for (auto const& [place, weight] : weights)
                of_rank[static_cast<std::size_t>(std::ranges::upper_bound(begins, place) - begins.begin())] +=
                    weight;
            return std::ranges::max(of_rank);
        };
        auto begins = divided(weights, ranks);
        if (heaviest(begins) * 50 > heaviest(begins_) * 49) return false;
        begins_ = std::move(begins);
        ++divisions_;
        return true;
    }
    /// How often that has been done.
    int divisions() const { return divisions_; }

    /// The most a rank may have beyond its share before the curve is divided anew.
    static constexpr double most_imbalance = 0.05;
    /// After how many steps that is looked at.
    static constexpr int steps_between_looks = 32;
    /// Whether it is time to look: to be asked once a step.
    bool is_due()
    {
        if (++steps_ < steps_between_looks) return false;
        steps_ = 0;
        return true;
    }

    /// Which of so many items a rank has; `place(i)` is that of an item. All ranks pass the same items; the
    /// first time space is divided by them.
    template <class C, class Place>
    std::vector<std::uint32_t> own(C const& communicator, std::size_t count, Place const& place)
    {
        std::vector<std::uint64_t> places(count);
        for (std::size_t i = 0; i < count; ++i) places[i] = place(i);
        if (!is_set_ && count > 0) set(places, communicator.size());
        std::vector<std::uint32_t> own;
        for (std::size_t i = 0; i < count; ++i)
            if (owner(places[i]) == communicator.rank()) own.push_back(static_cast<std::uint32_t>(i));
        return own;
    }

private:
    /// Where the parts of ranks 1, 2, … begin so that each has about as much; `weights` are by place.
    static std::vector<std::uint64_t> divided(std::span<Weight const> weights, int ranks)
    {
        std::uint64_t all = 0, before = 0;
        for (auto const& block : weights) all += block.weight;
        std::vector<std::uint64_t> begins;
        for (auto const& [place, weight] : weights) { // a block is in the part in which its middle lies
            auto const middle = 2 * before + weight;
            while (begins.size() + 1 < static_cast<std::size_t>(ranks) &&
                   middle * std::uint64_t(ranks) > 2 * all * (begins.size() + 1))
                begins.push_back(place);
            before += weight;
        }
        begins.resize(static_cast<std::size_t>(ranks - 1), ~std::uint64_t(0));
        return begins;
    }

    int steps_ = steps_between_looks;   ///< since it was looked at
    std::vector<std::uint64_t> begins_; ///< where the parts of ranks 1, 2, … begin
    bool is_set_ = false;
    int divisions_ = 0;
};

} // namespace firn::distributed
