// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>
#include <utility>
#include <vector>

namespace firn::distributed
{

/// The blocks of all ranks, and which of these each has, where all ranks number them alike.
class OwnedBlocks
{
public:
    /// The first `kept` blocks are as before, and have these behind them. `owner(key)` is the rank that has a
    /// block.
    template <class Owner>
    void set(std::size_t kept, std::vector<std::uint64_t> const& keys, Owner const& owner)
    {
        keys_.resize(kept);
        owners_.resize(kept);
        keys_.insert(keys_.end(), keys.begin(), keys.end());
        for (auto const key : keys) owners_.push_back(owner(key));
        ++version_;
    }

    std::span<std::uint64_t const> keys() const { return keys_; }
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
    std::vector<std::uint64_t> keys_;
    std::vector<int> owners_;
    std::uint64_t version_ = 0;
    mutable std::vector<std::uint32_t> sorted_; ///< blocks by their keys, when they were last looked for
    mutable std::uint64_t sorted_at_ = 0;
};

} // namespace firn::distributed
