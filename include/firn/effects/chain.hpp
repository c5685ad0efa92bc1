// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/actions.hpp>
#include <firn/effects/particle_contact.hpp>
#include <firn/effects/touching_obstacles.hpp>

#include <cstddef>

namespace firn
{

/// What effects on lanes of nodes get beside the positions.
template <Lane Real>
struct NodesOfStep
{
    Real mass;               ///< in the solver's unit
    Mask<Real> filled;       ///< where it is above rounding; elsewhere an effect may return anything
    Real booked_mass;        ///< the mass where a node counts for the reaction, else 0
    ScalarOf<Real> dt = 0;   ///< for how long forces act [s]
    ScalarOf<Real> unit = 1; ///< the solver's unit of mass [kg]

    FIRN_HOST_DEVICE Real kilograms() const { return select(filled, mass * Real(unit), Real(0)); }
};

/// Adds what actions on momentum (gravity) do to lanes of nodes.
///
/// Actions that need kg and kg m/s get these. Only their change is added to the momentum, so one that they
/// leave alone stays the same to the bit.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE void apply_on_momentum(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
                                        NodesOfStep<Real> const& nodes, Vector<Real, d>& momentum)
{
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (detail::has_acceleration<Action>) {
            Vector<Real, d> const acceleration = action.acceleration(place);
            for (int a = 0; a < d; ++a)
                momentum[a] += select(nodes.filled, nodes.mass * (acceleration[a] * Real(nodes.dt)), Real(0));
        }
        if constexpr (detail::has_on_momentum<Action>) {
            if constexpr (takes_any_unit_of_mass<Action>)
                action.on_momentum(momentum, nodes.mass);
            else {
                Vector<Real, d> const before = momentum * Real(nodes.unit);
                Vector<Real, d> after = before;
                action.on_momentum(after, nodes.kilograms());
                for (int a = 0; a < d; ++a)
                    momentum[a] += select(nodes.filled, (after[a] - before[a]) / Real(nodes.unit), Real(0));
            }
        }
    });
}

/// Adds the impulse of loads on surfaces to the momentum of lanes of nodes, which have these areas.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE void apply_on_surfaces(Chain<Actions...> const& chain, NodesOfStep<Real> const& nodes,
                                        Vector<Real, d> const& area, Vector<Real, d>& momentum)
{
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (detail::has_surface_force<Action>) {
            Vector<Real, d> const force = action.surface_force(area);
            for (int a = 0; a < d; ++a)
                momentum[a] += select(nodes.filled, force[a] * Real(nodes.dt), Real(0));
        }
    });
}

/// Adds the impulse of forces on what is marked to the momentum of lanes of nodes. `marked(tag)` is the mass
/// that a mark is about, in the solver's unit.
template <Lane Real, int d, class... Actions, class Marked>
FIRN_HOST_DEVICE void apply_on_marked(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
                                      NodesOfStep<Real> const& nodes, Marked const& marked,
                                      Vector<Real, d>& momentum)
{
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (detail::has_marked_acceleration<Action>) {
            Vector<Real, d> const acceleration = action.marked_acceleration(place);
            Real const mass = marked(typename Action::Marked{});
            for (int a = 0; a < d; ++a)
                momentum[a] += select(nodes.filled, mass * (acceleration[a] * Real(nodes.dt)), Real(0));
        }
    });
}

/// Lets actions change the impulse of all forces on lanes of nodes, whose momentum before them is given.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE void apply_on_impulse(Chain<Actions...> const& chain, Vector<Real, d> const& before,
                                       Vector<Real, d>& momentum)
{
    auto impulse = make_vector<Real, d>([&](int a) { return momentum[a] - before[a]; });
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (detail::has_on_impulse<Action>) action.on_impulse(impulse, before);
    });
    for (int a = 0; a < d; ++a) momentum[a] = before[a] + impulse[a];
}

/// Where no action touches what is marked.
struct NothingMarked
{};

/// The velocity of lanes of nodes after all effects on velocities. `marked(tag)` is the share of their mass
/// that a mark is about, for actions that touch what is marked.
///
/// Obstacles act one after the other. Where two of them meet (a corner), a second pass settles friction, and
/// four passes of pure non-penetration follow.
template <Lane Real, int d, class... Actions, class Marked = NothingMarked>
FIRN_HOST_DEVICE Vector<Real, d>
apply_on_nodes(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
               NodesOfStep<Real> const& nodes, Vector<Real, d> velocity,
               Reactions<Chain<Actions...>::obstacles>& reactions, [[maybe_unused]] Marked const& marked = {})
{
    constexpr int obstacles = Chain<Actions...>::obstacles, groups = Chain<Actions...>::groups;
    [[maybe_unused]] TouchingObstacles touching[std::size_t(groups > 0 ? groups : 1)];
    Mask<Real> once = Real(1) < Real(0), twice = once;

    auto const pass = [&](bool first_pass, bool only_non_penetration) {
        auto const meet = [&](auto const& action, Reaction& received) { // returns whether they touch
            using Action = std::decay_t<decltype(action)>;
            auto const touched = [&] {
                if constexpr (detail::has_touch_marked<Action>)
                    return action.touch_marked(place, velocity, marked(typename Action::Marked{}));
                else
                    return action.touch(place, velocity,
                                        only_non_penetration ? Contact::slip() : action.contact);
            }();
            if (!any(touched.inside)) return false;
            detail::book<Real, d>(received, touched, velocity, nodes.booked_mass);
            velocity = touched.velocity;
            reactions.largest_surface_speed2 =
                max(reactions.largest_surface_speed2, double(largest(touched.surface_speed2)));
            twice = twice | (once & touched.inside);
            once = once | touched.inside;
            return true;
        };
        int obstacle = 0;
        [[maybe_unused]] int group = 0;
        chain.for_each([&](auto const& action) {
            using Action = std::decay_t<decltype(action)>;
            if constexpr (detail::has_on_node<Action>)
                if (first_pass) {
                    LaneNode<Real, d> const node{place, nodes.kilograms(), Real(nodes.dt)};
                    Vector<Real, d> const after = action.on_node(node, velocity);
                    for (int a = 0; a < d; ++a) velocity[a] = select(nodes.filled, after[a], velocity[a]);
                }
            if constexpr (is_group_on_nodes<Action>)
                action.for_each_near(place, first_pass, touching[group++],
                                     [&](auto const& one, auto const& receive) {
                                         Reaction received;
                                         bool const touches = meet(one, received);
                                         if (touches) receive(received);
                                         return touches;
                                     });
            else if constexpr (!is_group<Action> && !is_wall<Action> && is_obstacle<Action>)
                meet(action, reactions.of[std::size_t(obstacle)]);
            obstacle += int(is_obstacle<Action>);
        });
    };
    pass(true, false);
    if constexpr (obstacles > 1 || groups > 0)
        if (any(twice)) {
            pass(false, false);
            for (int i = 0; i < 4; ++i) pass(false, true);
        }
    return velocity;
}

/// Contact of lanes of particles with the obstacles that act on particles, after the grid moved them by
/// `moved` [m] to `place`; `here` masks the lanes that hold a particle. Corrects the velocity, and returns
/// the displacement [m] that goes with it. See ParticleContact.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE Vector<Real, d>
apply_on_particles(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
                   Vector<Real, d> const& moved, Mask<Real> const& here, Real mass, Real dt,
                   Vector<Real, d>& velocity, Reactions<Chain<Actions...>::obstacles>& reactions)
{
    ParticleContact<Real, d, Chain<Actions...>> contact{
        {chain, place, moved, here, mass, dt, velocity, reactions}};
    return contact.solve();
}

/// The same, not inlined on a device, for loops that have no registers to spare for it. A device keeps
/// arguments that are passed by reference in memory: pass copies made for the call, or values that nothing
/// else needs.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE FIRN_NOINLINE_ON_DEVICE Vector<Real, d>
call_on_particles(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
                  Vector<Real, d> const& moved, Mask<Real> const& here, Real mass, Real dt,
                  Vector<Real, d>& velocity, Reactions<Chain<Actions...>::obstacles>& reactions)
{
    return apply_on_particles<Real, d>(chain, place, moved, here, mass, dt, velocity, reactions);
}

} // namespace firn
