// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/state/snapshot.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

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

    /// Refuses particles of a volume [m^3] and a density [kg/m^3] whose mass differs so much from others of
    /// the scene that the lighter would be lost to rounding.
    static void require_comparable(double volume, double density, MassScale const& scale)
    {
        double const unit = exactly_equal(scale.unit, 0) ? volume * density : scale.unit;
        bool const in_range = is_finite(Number(volume / unit)) && Number(volume / unit) > 0;
        require(
            in_range && scale.bears<Number>(volume * density / unit),
            "the new particles are lighter or heavier than others by a factor that rounding does not bear",
            "Solver::add", "Keep the masses of one scene within a factor of 1e10 (float) or 1e20 (double).");
    }

    /// Sets volume [m^3] and density [kg/m^3] of the particles from a row on: if both equal those of the
    /// particles before them, they belong to the same mass group.
    void add(std::uint32_t first_row, double volume, double density, MassScale& scale)
    {
        if (exactly_equal(scale.unit, 0)) scale.unit = volume * density;
        MassGroup<Number> const group{first_row, Number(volume * density / scale.unit),
                                      Number(volume / scale.unit)};
        scale.admit(group.mass);
        if (here_.size() > 0) {
            auto const& last = here_.back();
            if (exactly_equal(last.mass, group.mass) && exactly_equal(last.volume, group.volume)) return;
        }
        here_.push_back(group);
        upload();
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
