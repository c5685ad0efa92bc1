// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/block_key.hpp>
#include <firn/openmp/array.hpp>

#include <cstdint>

namespace firn::openmp
{

/// Whether two cells lie in one block.
template <int d>
bool is_same_block(Coordinates<d> const& a, Coordinates<d> const& b)
{
    return block_key<d>(a) == block_key<d>(b);
}

/// From a block's key to its index: open addressing, at most half full.
class BlockMap
{
public:
    static constexpr int absent = -1;

    void clear(std::size_t expected)
    {
        std::size_t size = 16;
        while (size < 2 * expected) size *= 2;
        slots_.resize(size, 0);
        slots_.fill(0, size, {0, absent});
        mask_ = size - 1;
    }

    /// Adds a key that is not there yet; clear() has made room for it.
    void insert(std::uint64_t key, int index)
    {
        std::size_t at = hash(key);
        while (slots_[at].index != absent) at = (at + 1) & mask_;
        slots_[at] = {key, index};
    }

    int find(std::uint64_t key) const
    {
        if (slots_.size() == 0) return absent;
        for (std::size_t at = hash(key);; at = (at + 1) & mask_)
            if (slots_[at].index == absent || slots_[at].key == key) return slots_[at].index;
    }

    std::size_t memory() const { return slots_.memory(); }

private:
    struct Slot
    {
        std::uint64_t key;
        int index;
    };

    std::size_t hash(std::uint64_t key) const
    {
        key *= 0x9e3779b97f4a7c15u; // 2^64 over the golden ratio: spreads neighbouring keys
        return (key ^ (key >> 32)) & mask_;
    }

    Array<Slot> slots_;
    std::size_t mask_ = 0;
};

} // namespace firn::openmp
