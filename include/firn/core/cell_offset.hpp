// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>

#include <concepts>
#include <cstdint>
#include <type_traits>

namespace firn
{

// What CellOffset needs of whole numbers, here of one; packs have overloads of their own.

/// The same number as a float, rounded.
FIRN_HOST_DEVICE inline float as_number(std::int32_t whole) { return static_cast<float>(whole); }
/// Towards zero.
FIRN_HOST_DEVICE inline std::int32_t as_whole(float number) { return static_cast<std::int32_t>(number); }
/// 1 where the mask holds, and else 0.
FIRN_HOST_DEVICE inline std::int32_t one_where(bool mask) { return mask; }
/// The nearest whole number, in operations that packs have: halves go away from zero. A number has its own.
template <class Real>
FIRN_HOST_DEVICE auto nearest_whole(Real const& number)
{
    auto const whole = as_whole(number);
    Real const rest = number - as_number(whole);
    return whole + one_where(rest >= Real(0.5f)) - one_where(rest <= Real(-0.5f));
}

/// How an offset from the centre of a cell, in cells, is stored.
///
/// In double precision as it is. In single precision as a multiple of 2^-30 cells in an integer of the same
/// size. The resolution is that of a float 2^-6 cells from the centre, but everywhere in the cell. Slow and
/// steady motion, which in floats rounds the same way step after step, does not drift, and moving to the next
/// cell is exact.
///
/// value(), moved() and inside() take lanes of offsets, too.
template <std::floating_point Number>
struct CellOffset
{
    using Stored = Number;

    template <class Real>
    FIRN_HOST_DEVICE static Real value(Real const& stored)
    {
        return stored;
    }
    FIRN_HOST_DEVICE static Stored from(double offset) { return offset; }
    FIRN_HOST_DEVICE static double exact(Stored stored) { return stored; }
    /// Whether an item may have this offset, including what unwrap() leaves.
    static bool possible(Stored stored) { return is_between(-0.5, stored, 0.5); }

    /// The offset after a displacement of at most a cell.
    template <class Real>
    FIRN_HOST_DEVICE static Real moved(Real const& stored, std::type_identity_t<Real> const& displacement)
    {
        return stored + displacement;
    }

    /// Whether the offset is in [-1/2, 1/2), by the same expression as in wrap().
    template <class Real>
    FIRN_HOST_DEVICE static Mask<Real> inside(Real const& stored)
    {
        return exactly_equal(floor(stored + Real(Number(0.5))), Real(0));
    }

    /// Brings the offset back to [-1/2, 1/2); returns by how many cells it was out.
    FIRN_HOST_DEVICE static int wrap(Stored& stored)
    {
        Number const cells = floor(stored + Number(0.5));
        stored -= cells;
        return static_cast<int>(cells);
    }

    /// Undoes wrap() for an offset that was out by `cells`, one at most. Exact, except that the largest
    /// number below 1/2 comes back as 1/2.
    FIRN_HOST_DEVICE static void unwrap(Stored& stored, int cells)
    {
        if (cells != 0) stored += static_cast<Number>(cells); // or -0 would become 0
    }
};

/// Single precision: multiples of 2^-30 cells.
template <>
struct CellOffset<float>
{
    using Stored = std::int32_t;
    static constexpr int bits = 30;

    template <class Whole>
    FIRN_HOST_DEVICE static auto value(Whole const& stored)
    {
        return as_number(stored) * 0x1p-30f;
    }
    /// An offset that would round to 1/2 becomes the last one below: 1/2 belongs to the next cell.
    FIRN_HOST_DEVICE static Stored from(double offset)
    {
        auto const nearest = static_cast<Stored>(std::lrint(offset * 0x1p30));
        return nearest < 1 << (bits - 1) ? nearest : (1 << (bits - 1)) - 1;
    }
    FIRN_HOST_DEVICE static double exact(Stored stored) { return static_cast<double>(stored) * 0x1p-30; }
    static bool possible(Stored stored) { return stored >= -(1 << (bits - 1)) && stored < 1 << (bits - 1); }

    template <class Whole, class Real = decltype(as_number(Whole()))>
    FIRN_HOST_DEVICE static Whole moved(Whole const& stored, std::type_identity_t<Real> const& displacement)
    {
        return stored + nearest_whole(displacement * Real(0x1p30f));
    }

    template <class Whole>
    FIRN_HOST_DEVICE static auto inside(Whole const& stored)
    {
        // at most a cell outside, so the numbers are exact in a float
        return exactly_equal(as_number((stored + Whole(1 << (bits - 1))) >> bits),
                             decltype(as_number(stored))(0));
    }

    FIRN_HOST_DEVICE static int wrap(Stored& stored)
    {
        int const cells = (stored + (1 << (bits - 1))) >> bits; // rounds down, also below zero
        stored -= cells * (1 << bits);
        return cells;
    }

    FIRN_HOST_DEVICE static void unwrap(Stored& stored, int cells) { stored += cells * (1 << bits); }
};

} // namespace firn
