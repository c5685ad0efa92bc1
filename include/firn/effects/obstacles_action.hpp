// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/broad_phase.hpp>
#include <firn/effects/node_action.hpp>
#include <firn/effects/obstacle.hpp>
#include <firn/effects/reaction_sums.hpp>
#include <firn/effects/touching_obstacles.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>

// Any number of obstacles as steps know them: see Obstacles.
namespace firn
{

/// Which obstacles may meet nodes, and which of those that act on particles may meet particles.
template <int d>
struct NearbyObstacles
{
    NearObstacles<d> to_nodes, to_particles;
};

namespace detail
{
/// The reach of obstacles is kept in single precision, and distances are rounded: a thousandth more is
/// searched.
inline constexpr double with_rounding = 1.001;
} // namespace detail

/// The action of many obstacles: each of those that are near is asked what it gives to nodes and particles.
template <class ShapeType, ActsOn acts_on, class Number, int d>
struct ObstaclesAction
{
    static constexpr bool is_group = true, acts_on_particles = acts_on_particles_too(acts_on),
                          acts_at_surface = firn::acts_at_surface(acts_on);
    static constexpr bool looks_up = is_sampled<ShapeType>;
    static constexpr bool keeps_sides = is_two_sided<ShapeType>;
    /// How far from where the grid moves them [cells] particles may meet an obstacle: a step that succeeds
    /// moves them by less than a cell along each axis.
    static constexpr double reach_of_particles = 3;

    using One = typename Obstacle<ShapeType>::template Action<Number, d>;

    One const* obstacles; ///< at the end of the step
    NearbyObstacles<d> near;
    std::uint32_t acting; ///< how many of them act on particles
    bool have_own_worlds; ///< else they are in the same place in all worlds
    ReactionSums sums;

    /// Calls `use(action, receive)` for each obstacle that may touch lanes of nodes at a place;
    /// `receive(reaction)` adds to what it received, and `use` returns whether it touches. Those are noted in
    /// the first of several calls for a place, and the later ones ask no others.
    template <Lane Real, class Use>
    FIRN_HOST_DEVICE void for_each_near(LanePosition<Real, d> const& place, bool is_first,
                                        TouchingObstacles& touching, Use const& use) const
    {
        if (sums.obstacles == 0) return;
        if (!is_first && touching.are_all()) {
            for (std::uint32_t k = 0; k < touching.count; ++k) ask(touching.number[k], place.first, use);
            return;
        }
        near.to_nodes.for_each(cell_of(place), [&](std::uint32_t i, float reach) {
            if (!is_far(place, i, reach, Real(0)) && ask(i, place.first, use) && is_first) touching.note(i);
        });
    }

    /// Calls `use(number, action)` for each obstacle that may be as near as this [m] to lanes of nodes.
    template <Lane Real, class Use>
    FIRN_HOST_DEVICE void for_each_within(LanePosition<Real, d> const& place, Real distance,
                                          Use const& use) const
    {
        if (sums.obstacles == 0) return;
        near.to_nodes.for_each(cell_of(place), [&](std::uint32_t i, float reach) {
            if (!is_far(place, i, reach, distance)) use(i, obstacles[i]);
        });
    }

    /// Adds to what an obstacle received at a node.
    FIRN_HOST_DEVICE void receive(std::uint32_t i, Coordinates<d> const& node, Reaction const& received) const
    {
        std::uint32_t slot = 0;
        for (int a = 0; a < d; ++a) slot = 7 * slot + static_cast<std::uint32_t>(node[a]);
        sums.add(i, slot, received);
    }

    /// As for_each_near, for lanes of particles to whose place the grid moves them in a step of `dt` [s], and
    /// for obstacles that act on them.
    template <Lane Real, class Use>
    FIRN_HOST_DEVICE void for_each_near_particles(LanePosition<Real, d> const& place, Real dt,
                                                  Use const& use) const
    {
        if (acting == 0) return;
        Real const travel(static_cast<Number>(reach_of_particles * place.lattice.cell_size));
        near.to_particles.for_each(cell_of(place), [&](std::uint32_t i, float reach) {
            Number speed(0); // of a shell that was near when the step began
            for (int a = 0; a < d; ++a) speed += std::abs(obstacles[i].velocity[a]);
            if (!is_far(place, i, reach, travel + Real(speed) * dt)) ask(i, place.first, use);
        });
    }

private:
    /// The cell by which obstacles are looked up.
    template <Lane Real>
    FIRN_HOST_DEVICE Coordinates<d> cell_of(LanePosition<Real, d> const& place) const
    {
        Coordinates<d> cell = place.first;
        for (int a = 0; a < d; ++a) cell[a] = have_own_worlds ? cell[a] : place.lattice.in_world(cell[a]);
        return cell;
    }

    template <class Use>
    FIRN_HOST_DEVICE auto ask(std::uint32_t i, Coordinates<d> const& first, Use const& use) const
    {
        return use(obstacles[i], [&](Reaction const& received) { receive(i, first, received); });
    }

    /// Whether an obstacle is farther from all lanes than `more` [m] beyond its reach.
    template <Lane Real>
    FIRN_HOST_DEVICE bool is_far(LanePosition<Real, d> const& place, std::uint32_t i, float reach,
                                 Real more) const
    {
        if (!(reach > 0)) return false;
        Vector<Real, d> const away = place.relative_to(obstacles[i].position);
        Real const furthest = Real(static_cast<Number>(reach * float(detail::with_rounding))) + more;
        return !any(dot<Real, d>(away, away) <= furthest * furthest);
    }
};

/// Obstacles as steps know them: a plain value.
template <class ShapeType, ActsOn acts_on>
struct PlainObstacles
{
    static constexpr bool is_group = true;

    void const* placed = nullptr; ///< their actions, of the scene's numbers and dimensions
    NearbyObstacles<2> near_in_plane{};
    NearbyObstacles<3> near_in_space{};
    std::uint32_t acting = 0; ///< how many of them act on particles
    bool have_own_worlds = false;
    ReactionSums sums{};

    template <class Number, int d>
    FIRN_HOST_DEVICE ObstaclesAction<ShapeType, acts_on, Number, d> over(Interval const&) const
    {
        auto const* const of_scene =
            static_cast<typename ObstaclesAction<ShapeType, acts_on, Number, d>::One const*>(placed);
        if constexpr (d == 2)
            return {of_scene, near_in_plane, acting, have_own_worlds, sums};
        else
            return {of_scene, near_in_space, acting, have_own_worlds, sums};
    }
};

} // namespace firn
