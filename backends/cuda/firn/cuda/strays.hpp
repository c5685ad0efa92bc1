// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/migration.hpp>

#include <cstddef>
#include <cstdint>

// Where several devices share an order of cells: the items that leave for blocks which another device has,
// and those that come from there.
namespace firn::cuda::detail
{

/// A leaver whose new cell is not here.
struct Stray
{
    std::uint32_t leaver, slot;
    std::uint32_t cell, way; ///< where it came from, and where it goes: see Leavers
    std::uint32_t block;     ///< its new one, or absent if that does not exist
};

/// Finds the new cells of leavers, and lists those whose blocks are not here.
template <int d, class Number>
__global__ void find_cells_here(Leavers<Number> leavers, std::uint32_t count, Destinations<d> to,
                                unsigned char const* here, Stray* strays, std::uint32_t* stray_count)
{
    std::uint32_t const leaver = blockIdx.x * blockDim.x + threadIdx.x;
    if (leaver >= count) return;
    std::uint32_t const from = leavers.cell[leaver], way = leavers.way[leaver];
    std::uint32_t block = from / BlockShape<d>::cells;
    WayOut<d> const out(from % BlockShape<d>::cells, way);
    if (out.leaves_block) {
        Coordinates<d> const there = block_of_key<d>(to.keys[block]) + out.beyond;
        block = to.set.find(block_key<d>(to.periods.wrapped(there)));
        if (block == absent || here[block] == 0) {
            strays[atomicAdd(stray_count, 1u)] = {leaver, leavers.slot[leaver], from, way, block};
            return;
        }
    }
    arrive(leavers, to.changes, leaver, block, out.place);
}

/// Leavers, of which those from `first` on came from other devices.
template <class Number>
struct LeaversOfDevices : Leavers<Number>
{
    std::uint32_t first;
    std::uint64_t const* origins; ///< of those that came
    std::uint32_t* spare;         ///< as much room as there are leavers

    /// The block that an item left, and its slot in the order there: whatever device has it, this is the
    /// order in which one device alone would have had them.
    FIRN_HOST_DEVICE static std::uint64_t origin_of(std::uint32_t block, std::uint32_t slot)
    {
        return std::uint64_t{block} << 32 | slot;
    }
    __device__ std::uint64_t origin(std::uint32_t leaver, std::uint32_t where) const
    {
        return leaver < first ? origin_of(this->cell[leaver] / 64, where) : origins[leaver - first];
    }
    std::uint32_t* scratch() const { return spare; }
};

/// Lets items that came from other devices into their cells.
template <class Number>
__global__ void admit(LeaversOfDevices<Number> leavers, std::uint32_t count, std::uint32_t const* cells,
                      Changes changes)
{
    std::uint32_t const i = blockIdx.x * blockDim.x + threadIdx.x;
    if (i < count) arrive<Number>(leavers, changes, leavers.first + i, cells[i] / 64, cells[i] % 64);
}

/// Copies the contributions of listed leavers.
template <class Number>
__global__ void pick_contributions(Leavers<Number> leavers, std::uint32_t const* listed, std::size_t count,
                                   Number* to)
{
    std::size_t const i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    auto const channels = static_cast<std::size_t>(leavers.channels);
    if (i < count * channels) to[i] = leavers.contribution[listed[i / channels] * channels + i % channels];
}

/// Items that lay at places from `first` on lie at `place[where it lay - first]` now.
static __global__ void relocate(std::uint32_t* where, std::size_t count, std::uint32_t first,
                                std::uint32_t const* place)
{
    std::size_t const i = std::size_t(blockIdx.x) * blockDim.x + threadIdx.x;
    if (i < count && where[i] >= first) where[i] = place[where[i] - first];
}

} // namespace firn::cuda::detail
