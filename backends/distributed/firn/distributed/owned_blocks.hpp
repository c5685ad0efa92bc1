// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <vector>

namespace firn::distributed
{

/// The blocks of all ranks, and which of these each has, where all ranks number them alike.
class OwnedBlocks
{
public:
    /// The first `kept` blocks are as before, and have these behind them. `place(key)` is a block's place on
    /// the curve that ranks divide, and `owner(place)` the rank that has it.
    template <class Place, class Owner>
    void set(std::size_t kept, std::vector<std::uint64_t> const& keys, Place const& place, Owner const& owner)
    {
        keys_.resize(kept);
        places_.resize(kept);
        owners_.resize(kept);
        keys_.insert(keys_.end(), keys.begin(), keys.end());
        for (auto const key : keys) {
            places_.push_back(place(key));
            owners_.push_back(owner(places_.back()));
        }
        ++version_;
    }
    /// The listed blocks are left, in this order, which is theirs.
    void keep(std::span<std::uint32_t const> list)
    {
        for (std::size_t i = 0; i < list.size(); ++i) {
            keys_[i] = keys_[list[i]];
            places_[i] = places_[list[i]];
            owners_[i] = owners_[list[i]];
        }
        keys_.resize(list.size());
        places_.resize(list.size());
        owners_.resize(list.size());
        ++version_;
    }
    /// Ranks have other parts of the curve.
    template <class Owner>
    void divide(Owner const& owner)
    {
        for (std::size_t b = 0; b < places_.size(); ++b) owners_[b] = owner(places_[b]);
        ++version_;
    }

    std::span<std::uint64_t const> keys() const { return keys_; }
    std::span<std::uint64_t const> places() const { return places_; }
    std::span<int const> owners() const { return owners_; }
    std::uint64_t version() const { return version_; } ///< changes with them

    /// The number of an existing block.
    std::uint32_t find(std::uint64_t key) const
    {
        if (sorted_at_ != version_) {
            sorted_.resize(keys_.size());
            std::iota(sorted_.begin(), sorted_.end(), std::uint32_t(0));
            std::ranges::sort(sorted_, {}, [&](std::uint32_t block) { return keys_[block]; });
            sorted_at_ = version_;
        }
        return *std::ranges::lower_bound(sorted_, key, {}, [&](std::uint32_t block) { return keys_[block]; });
    }

private:
    std::vector<std::uint64_t> keys_, places_;
    std::vector<int> owners_;
    std::uint64_t version_ = 0;
    mutable std::vector<std::uint32_t> sorted_; ///< blocks by their keys, when they were last looked for
    mutable std::uint64_t sorted_at_ = 0;
};

} // namespace firn::distributed
