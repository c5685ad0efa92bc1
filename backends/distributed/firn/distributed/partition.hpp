// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/world_layout.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <numeric>
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
/// Coordinates are from -2^(bits - 1) on.
template <int d>
std::uint64_t place_on_curve(Coordinates<d> const& block, int bits = block_key_bits<d>)
{
    std::uint64_t const all = (std::uint64_t{1} << bits) - 1;
    std::uint64_t place = 0;
    for (int a = 0; a < d; ++a) {
        auto const along =
            static_cast<std::uint64_t>(std::int64_t{block[a]} + (std::int64_t{1} << (bits - 1)));
        place |= spread<d - 1>(along & all) << (d - 1 - a);
    }
    return place;
}

/// The upper bits of a place that tell the world, where a lattice has many.
inline int bits_of_world(Lattice const& lattice, int d) { return lattice.world_bits * d; }

/// The curve through the blocks of a lattice. Where this has many worlds, the blocks of each world follow one
/// another, by the number of the world.
template <int d>
class Curve
{
public:
    /// Blocks have `extent(axis)` cells, a power of two.
    template <class Extent>
    Curve(Lattice const& lattice, Extent const& extent)
    {
        bits_of_world_ = bits_of_world(lattice, d);
        if (bits_of_world_ == 0) return;
        layout_ = WorldLayout<d>::of(lattice);
        int least = extent(0);
        for (int a = 0; a < d; ++a) {
            extent_[std::size_t(a)] = extent(a);
            least = std::min(least, extent(a));
        }
        for (bits_ = layout_.size_bits; least > 1; least /= 2) --bits_;
    }

    std::uint64_t place(Coordinates<d> block) const
    {
        if (bits_of_world_ == 0) return place_on_curve<d>(block);
        Coordinates<d> cell;
        for (int a = 0; a < d; ++a) cell[a] = block[a] * extent_[std::size_t(a)];
        std::uint32_t const world = layout_.world_of(cell);
        Coordinates<d> const centre = layout_.centre(world);
        for (int a = 0; a < d; ++a) block[a] -= centre[a] / extent_[std::size_t(a)];
        return (std::uint64_t{world} << (64 - bits_of_world_)) | place_on_curve<d>(block, bits_);
    }

private:
    WorldLayout<d> layout_{};
    std::array<int, std::size_t(d)> extent_{};
    int bits_ = 0; ///< of a block's coordinates in its world
    int bits_of_world_ = 0;
};

/// Which rank has which blocks of space: each has a part of the curve through all of them. All ranks know the
/// same partition.
class Partition
{
public:
    /// What a block counts beside its items: its nodes are updated, too.
    static constexpr std::uint64_t weight_of_block = 32; // items

    /// For the blocks of a lattice along so many axes.
    explicit Partition(Lattice const& lattice = {1}, int d = 3)
        : lattice_(lattice), bits_of_world_(bits_of_world(lattice, d))
    {}

    Lattice const& lattice() const { return lattice_; }
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

    /// Gives each rank about as many of the first `count` worlds, until items are counted.
    void share_worlds(std::uint32_t count, int ranks)
    {
        if (bits_of_world_ == 0) return; // there is one
        begins_.clear();
        for (std::uint64_t rank = 1, all = static_cast<std::uint64_t>(ranks); rank < all; ++rank) {
            std::uint64_t const first = (rank * count + all - 1) / all;
            begins_.push_back(first < count ? first << (64 - bits_of_world_) : ~std::uint64_t(0));
        }
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
        sort(weights);
        auto begins = divided(weights, ranks);
        if (heaviest(weights, begins) * 50 > heaviest(weights, begins_) * 49) return false;
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
    /// Sorts weights by their places, some digits after others, of those in which places differ: comparisons
    /// would take several times as long, and all ranks wait.
    static void sort(std::vector<Weight>& weights)
    {
        constexpr unsigned bits = 11;
        constexpr std::uint64_t last = (std::uint64_t{1} << bits) - 1;
        std::uint64_t differ = 0;
        for (auto const& of : weights) differ |= of.place ^ weights[0].place;
        std::vector<Weight> sorted(weights.size());
        for (unsigned from = 0; from < 64; from += bits) {
            if ((differ >> from & last) == 0) continue;
            std::array<std::size_t, last + 1> begins{};
            for (auto const& of : weights) ++begins[of.place >> from & last];
            std::exclusive_scan(begins.begin(), begins.end(), begins.begin(), std::size_t{0});
            for (auto const& of : weights) sorted[begins[of.place >> from & last]++] = of;
            weights.swap(sorted);
        }
    }
    static std::uint64_t heaviest(std::span<Weight const> weights, std::vector<std::uint64_t> const& begins)
    {
        std::vector<std::uint64_t> of_rank(begins.size() + 1, 0);
        for (auto const& [place, weight] : weights)
            of_rank[static_cast<std::size_t>(std::ranges::upper_bound(begins, place) - begins.begin())] +=
                weight;
        return std::ranges::max(of_rank);
    }

    /// Where the parts of ranks 1, 2, … begin so that each has about as much; `weights` are by place. Parts
    /// begin with a world, if they are hardly heavier for it: they have no border then.
    std::vector<std::uint64_t> divided(std::span<Weight const> weights, int ranks) const
    {
        if (bits_of_world_ == 0) return cut(weights, ranks);
        std::vector<Weight> worlds;
        std::uint64_t all = 0;
        for (auto const& [place, weight] : weights) {
            int const in_world = 64 - bits_of_world_;
            std::uint64_t const begin = place >> in_world << in_world;
            if (worlds.empty() || worlds.back().place != begin) worlds.push_back({begin, 0});
            worlds.back().weight += weight;
            all += weight;
        }
        auto begins = cut(worlds, ranks);
        bool const is_even = double(heaviest(worlds, begins)) * ranks <= (1 + most_imbalance) * double(all);
        return is_even ? begins : cut(weights, ranks);
    }
    static std::vector<std::uint64_t> cut(std::span<Weight const> weights, int ranks)
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

    Lattice lattice_;
    int bits_of_world_;
    int steps_ = steps_between_looks;   ///< since it was looked at
    std::vector<std::uint64_t> begins_; ///< where the parts of ranks 1, 2, … begin
    bool is_set_ = false;
    int divisions_ = 0;
};

} // namespace firn::distributed
