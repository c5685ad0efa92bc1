// SPDX-License-Identifier: MIT
#pragma once

#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/openmp/block_map.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace firn::openmp
{

/// The blocks of cells that hold items, in the order of their keys, and those before the last update().
template <int d>
class BlockList
{
public:
    /// A block of cells with the items in it.
    struct Block
    {
        Coordinates<d> coordinates;
        std::uint32_t begin = 0, end = 0; ///< its slots
    };

    std::span<Block const> now() const { return blocks_; }
    std::span<Block const> before() const { return old_blocks_; }
    /// The block's index before the last update(), or absent.
    int old(std::size_t b) const { return old_block_[b]; }
    /// Whether an old block still holds items.
    bool stays(std::size_t old) const { return stay_[old] != 0; }
    /// Changes whenever the set of blocks does.
    std::uint64_t version() const { return version_; }

    /// Lists the blocks that will hold items when `lost(b)` items have left each block b and the flows have
    /// come. Each flow gets the index of its block. Returns whether the set of blocks has changed.
    template <class Flow, class Lost>
    bool update(std::span<Flow> flows, Lost const& lost)
    {
        std::swap(blocks_, old_blocks_);
        stay_.resize(old_blocks_.size());
        for (std::size_t b = 0; b < old_blocks_.size(); ++b)
            stay_[b] = old_blocks_[b].end - old_blocks_[b].begin - lost(b);
        list_blocks_with_items(flows);
        bool same = blocks_.size() == old_blocks_.size();
        for (std::size_t b = 0; same && b < blocks_.size(); ++b)
            same = is_same_block<d>(blocks_[b].coordinates, old_blocks_[b].coordinates);
        old_block_.assign(blocks_.size(), BlockMap::absent);
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            old_block_[b] = same ? int(b) : map_.find(block_key<d>(blocks_[b].coordinates));
        if (same) return false;
        list();
        for (Flow& flow : flows) flow.to = map_.find(flow.key);
        return true;
    }

    /// Finds the slots of the blocks; `come(b)` items come to block b from others.
    template <class Come>
    void find_slots(Come const& come)
    {
        std::uint32_t slot = 0;
        for (std::size_t b = 0; b < blocks_.size(); ++b) {
            std::uint32_t const total = old_block_[b] == BlockMap::absent
                                            ? static_cast<std::uint32_t>(come(b))
                                            : stay_[std::size_t(old_block_[b])];
            blocks_[b].begin = slot;
            blocks_[b].end = slot += total;
        }
    }

    /// Replaces the blocks by these, which are in the order of their keys and have slots.
    void replace(std::vector<Block> blocks)
    {
        old_blocks_ = std::exchange(blocks_, std::move(blocks));
        old_block_.resize(blocks_.size());
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            old_block_[b] = map_.find(block_key<d>(blocks_[b].coordinates));
        list();
    }

    std::size_t memory() const
    {
        auto const of = [](auto const& list) { return list.capacity() * sizeof(list[0]); };
        return of(blocks_) + of(old_blocks_) + of(fresh_) + of(stay_) + of(old_block_) + map_.memory();
    }

private:
    /// After the set of blocks has changed.
    void list()
    {
        map_.clear(blocks_.size());
        for (std::size_t b = 0; b < blocks_.size(); ++b)
            map_.insert(block_key<d>(blocks_[b].coordinates), int(b));
        ++version_;
    }

    /// Lists all blocks that will hold items, in the order of their keys; adds incoming items to `stay_` for
    /// blocks that exist already.
    template <class Flow>
    void list_blocks_with_items(std::span<Flow> flows)
    {
        auto& fresh = fresh_;
        fresh.clear();
        for (Flow& flow : flows) {
            flow.to = map_.find(flow.key);
            if (flow.to == BlockMap::absent)
                fresh.push_back(flow.key);
            else
                stay_[std::size_t(flow.to)] += flow.count;
        }
        std::sort(fresh.begin(), fresh.end());
        fresh.erase(std::unique(fresh.begin(), fresh.end()), fresh.end());
        auto const& before = old_blocks_;
        blocks_.clear();
        blocks_.reserve(before.size() + fresh.size());
        // both lists are sorted; merged by hand, since std::inplace_merge takes long to compile
        auto added = fresh.begin();
        for (std::size_t b = 0; b < before.size(); ++b) {
            if (stay_[b] == 0) continue;
            auto const key = block_key<d>(before[b].coordinates);
            for (; added != fresh.end() && *added < key; ++added)
                blocks_.push_back({block_of_key<d>(*added)});
            blocks_.push_back({before[b].coordinates});
        }
        for (; added != fresh.end(); ++added) blocks_.push_back({block_of_key<d>(*added)});
    }

    std::uint64_t version_ = 0;
    std::vector<Block> blocks_, old_blocks_;
    std::vector<std::uint64_t> fresh_; ///< keys of blocks that were not there before
    std::vector<std::uint32_t> stay_;  ///< how many items each old block will hold
    std::vector<int> old_block_;       ///< per new block
    BlockMap map_;
};

} // namespace firn::openmp
