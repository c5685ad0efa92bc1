// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/effect.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace firn
{

/// The sums of what any number of obstacles received, to which all parts of a loop add. They are integers, so
/// that they do not depend on the order: a number is split into multiples of 2^20, 2^-20 and 2^-60, and each
/// of these has a sum of its own, which has room for 2^23 numbers below 2^60. Larger ones are counted, and
/// the step fails.
///
/// Every obstacle has several such sums, its slots, so that parts of a loop seldom wait for one another.
struct ReactionSums
{
    static constexpr int numbers = 6; ///< of a reaction: impulse and angular impulse
    static constexpr int words = 3;   ///< of a number

    std::int64_t* memory = nullptr; ///< parts of size() integers each
    std::uint32_t obstacles = 0, slots = 1;
    std::uint32_t const* part = nullptr; ///< the number of the part to add to; without it the first

    /// How many slots this many obstacles have: more where there are few.
    static std::uint32_t slots_of(std::size_t obstacles)
    {
        std::uint32_t slots = 32;
        while (slots > 1 && slots * obstacles > 512) slots /= 2;
        return slots;
    }
    /// The integers of a part.
    FIRN_HOST_DEVICE std::size_t size() const { return sums() + 1; }
    /// How many of them are sums: the last integer counts the numbers that are too large for these.
    FIRN_HOST_DEVICE std::size_t sums() const { return std::size_t(obstacles) * slots * numbers * words; }

    /// Adds what an obstacle received, in one of the slots (modulo their number). `together`: parts of the
    /// loop that a device runs together mostly have the same obstacle and slot.
    template <bool together = false>
    FIRN_HOST_DEVICE void add(std::uint32_t obstacle, std::uint32_t slot, Reaction const& received) const
    {
        std::size_t const skipped = part == nullptr ? 0 : *part * size();
        std::int64_t* const to = memory + skipped + first(obstacle, slot % slots);
        for (int i = 0; i < 3; ++i) {
            if (!add<together>(to + words * i, received.impulse[i]) ||
                !add<together>(to + words * (3 + i), received.angular_impulse[i]))
                add_in_any_order(memory[skipped + sums()], std::int64_t(1));
        }
    }

    /// Whether a number was too large in a part.
    FIRN_HOST_DEVICE bool overflow(std::size_t of_part) const
    {
        return obstacles > 0 && memory[of_part * size() + sums()] != 0;
    }

    /// Sets one of the size() integers of a part to 0.
    FIRN_HOST_DEVICE void clear(std::size_t i, std::size_t of_part) const
    {
        memory[of_part * size() + i] = 0;
    }

    /// One number of what an obstacle received in a part: first the impulse, then the angular impulse. Its
    /// bits are the same wherever this runs: products with powers of two are exact.
    FIRN_HOST_DEVICE double number(int i, std::uint32_t obstacle, std::size_t of_part) const
    {
        std::int64_t const* const from = memory + of_part * size();
        std::int64_t of_word[words]{};
        for (std::uint32_t slot = 0; slot < slots; ++slot)
            for (int w = 0; w < words; ++w)
                of_word[w] += from[first(obstacle, slot) + std::size_t(words * i + w)];
        double sum = 0;
        for (int w = words; w-- > 0;) sum += double(of_word[w]) * unit(w); // the small ones first
        return sum;
    }
    /// All of them.
    FIRN_HOST_DEVICE Reaction of(std::uint32_t obstacle, std::size_t of_part = 0) const
    {
        Reaction received;
        for (int i = 0; i < numbers; ++i)
            (i < 3 ? received.impulse[i] : received.angular_impulse[i - 3]) = number(i, obstacle, of_part);
        return received;
    }

private:
    FIRN_HOST_DEVICE static double unit(int word)
    {
        return word == 0 ? 0x1p20 : word == 1 ? 0x1p-20 : 0x1p-60;
    }

    FIRN_HOST_DEVICE std::size_t first(std::uint32_t obstacle, std::uint32_t slot) const
    {
        return (std::size_t(slot) * obstacles + obstacle) * numbers * words;
    }

    /// Returns false, and adds nothing, if the number is too large or NaN.
    template <bool together>
    FIRN_HOST_DEVICE static bool add(std::int64_t* to, double number)
    {
        if (!(detail::bits_of_magnitude(number) < detail::bits_of_magnitude(0x1p60))) return false;
        for (int w = 0; w < words; ++w) {
            auto const share = static_cast<std::int64_t>(number * (1 / unit(w)));
            if (share == 0) continue;
            if constexpr (together)
                add_together_in_any_order(to[w], share);
            else
                add_in_any_order(to[w], share);
            number -= double(share) * unit(w); // exact: what is left has fewer digits
        }
        return true;
    }
};

} // namespace firn
