// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/particles/volumes.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// The mass unit and range of masses, shared by all materials of a scene, as nodes add up their masses.
struct MassScale
{
    double unit = 0;                  ///< [kg]: the unit of masses on the grid; 0: not set yet
    double largest = 0, smallest = 0; ///< of a particle, in units

    /// The largest allowed ratio of two masses: beyond it the lighter particle would be lost to rounding on a
    /// node, or its node be taken for an empty one.
    template <class Number>
    static constexpr double range = std::is_same_v<Number, float> ? 1e10 : 1e20;

    template <class Number>
    bool bears(double mass) const
    {
        return is_finite(mass) && (exactly_equal(largest, 0) ||
                                   (mass / smallest < range<Number> && largest / mass < range<Number>));
    }
    void admit(double mass)
    {
        smallest = exactly_equal(largest, 0) ? mass : std::min(smallest, mass);
        largest = std::max(largest, mass);
    }
};

/// Particles of equal mass and volume: those from row `first_row` up to the next group's.
template <class Number>
struct MassGroup
{
    std::uint32_t first_row;
    Number mass;   ///< in units of the scene's mass unit
    Number volume; ///< V0 [m^3] per mass unit [kg]
};

/// Mass and volume of every particle: one value per mass group, found by the particle's row, so that none is
/// stored per particle unless each has its own.
template <class Number>
struct MassGroups
{
    MassGroup<Number> const* of;
    int count;

    /// The lanes' masses and volumes: both zero in lanes without an item.
    template <class Items>
    FIRN_HOST_DEVICE auto find(Items const& items, std::uint32_t const* id) const
    {
        using Real = typename Items::Real;
        struct Found
        {
            Real mass, volume;
        };
        Found found{Real(of[0].mass), Real(of[0].volume)};
        if (count > 1) {
            found.mass = items.map([&](std::size_t particle) { return of[index(id[particle])].mass; });
            found.volume = items.map([&](std::size_t particle) { return of[index(id[particle])].volume; });
        }
        found.mass = select(items.here(), found.mass, Real(0));
        found.volume = select(items.here(), found.volume, Real(0));
        return found;
    }

    FIRN_HOST_DEVICE int index(std::uint32_t row) const
    {
        // A group has a row at least, so it lies no further ahead than the row, nor further behind than the
        // last group does. Where each particle has a group of its own, nothing is left to search.
        auto const last = static_cast<std::uint32_t>(count - 1), spare = of[last].first_row - last,
                   least = row > spare ? row - spare : 0;
        int low = static_cast<int>(least < last ? least : last),
            high = row < last ? static_cast<int>(row) + 1 : count;
        // of[low].first_row <= row < of[high].first_row
        while (high - low > 1) {
            int const middle = (low + high) / 2;
            (of[middle].first_row <= row ? low : high) = middle;
        }
        return low;
    }
};

/// Masses and volumes of a table's particles, one of each per mass group (see MassGroups), on the host
/// (`here`) and in the backend's memory (`there`).
template <class Backend, class Number>
class MassGroupList
{
public:
    explicit MassGroupList(Backend const& backend) : there_(backend) {}

    /// The views for the backend's loops, and for the host.
    MassGroups<Number> there() const { return {there_.data(), static_cast<int>(here_.size())}; }
    MassGroups<Number> here() const { return {here_.data(), static_cast<int>(here_.size())}; }
    std::vector<MassGroup<Number>> const& all() const { return here_; }

    /// Refuses particles of some volumes [m^3] whose masses differ so much from each other, or from others of
    /// the scene, that the lighter would be lost to rounding. `density` is the model's [kg/m^3].
    static void require_comparable(Volumes const& volumes, std::size_t count, double density, MassScale scale)
    {
        for (std::size_t i = 0; i < (volumes.are_listed() ? count : 1); ++i) {
            double const volume = volumes.volume(i), mass = volume * volumes.density(i, density);
            if (exactly_equal(scale.unit, 0)) scale.unit = mass;
            bool const in_range = is_finite(Number(volume / scale.unit)) && Number(volume / scale.unit) > 0;
            if (!in_range || !scale.bears<Number>(mass / scale.unit))
                throw Error{"the new particles are lighter or heavier than others by a factor that rounding "
                            "does not bear",
                            volumes.are_listed() ? "Solver::add, volume " + std::to_string(i) : "Solver::add",
                            "Keep the masses of one scene within a factor of 1e10 (float) or 1e20 (double)."};
            scale.admit(Number(mass / scale.unit));
        }
    }

    /// Sets volumes [m^3] of so many particles from a row on: where mass and volume equal those of the
    /// particle before, they belong to the same mass group. `density` is the model's [kg/m^3].
    void add(std::uint32_t first_row, std::size_t count, Volumes const& volumes, double density,
             MassScale& scale)
    {
        std::size_t const groups = here_.size();
        for (std::size_t i = 0; i < (volumes.are_listed() ? count : 1); ++i) {
            double const volume = volumes.volume(i), mass = volume * volumes.density(i, density);
            if (exactly_equal(scale.unit, 0)) scale.unit = mass;
            MassGroup<Number> const group{first_row + static_cast<std::uint32_t>(i),
                                          Number(mass / scale.unit), Number(volume / scale.unit)};
            scale.admit(group.mass);
            if (here_.empty() || !exactly_equal(here_.back().mass, group.mass) ||
                !exactly_equal(here_.back().volume, group.volume))
                here_.push_back(group);
        }
        if (here_.size() > groups) upload();
    }

    /// Renumbers the rows, and drops mass groups without particles.
    void keep(std::vector<std::uint32_t> const& new_row, std::size_t kept)
    {
        std::vector<MassGroup<Number>> left;
        for (std::size_t i = 0; i < here_.size(); ++i) {
            std::size_t const begin = new_row[here_[i].first_row],
                              end = i + 1 < here_.size() ? new_row[here_[i + 1].first_row] : kept;
            if (begin == end) continue;
            left.push_back(here_[i]);
            left.back().first_row = static_cast<std::uint32_t>(begin);
        }
        set(std::move(left));
    }

    void set(std::vector<MassGroup<Number>> mass_groups)
    {
        here_ = std::move(mass_groups);
        upload();
    }

private:
    void upload()
    {
        there_.resize(here_.size());
        there_.upload(0, here_);
    }

    std::vector<MassGroup<Number>> here_;
    typename Backend::template Array<MassGroup<Number>> there_;
};

} // namespace firn
