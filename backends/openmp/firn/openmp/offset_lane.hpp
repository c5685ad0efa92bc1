// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_offset.hpp>
#include <firn/openmp/pack.hpp>

#include <bit>
#include <cstdint>

namespace firn::openmp
{

/// The offsets of a lane's items, as CellOffset stores them: one, or several side by side.
template <class Lane>
struct OffsetLane
{
    using Stored = Lane;

    static Stored load(ScalarOf<Lane> const* from) { return LaneTraits<Lane>::load(from); }
    static void store(Stored const& stored, ScalarOf<Lane>* to) { LaneTraits<Lane>::store(stored, to); }

    /// Packs of offsets are loaded and stored as packs of numbers with the same bits.
    static Stored of_bits(Lane const& bits) { return bits; }
    static Lane bits(Stored const& stored) { return stored; }
};

/// A single offset in single precision.
template <>
struct OffsetLane<float>
{
    using Stored = CellOffset<float>::Stored;

    static Stored load(Stored const* from) { return *from; }
    static void store(Stored stored, Stored* to) { *to = stored; }
};

#if defined(FIRN_HAS_XSIMD)

// As in pack.hpp: warnings about g++ 12's own intrinsics.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif

/// Integers of 32 bits, one per lane of a pack of floats, with the operations that CellOffset needs. They
/// stay in registers: a loop over single numbers would go through memory in other widths than packs, and what
/// was stored in two parts cannot be loaded as one before it has reached the cache.
template <class NumbersType>
struct WholePack
{
    using Numbers = NumbersType;
    using Batch = xsimd::batch<std::int32_t, typename Numbers::Arch>;

    Batch value;

    WholePack() = default;
    explicit WholePack(std::int32_t number) : value(number) {}
    explicit WholePack(Batch batch) : value(batch) {}

    friend WholePack operator+(WholePack a, WholePack b) { return WholePack(a.value + b.value); }
    friend WholePack operator-(WholePack a, WholePack b) { return WholePack(a.value - b.value); }
    /// Rounds down, also below zero.
    friend WholePack operator>>(WholePack a, int bits) { return WholePack(a.value >> bits); }
};

template <class Numbers>
Numbers as_number(WholePack<Numbers> whole)
{
    return Numbers(xsimd::to_float(whole.value));
}
template <class Arch>
WholePack<Pack<float, Arch>> as_whole(Pack<float, Arch> numbers)
{
    return WholePack<Pack<float, Arch>>(xsimd::to_int(numbers.value));
}
template <class Arch>
WholePack<Pack<float, Arch>> one_where(PackMask<float, Arch> mask)
{
    return as_whole(select(mask, Pack<float, Arch>(1), Pack<float, Arch>(0)));
}

template <class Arch>
struct OffsetLane<Pack<float, Arch>>
{
    using Stored = WholePack<Pack<float, Arch>>;

    static Stored load(std::int32_t const* from) { return Stored(Stored::Batch::load_unaligned(from)); }
    static void store(Stored const& stored, std::int32_t* to) { stored.value.store_unaligned(to); }

    static Stored of_bits(Pack<float, Arch> const& bits)
    {
        using Batch = typename Stored::Batch;
        return Stored(Batch(std::bit_cast<typename Batch::register_type>(bits.value.data)));
    }
    static Pack<float, Arch> bits(Stored const& stored)
    {
        using Batch = typename Pack<float, Arch>::Batch;
        return Pack<float, Arch>(Batch(std::bit_cast<typename Batch::register_type>(stored.value.data)));
    }
};

#pragma GCC diagnostic pop

#endif

} // namespace firn::openmp
