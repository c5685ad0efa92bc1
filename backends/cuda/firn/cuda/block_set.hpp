// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/array.hpp>

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

namespace firn::cuda
{

/// The index of a block that is not there.
inline constexpr std::uint32_t absent = ~std::uint32_t(0);

/// A set of blocks on a device, from their keys to their indices: open addressing, at most half full.
///
/// Loops look blocks up and request missing ones. New blocks are then numbered in the order of their keys,
/// whatever the order of the requests.
class BlockSet
{
    static constexpr std::uint64_t empty = ~std::uint64_t(0);

public:
    /// The set as loops see it.
    struct View
    {
        std::uint64_t* key;
        std::uint32_t* index;
        std::uint32_t mask;
        std::uint32_t* born;       ///< slots in the table of the new keys
        std::uint32_t* born_count; ///< how many; more than `room` if it was too small: the host makes room
                                   ///< and repeats the requests
        std::uint32_t room;

        __device__ std::uint32_t find(std::uint64_t wanted) const
        {
            std::uint32_t tries =
                0; // bounded: after more requests than there is room for, no slot may be empty
            for (std::uint32_t at = hash(wanted); tries <= mask; at = (at + 1) & mask, ++tries) {
                std::uint64_t const there = key[at];
                if (there == wanted) return index[at];
                if (there == empty) break;
            }
            return absent;
        }

        /// Adds a key unless it is there; it has no index yet.
        __device__ void want(std::uint64_t wanted) const
        {
            std::uint32_t tries = 0;
            for (std::uint32_t at = hash(wanted); tries <= mask; at = (at + 1) & mask, ++tries) {
                std::uint64_t const there = key[at];
                if (there == wanted) return;
                if (there != empty) continue;
                if (*static_cast<std::uint32_t volatile*>(born_count) > room) return;
                auto* const place = reinterpret_cast<unsigned long long*>(key + at);
                std::uint64_t const found = atomicCAS(place, empty, wanted);
                if (found == wanted) return;
                if (found != empty) continue;
                std::uint32_t const number = atomicAdd(born_count, 1u);
                if (number < room) born[number] = at;
                return;
            }
            atomicMax(born_count, room + 1);
        }

        __device__ std::uint32_t hash(std::uint64_t wanted) const
        {
            wanted *= 0x9e3779b97f4a7c15u; // 2^64 over the golden ratio: spreads neighbouring keys
            return static_cast<std::uint32_t>(wanted ^ (wanted >> 32)) & mask;
        }
    };

    explicit BlockSet(Queue const& queue);

    std::uint32_t size() const { return size_; }
    View view();
    std::uint64_t const* keys() const { return keys_.data(); }             ///< by index
    std::uint32_t const* born_count() const { return born_count_.data(); } ///< of requested blocks
    void download_keys(std::span<std::uint64_t> keys) const { download_keys(0, keys); }
    void download_keys(std::size_t first, std::span<std::uint64_t> keys) const
    {
        keys_.download(first, keys);
    }

    static constexpr std::size_t few = 1024; ///< blocks: 40 KB, so that no small scene stops to make room
    /// Makes room for this many blocks in all; forgets requests that are not numbered yet.
    void reserve(std::size_t blocks);
    /// Makes room for more than before, for at least `births` new blocks.
    void reserve_more(std::uint32_t births)
    {
        reserve(size_ + std::max<std::size_t>({2 * std::size_t(births), size_ / 8, few}));
    }
    /// Requests these blocks.
    void want(std::span<std::uint64_t const> keys);
    /// The keys of so many requests, in any order.
    std::vector<std::uint64_t> requested(std::uint32_t births);
    /// Starts to count requests.
    void expect_births();
    /// How many blocks are new; waits for the loops that request them.
    std::uint32_t births() const;
    /// Whether there was room for this many new blocks.
    bool has_room_for(std::uint32_t births) const { return births <= room(); }
    /// Numbers the new blocks.
    void number(std::uint32_t births);
    /// Keeps the blocks with these indices and renumbers them from 0 on.
    void keep(std::uint32_t const* indices, std::uint32_t count);
    /// Forgets all blocks.
    void clear() { size_ = 0; }

    std::size_t memory() const
    {
        return key_.memory() + index_.memory() + born_.memory() + keys_.memory() + keys_before_.memory() +
               born_count_.memory() + requests_.memory();
    }

private:
    std::uint32_t room() const { return static_cast<std::uint32_t>(keys_.size()) - size_; }

    Queue queue_;
    Array<std::uint64_t> key_;
    Array<std::uint32_t> index_, born_;
    Array<std::uint64_t> keys_, keys_before_;
    Array<std::uint32_t> born_count_;
    Array<std::uint64_t> requests_; ///< on their way to other devices, or from there, or sorted
    std::uint32_t size_ = 0;
};

namespace detail
{
inline constexpr unsigned numbering_threads = 256;

/// A new key, or the largest number behind the last one.
static __device__ std::uint64_t new_key(BlockSet::View const& set, std::uint32_t i, std::uint32_t births)
{
    return i < births ? set.key[set.born[i]] : ~std::uint64_t(0);
}
/// How many of a chunk of keys are below this one. If they are sorted, it takes eight steps to find out.
template <bool are_sorted>
__device__ std::uint32_t count_below(std::uint64_t const (&chunk)[numbering_threads], std::uint64_t key)
{
    std::uint32_t below = 0;
    if constexpr (are_sorted) {
#pragma unroll
        for (unsigned step = numbering_threads / 2; step > 0; step /= 2)
            if (chunk[below + step - 1] < key) below += step;
        return below + (chunk[below] < key);
    }
    else {
#pragma unroll 8
        for (unsigned j = 0; j < numbering_threads; ++j) below += chunk[j] < key;
        return below;
    }
}
/// Sorts each chunk of the new keys.
static __global__ void __launch_bounds__(numbering_threads)
    sort_births(BlockSet::View set, std::uint64_t* sorted, std::uint32_t births)
{
    __shared__ std::uint64_t near[numbering_threads];
    std::uint32_t const i = blockIdx.x * numbering_threads + threadIdx.x;
    std::uint64_t const mine = near[threadIdx.x] = new_key(set, i, births);
    __syncthreads();
    std::uint32_t const place = i < births ? count_below<false>(near, mine) : threadIdx.x;
    sorted[blockIdx.x * numbering_threads + place] = mine;
}
/// Gives each new key the index of its rank among the new keys. A group of threads compares its keys with all
/// others, one chunk at a time, and loads the next chunk meanwhile. Where keys are many, `sorted` has them
/// chunk by chunk.
template <bool are_sorted>
__global__ void __launch_bounds__(numbering_threads)
    number_births(BlockSet::View set, std::uint64_t const* sorted, std::uint64_t* keys, std::uint32_t size,
                  std::uint32_t births)
{
    __shared__ std::uint64_t near[numbering_threads];
    std::uint32_t const i = blockIdx.x * numbering_threads + threadIdx.x;
    auto const other = [&](std::uint32_t j) {
        if constexpr (are_sorted)
            return j < gridDim.x * numbering_threads ? sorted[j] : 0;
        else
            return new_key(set, j, births);
    };
    std::uint64_t const mine = new_key(set, i, births);
    std::uint64_t passing = other(threadIdx.x);
    std::uint32_t rank = size;
    for (std::uint32_t first = 0; first < births; first += numbering_threads) {
        near[threadIdx.x] = passing;
        __syncthreads();
        passing = other(first + numbering_threads + threadIdx.x);
        rank += count_below<are_sorted>(near, mine);
        __syncthreads();
    }
    if (i == 0) *set.born_count = 0;
    if (i >= births) return;
    set.index[set.born[i]] = rank;
    keys[rank] = mine;
}

static __global__ void want_keys(BlockSet::View set, std::uint64_t const* keys, std::uint32_t count)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) set.want(keys[i]);
}
static __global__ void copy_requests(BlockSet::View set, std::uint32_t count, std::uint64_t* to)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) to[i] = set.key[set.born[i]];
}

static __global__ void insert_keys(BlockSet::View set, std::uint64_t const* keys, std::uint32_t size)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i >= size) return;
    for (std::uint32_t at = set.hash(keys[i]);; at = (at + 1) & set.mask) {
        auto* const place = reinterpret_cast<unsigned long long*>(set.key + at);
        if (atomicCAS(place, ~0ull, static_cast<unsigned long long>(keys[i])) != ~0ull) continue;
        set.index[at] = i;
        return;
    }
}
static __global__ void copy_keys(std::uint64_t const* keys, std::uint32_t const* indices, std::uint32_t count,
                                 std::uint64_t* to)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) to[i] = keys[indices[i]];
}
} // namespace detail

inline BlockSet::BlockSet(Queue const& queue)
    : queue_(queue), key_(queue), index_(queue), born_(queue), keys_(queue), keys_before_(queue),
      born_count_(queue), requests_(queue)
{}

inline BlockSet::View BlockSet::view()
{
    return {key_.data(),  index_.data(),      static_cast<std::uint32_t>(key_.size() - 1),
            born_.data(), born_count_.data(), room()};
}

inline void BlockSet::reserve(std::size_t blocks)
{
    OnDevice const here(queue_);
    std::size_t slots = 64;
    while (slots < 2 * blocks) slots *= 2;
    if (std::size_t const before = keys_.size(); blocks > before) {
        keys_.resize(blocks);
        keys_.fill_bytes(before, blocks - before, 0xff); // so that the next growth copies initialised memory
    }
    born_.renew(keys_.size());
    born_count_.renew(1);
    key_.renew(std::max(slots, key_.size()));
    index_.renew(key_.size());
    key_.fill_bytes(0, key_.size(), 0xff);
    index_.fill_bytes(0, index_.size(), 0xff);
    expect_births();
    if (size_ == 0) return;
    launch_after("insert_keys", queue_, detail::insert_keys, groups_of(size_, 128), 128, view(), keys_.data(),
                 size_);
}

inline void BlockSet::want(std::span<std::uint64_t const> keys)
{
    if (keys.empty()) return;
    OnDevice const here(queue_);
    requests_.renew(keys.size());
    requests_.upload(0, keys);
    launch_after("want_keys", queue_, detail::want_keys, groups_of(keys.size(), 128), 128, view(),
                 requests_.data(), static_cast<std::uint32_t>(keys.size()));
}

inline std::vector<std::uint64_t> BlockSet::requested(std::uint32_t births)
{
    std::vector<std::uint64_t> keys(births);
    if (births == 0) return keys;
    OnDevice const here(queue_);
    requests_.renew(keys.size());
    launch_after("copy_requests", queue_, detail::copy_requests, groups_of(births, 128), 128, view(), births,
                 requests_.data());
    requests_.download(0, keys);
    return keys;
}

inline void BlockSet::expect_births() { born_count_.fill_bytes(0, 1, 0); }

inline std::uint32_t BlockSet::births() const
{
    std::uint32_t count = 0;
    born_count_.download(0, {&count, 1});
    return count;
}

inline void BlockSet::number(std::uint32_t births)
{
    if (births == 0) return;
    OnDevice const here(queue_);
    constexpr unsigned threads = detail::numbering_threads;
    unsigned const groups = groups_of(births, threads);
    auto const launch = [&](auto* loop) {
        launch_after("number_births", queue_, loop, groups, threads, view(), requests_.data(), keys_.data(),
                     size_, births);
    };
    if (groups <= 4)
        launch(detail::number_births<false>);
    else {
        requests_.renew(std::size_t(groups) * threads);
        launch_after("sort_births", queue_, detail::sort_births, groups, threads, view(), requests_.data(),
                     births);
        launch(detail::number_births<true>);
    }
    size_ += births;
}

inline void BlockSet::keep(std::uint32_t const* indices, std::uint32_t count)
{
    OnDevice const here(queue_);
    keys_before_.renew(keys_.size());
    launch_after("copy_keys", queue_, detail::copy_keys, groups_of(count, 128), 128, keys_.data(), indices,
                 count, keys_before_.data());
    std::swap(keys_, keys_before_);
    size_ = count;
    reserve(keys_.size());
}

} // namespace firn::cuda
