// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/step_error.hpp>
#include <firn/effects/reflecting_wall.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/particles/readback.hpp>
#include <firn/particles/remove_particles.hpp>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <sstream>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn::detail
{

/// Throws an Error about `count` particles behind a wall, of which it names the first; `d` is the number of
/// its coordinates.
[[noreturn]] inline void throw_behind_wall(std::uint32_t particle, std::string const& material,
                                           std::size_t count, Eigen::Vector3d const& position, int d,
                                           ReflectingWall const& wall)
{
    std::ostringstream what, where;
    what << "particle " << particle;
    if (count > 1) what << " and " << count - 1 << " more";
    what << material << (count > 1 ? " are" : " is") << " behind a reflecting wall";
    where << at_place(position, d) << ", ReflectingWall across axis " << wall.axis << " at node "
          << wall.node;
    throw Error{what.str(), where.str(),
                "Put all particles on the wall's side before it is passed, or let it face the other way."};
}

/// The reflecting walls that are known to have no particle of a scene behind them.
class WallCheck
{
public:
    /// To be called when particles were added or restored.
    void forget() { walls_.clear(); }

    /// Throws an Error if there are particles of `sets` more than `spared` [cells] behind a wall among the
    /// effects. Does not search if all of the walls are known.
    template <class Sets, class... Effects>
    void look(Sets const& sets, Lattice const& lattice, double spared, Effects const&... effects)
    {
        constexpr std::size_t count = (std::size_t{0} + ... + std::is_same_v<Effects, ReflectingWall>);
        if constexpr (count > 0) {
            std::array<ReflectingWall, count> walls;
            std::size_t place = 0;
            auto const list = [&](auto const& effect) {
                if constexpr (std::is_same_v<decltype(effect), ReflectingWall const&>)
                    walls[place++] = effect;
            };
            (list(effects), ...);
            for (auto const& wall : walls)
                require(lattice.periods[std::size_t(wall.axis)] == 0,
                        "a reflecting wall lies across an axis along which the lattice is periodic",
                        "ReflectingWall", "Let the lattice be periodic along other axes.");
            bool const knows_all = std::ranges::all_of(
                walls, [&](auto const& wall) { return std::ranges::find(walls_, wall) != walls_.end(); });
            if (!knows_all) {
                auto const of_any = behind_any(walls, lattice, spared, std::make_index_sequence<count>{});
                Sets::for_each([&](auto k) {
                    if (find_particles(sets.template particles<k>(), of_any).count == 0) return;
                    for (auto const& wall : walls) require_before<k>(sets, lattice, spared, wall);
                });
            }
            walls_.assign(walls.begin(), walls.end());
        }
        else
            walls_.clear();
    }

private:
    template <std::size_t count, std::size_t... i>
    static BehindAnyWall<count> behind_any(std::array<ReflectingWall, count> const& walls,
                                           Lattice const& lattice, double spared, std::index_sequence<i...>)
    {
        return {{BehindWall(walls[i], lattice, spared)...}};
    }

    template <std::size_t k, class Sets>
    static void require_before(Sets const& sets, Lattice const& lattice, double spared,
                               ReflectingWall const& wall)
    {
        auto const& particles = sets.template particles<k>();
        auto const found = find_particles(particles, BehindWall(wall, lattice, spared));
        if (found.count == 0) return;
        auto const row = first_row(particles, found);
        throw_behind_wall(particles.id(row), Sets::name(k), found.count,
                          in_space<Sets::d>(position_of(particles, row)), Sets::d, wall);
    }

    std::vector<ReflectingWall> walls_;
};

} // namespace firn::detail
