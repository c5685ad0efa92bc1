// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>

#include <cstdint>

// The key of a block of cells or nodes. It can represent all cells in the range that a backend states.
namespace firn
{

/// The bits of a key for each coordinate.
template <int d>
inline constexpr int block_key_bits = d == 3 ? 21 : 32;

/// The coordinates of a block as one number, in the same order (first axis first).
template <int d>
FIRN_HOST_DEVICE std::uint64_t block_key(Coordinates<d> const& block)
{
    constexpr int bits = block_key_bits<d>;
    std::uint64_t key = 0;
    for (int a = 0; a < d; ++a)
        key = (key << bits) |
              static_cast<std::uint64_t>(std::int64_t{block[a]} + (std::int64_t{1} << (bits - 1)));
    return key;
}

/// The coordinates of a block from its key.
template <int d>
FIRN_HOST_DEVICE Coordinates<d> block_of_key(std::uint64_t key)
{
    constexpr int bits = block_key_bits<d>;
    Coordinates<d> block;
    for (int a = d - 1; a >= 0; --a) {
        block[a] = static_cast<int>(static_cast<std::int64_t>(key & ((std::uint64_t{1} << bits) - 1)) -
                                    (std::int64_t{1} << (bits - 1)));
        key >>= bits;
    }
    return block;
}

} // namespace firn
