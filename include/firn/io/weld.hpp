// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <unordered_map>
#include <vector>

namespace firn::detail
{

/// Exact positions as a key; -0 is turned into 0, so that equal positions have equal bits.
struct WeldKey
{
    std::array<std::uint64_t, 3> bits;

    explicit WeldKey(Eigen::Vector3d const& x)
    {
        for (std::size_t i = 0; i < 3; ++i) bits[i] = std::bit_cast<std::uint64_t>(x[Eigen::Index(i)] + 0.0);
    }
    bool operator==(WeldKey const&) const = default;
};

struct WeldHash
{
    std::size_t operator()(WeldKey const& key) const
    {
        std::uint64_t hash = 0;
        for (auto const word : key.bits) {
            hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
            hash ^= hash >> 29;
        }
        return hash;
    }
};

/// Numbers positions in the order of their first occurrence.
class Weld
{
public:
    /// The number of this position, the same for all that are exactly equal.
    std::uint32_t operator()(Eigen::Vector3d const& x)
    {
        return known_.try_emplace(WeldKey{x}, static_cast<std::uint32_t>(known_.size())).first->second;
    }

    std::size_t size() const { return known_.size(); }

private:
    std::unordered_map<WeldKey, std::uint32_t, WeldHash> known_;
};

} // namespace firn::detail
