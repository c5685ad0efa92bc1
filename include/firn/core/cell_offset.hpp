// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>

#include <concepts>
#include <cstdint>

namespace firn
{

/// How an offset from the centre of a cell, in cells, is stored.
///
/// In double precision as it is. In single precision as a multiple of 2^-30 cells in an integer of the same
/// size: the resolution is that of a float 2^-6 cells from the centre, but it is so everywhere in the cell;
/// slow and steady motion, which in floats rounds the same way step after step, does not drift; and moving to
/// the next cell is exact.
template <std::floating_point Number>
struct CellOffset
{
    using Stored = Number;

    FIRN_HOST_DEVICE static Number value(Stored stored) { return stored; }
    FIRN_HOST_DEVICE static Stored from(double offset) { return offset; }
    FIRN_HOST_DEVICE static double exact(Stored stored) { return stored; }
    /// Whether an item may have it: also what unwrap() leaves.
    static bool possible(Stored stored) { return stored >= -0.5 && stored <= 0.5; }

    /// The offset after a displacement of at most a cell.
    FIRN_HOST_DEVICE static Stored moved(Stored stored, Number displacement) { return stored + displacement; }

    /// Whether the offset is in [-1/2, 1/2), in the very words of wrap().
    FIRN_HOST_DEVICE static bool inside(Stored stored) { return floor(stored + Number(0.5)) == 0; }

    /// Brings the offset back to [-1/2, 1/2); returns by how many cells it was out.
    FIRN_HOST_DEVICE static int wrap(Stored& stored)
    {
        Number const cells = floor(stored + Number(0.5));
        stored -= cells;
        return static_cast<int>(cells);
    }

    /// Undoes that, for an offset that was out by so many cells, one at most: exactly, but for the largest
    /// number below 1/2, which comes back as 1/2.
    FIRN_HOST_DEVICE static void unwrap(Stored& stored, int cells)
    {
        if (cells != 0) stored += static_cast<Number>(cells); // or -0 would become 0
    }
};

template <>
struct CellOffset<float>
{
    using Stored = std::int32_t;
    static constexpr int bits = 30;

    FIRN_HOST_DEVICE static float value(Stored stored) { return static_cast<float>(stored) * 0x1p-30f; }
    /// What rounding would take to 1/2 is the last one below: a cell further, there is no room for more.
    FIRN_HOST_DEVICE static Stored from(double offset)
    {
        auto const nearest = static_cast<Stored>(std::lrint(offset * 0x1p30));
        return nearest < 1 << (bits - 1) ? nearest : (1 << (bits - 1)) - 1;
    }
    FIRN_HOST_DEVICE static double exact(Stored stored) { return static_cast<double>(stored) * 0x1p-30; }
    static bool possible(Stored stored) { return stored >= -(1 << (bits - 1)) && stored < 1 << (bits - 1); }

    FIRN_HOST_DEVICE static Stored moved(Stored stored, float displacement)
    {
        // To the nearest, halves away from zero, in operations that packs of integers have.
        float const exact = displacement * 0x1p30f;
        auto whole = static_cast<Stored>(exact);
        float const rest = exact - static_cast<float>(whole);
        whole += rest >= 0.5f;
        whole -= rest <= -0.5f;
        return stored + whole;
    }

    FIRN_HOST_DEVICE static bool inside(Stored stored) { return ((stored + (1 << (bits - 1))) >> bits) == 0; }

    FIRN_HOST_DEVICE static int wrap(Stored& stored)
    {
        int const cells = (stored + (1 << (bits - 1))) >> bits; // rounds down, also below zero
        stored -= cells * (1 << bits);
        return cells;
    }

    FIRN_HOST_DEVICE static void unwrap(Stored& stored, int cells) { stored += cells * (1 << bits); }
};

} // namespace firn
