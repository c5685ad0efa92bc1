// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>

#include <array>
#include <cstddef>
#include <string>

namespace firn
{

/// After how many cells, or blocks of cells, a lattice begins anew along each axis; 0: it is unbounded.
template <int d>
struct Periods
{
    std::array<int, std::size_t(d)> of{};

    /// The same coordinates in the first period.
    FIRN_HOST_DEVICE Coordinates<d> wrapped(Coordinates<d> at) const
    {
        for (int a = 0; a < d; ++a) {
            int const period = of[std::size_t(a)];
            if (period == 0) continue;
            at[a] %= period;
            if (at[a] < 0) at[a] += period;
        }
        return at;
    }

    /// The periods of blocks which have `extent(axis)` cells along an axis.
    template <class Extent>
    Periods in_blocks(Extent const& extent) const
    {
        Periods blocks;
        for (std::size_t a = 0; a < of.size(); ++a) blocks.of[a] = of[a] / extent(static_cast<int>(a));
        return blocks;
    }
};

/// The periods of a lattice in cells.
template <int d>
Periods<d> periods_of(Lattice const& lattice)
{
    Periods<d> periods;
    for (std::size_t a = 0; a < periods.of.size(); ++a) periods.of[a] = lattice.periods[a];
    return periods;
}

/// Throws an Error unless a lattice's periods are whole blocks of the order of cells, and along axes that a
/// scene has. Returns the lattice.
template <class CellOrder, int d>
Lattice const& require_whole_periods(Lattice const& lattice)
{
    int const half = lattice.half_world;
    require(half == 0 || (half >= 64 && (half & (half - 1)) == 0),
            "half_world is neither 0 nor a power of two from 64 on", "lattice",
            "Leave half_world 0: Worlds sets it.");
    for (int a = 0; a < 3; ++a) {
        int const period = lattice.periods[std::size_t(a)];
        if (period == 0) continue;
        static_cast<void>(Lattice{lattice.cell_size}.periodic(a, period)); // refuses what is no period
        std::string const where = "lattice, axis " + std::to_string(a);
        if (a >= d)
            throw Error{"a lattice of a scene in two dimensions is periodic along z", where,
                        "Let it be periodic along 0 or 1, for x or y."};
        int const block = CellOrder::extent(a);
        if (period % block != 0)
            throw Error{"the period is " + std::to_string(period) +
                            " cells, and this backend needs a multiple of " + std::to_string(block),
                        where,
                        "Pass " + std::to_string((period + block - 1) / block * block) +
                            " cells, and a cell size that is smaller by as much."};
    }
    return lattice;
}

} // namespace firn
