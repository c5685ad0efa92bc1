// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/node_effect.hpp>
#include <firn/effects/obstacle.hpp>

#include <array>
#include <cstddef>

namespace firn
{

/// The sum of what obstacles received, in the order in which they were passed.
template <int obstacles>
struct Reactions
{
    std::array<Reaction, std::size_t(obstacles)> of{};
    double largest_surface_speed2 = 0; ///< of an obstacle's surface at a contact [m^2/s^2]

    FIRN_HOST_DEVICE void merge(Reactions const& other)
    {
        for (int i = 0; i < obstacles; ++i) of[std::size_t(i)] += other.of[std::size_t(i)];
        largest_surface_speed2 = max(largest_surface_speed2, other.largest_surface_speed2);
    }

    /// Whether it must be merged in its place among others: sums depend on their order, if they are not zero.
    FIRN_HOST_DEVICE bool has_a_place() const
    {
        for (Reaction const& one : of)
            for (int a = 0; a < 3; ++a)
                if (!exactly_equal(one.impulse[a], 0.0) || !exactly_equal(one.angular_impulse[a], 0.0))
                    return true;
        return false;
    }

    /// Whether one of them is not finite.
    FIRN_HOST_DEVICE bool overflow() const
    {
        for (Reaction const& one : of)
            for (int a = 0; a < 3; ++a)
                if (!is_finite(one.impulse[a]) || !is_finite(one.angular_impulse[a])) return true;
        return false;
    }
};

/// Whether an action is that of a shell.
template <class Action>
inline constexpr bool keeps_sides = requires
{
    requires Action::keeps_sides;
};

/// Whether an action is that of a shape that reads its surface from samples.
template <class Action>
inline constexpr bool looks_up = requires
{
    requires Action::looks_up;
};

/// The actions of a step's effects, applied in the order in which they were passed.
template <class... Actions>
struct Chain;

/// The end of a chain.
template <>
struct Chain<>
{
    static constexpr int obstacles = 0, groups = 0, groups_at_surface = 0, groups_on_particles = 0, walls = 0,
                         shells = 0, lookups = 0, touching = 0;
    static constexpr bool may_touch_particles = false, uses_kilograms = false, changes_impulse = false,
                          loads_surfaces = false, accelerates_marked = false, touches_marked = false;
    template <class Visit>
    FIRN_HOST_DEVICE void for_each(Visit const&) const
    {}
};

/// A chain of at least one action.
template <class First, class... Rest>
struct Chain<First, Rest...>
{
    First first;
    Chain<Rest...> rest;
    static constexpr int obstacles = int(is_obstacle<First>) + Chain<Rest...>::obstacles;
    static constexpr int groups = int(is_group_on_nodes<First>) + Chain<Rest...>::groups; ///< on nodes
    static constexpr int groups_at_surface =
        int(is_group_at_surface<First>) + Chain<Rest...>::groups_at_surface;
    static constexpr int groups_on_particles =
        int(is_group_on_particles<First>) + Chain<Rest...>::groups_on_particles;
    static constexpr int walls = int(is_wall<First>) + Chain<Rest...>::walls;
    static constexpr int shells = int(keeps_sides<First> && !is_group<First>) + Chain<Rest...>::shells;
    static constexpr int lookups = int(looks_up<First>) + Chain<Rest...>::lookups;
    static constexpr bool may_touch_particles = (acts_on_particles<First> && !is_wall<First>) ||
                                                is_group_on_particles<First> ||
                                                Chain<Rest...>::may_touch_particles;
    /// The number of obstacles if one of them may act on particles, else 0: walls alone do not.
    static constexpr int touching = may_touch_particles ? obstacles : 0;
    /// Whether an action asks for the areas of surfaces.
    static constexpr bool loads_surfaces = detail::has_surface_force<First> || Chain<Rest...>::loads_surfaces;
    /// Whether an action accelerates what is marked.
    static constexpr bool accelerates_marked =
        detail::has_marked_acceleration<First> || Chain<Rest...>::accelerates_marked;
    /// Whether an action touches what is marked.
    static constexpr bool touches_marked = detail::has_touch_marked<First> || Chain<Rest...>::touches_marked;
    /// Whether an action asks for the impulse of all forces.
    static constexpr bool changes_impulse = detail::has_on_impulse<First> || Chain<Rest...>::changes_impulse;
    /// Whether an action needs masses in kg.
    static constexpr bool uses_kilograms =
        detail::has_on_node<First> || (detail::has_on_momentum<First> && !takes_any_unit_of_mass<First>) ||
        Chain<Rest...>::uses_kilograms;

    template <class Visit>
    FIRN_HOST_DEVICE void for_each(Visit const& visit) const
    {
        visit(first);
        rest.for_each(visit);
    }
};

/// Whether an action of the chain acts on particles, too.
template <class... Actions>
FIRN_HOST_DEVICE bool touches_particles(Chain<Actions...> const& chain)
{
    bool wanted = false;
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (is_group_on_particles<Action>)
            wanted = wanted || action.acting > 0;
        else if constexpr (acts_on_particles<Action> && !is_wall<Action>)
            wanted = wanted || action.on_particles;
    });
    return wanted;
}

namespace detail
{
template <class Action, class... Actions>
FIRN_HOST_DEVICE Chain<Action, Actions...> linked(Action const& first, Chain<Actions...> const& rest)
{
    return {first, rest};
}
} // namespace detail

/// The effects of a step as plain values. Their actions are made from these where the length of the step is
/// known, which may be on a device.
template <class... Effects>
struct PlainEffects;

/// The end of the list.
template <>
struct PlainEffects<>
{
    template <class Number, int d>
    FIRN_HOST_DEVICE Chain<> over(Interval const&) const
    {
        return {};
    }
    bool touch_particles() const { return false; }
    FIRN_HOST_DEVICE bool overflow(std::size_t) const { return false; }
};

/// A list of at least one effect.
template <class First, class... Rest>
struct PlainEffects<First, Rest...>
{
    First first;
    PlainEffects<Rest...> rest;

    /// The chain of the effects' actions during a step.
    template <class Number, int d>
    FIRN_HOST_DEVICE auto over(Interval const& interval) const
    {
        return detail::linked(first.template over<Number, d>(interval),
                              rest.template over<Number, d>(interval));
    }

    /// Whether one of the effects acts on particles, too.
    bool touch_particles() const
    {
        if constexpr (is_group<First>) {
            if (first.acting > 0) return true;
        }
        else if constexpr (requires { first.on_particles; })
            if (first.on_particles) return true;
        return rest.touch_particles();
    }

    /// Whether one of the groups received more in a step of a batch than it can add up.
    FIRN_HOST_DEVICE bool overflow(std::size_t step) const
    {
        if constexpr (is_group<First>)
            if (first.sums.overflow(step)) return true;
        return rest.overflow(step);
    }
};

/// The effects of a call that begins at a time [s] as plain values.
inline PlainEffects<> plain_effects(double) { return {}; }

/// The effects of a call that begins at a time [s] as plain values.
template <class First, class... Rest>
auto plain_effects(double begin, First const& first, Rest const&... rest)
{
    return [&]<class... Others>(PlainEffects<Others...> const& others) {
        return PlainEffects<decltype(detail::plain_effect(first, begin)), Others...>{
            detail::plain_effect(first, begin), others};
    }(plain_effects(begin, rest...));
}

namespace detail
{
/// Adds to a reaction what contact took from lanes of mass m: the impulse m (before - after), and its moment
/// about the reference point.
template <Lane Real, int d>
FIRN_HOST_DEVICE void book(Reaction& reaction, ContactResult<Real, d> const& touched,
                           Vector<Real, d> const& before, Real mass)
{
    constexpr int width = lane_width<Real>;
    ScalarOf<Real> impulse[std::size_t(d)][std::size_t(width)], arm[std::size_t(d)][std::size_t(width)];
    for (int a = 0; a < d; ++a) {
        // lanes without a particle may hold anything
        Real const taken = select(touched.inside, (before[a] - touched.velocity[a]) * mass, Real(0));
        LaneTraits<Real>::store(taken, impulse[a]);
        LaneTraits<Real>::store(touched.arm[a], arm[a]);
    }
    for (int lane = 0; lane < width; ++lane) {
        Eigen::Vector3d p(0, 0, 0), r(0, 0, 0);
        for (int a = 0; a < d; ++a) p[a] = impulse[a][lane], r[a] = arm[a][lane];
        reaction += {p, r.cross(p)};
    }
}
} // namespace detail

} // namespace firn
