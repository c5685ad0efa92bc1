// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>

#include <cstdint>

namespace firn
{

/// Where the cells of many worlds lie in one lattice: each world has a cube of cells of its own, with the
/// origin in its middle. Cubes lie side by side along all axes, so that each of them is as large as possible.
template <int d>
struct WorldLayout
{
    /// Cells at the border of a cube that particles do not enter. No two worlds share a node then, and a lane
    /// of cells stays in its world.
    static constexpr int margin = 32;
    /// The most worlds: each has 2^15 cells along each axis then, and more in two dimensions.
    static constexpr std::uint32_t most = std::uint32_t{1} << 20;

    int bits = 0;       ///< there is room for 2^bits worlds along each axis
    int size_bits = 0;  ///< a cube has 2^size_bits cells along each axis
    int half_world = 0; ///< half of them

    /// The layout of so many worlds, where cells have coordinates up to the largest.
    static WorldLayout of(std::uint32_t count, double largest_coordinate)
    {
        WorldLayout layout{0, 1, 1};
        while (layout.bits * d < 32 && (std::uint64_t{1} << (layout.bits * d)) < count) ++layout.bits;
        // the cubes reach from -2^bits halves to 2^bits; the first has its origin in the lattice's
        double const halves = double((1 << layout.bits) + 1);
        while (2.0 * layout.half_world * halves < largest_coordinate)
            layout.half_world *= 2, ++layout.size_bits;
        return layout;
    }

    /// The layout of a lattice that has many worlds.
    static WorldLayout of(Lattice const& lattice)
    {
        WorldLayout layout{lattice.world_bits, 1, lattice.half_world};
        while ((1 << layout.size_bits) < 2 * layout.half_world) ++layout.size_bits;
        return layout;
    }

    /// The cell or node of the lattice that is a world's (0, 0, 0). World 0 has the lattice's own.
    FIRN_HOST_DEVICE Coordinates<d> centre(std::uint32_t world) const
    {
        Coordinates<d> cell;
        for (int a = 0; a < d; ++a) {
            int const along = 1 << bits, at = static_cast<int>(world >> (a * bits)) & (along - 1);
            cell[a] = (2 * at < along ? at : at - along) * 2 * half_world;
        }
        return cell;
    }

    /// The world in which a cell lies.
    FIRN_HOST_DEVICE std::uint32_t world_of(Coordinates<d> const& cell) const
    {
        std::uint32_t world = 0;
        for (int a = 0; a < d; ++a) {
            int const at = (cell[a] + half_world) >> size_bits; // rounds down
            world |= static_cast<std::uint32_t>(at & ((1 << bits) - 1)) << (a * bits);
        }
        return world;
    }
};

} // namespace firn
