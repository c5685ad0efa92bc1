// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/actions.hpp>
#include <firn/effects/particle_contact.hpp>

namespace firn
{

/// Adds what actions on momentum (gravity) do to lanes of nodes.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE void apply_on_momentum(Chain<Actions...> const& chain, Vector<Real, d>& momentum, Real mass)
{
    chain.for_each([&](auto const& action) {
        if constexpr (requires { action.on_momentum(momentum, mass); }) action.on_momentum(momentum, mass);
    });
}

/// The velocity of lanes of nodes after all effects on velocities.
///
/// Obstacles act one after the other. Where two of them meet (a corner) a second pass settles friction, and a
/// third, of pure non-penetration, has the last word.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE Vector<Real, d>
apply_on_nodes(Chain<Actions...> const& chain, LanePosition<Real, d> const& place, Real mass,
               Vector<Real, d> velocity, Reactions<Chain<Actions...>::obstacles>& reactions)
{
    constexpr int obstacles = Chain<Actions...>::obstacles;
    Mask<Real> once = Real(1) < Real(0), twice = once;

    auto const pass = [&](bool first_pass, bool only_non_penetration) {
        int obstacle = 0;
        chain.for_each([&](auto const& action) {
            using Action = std::decay_t<decltype(action)>;
            if constexpr (is_wall<Action>)
                ++obstacle;
            else if constexpr (Action::is_obstacle) {
                Contact const rule = only_non_penetration ? Contact::slip() : action.contact;
                auto const touched = action.template touch<Real>(place, velocity, rule);
                if (any(touched.inside)) {
                    detail::book<Real, d>(reactions.of[std::size_t(obstacle)], touched, velocity, mass);
                    velocity = touched.velocity;
                    reactions.largest_surface_speed2 =
                        max(reactions.largest_surface_speed2, double(largest(touched.surface_speed2)));
                    twice = twice | (once & touched.inside);
                    once = once | touched.inside;
                }
                ++obstacle;
            }
            else if constexpr (requires { action.on_node(velocity); }) {
                if (first_pass) velocity = action.on_node(velocity);
            }
        });
    };
    pass(true, false);
    if constexpr (obstacles > 1)
        if (any(twice)) {
            pass(false, false);
            for (int i = 0; i < 4; ++i) pass(false, true);
        }
    return velocity;
}

/// Contact of lanes of particles, for the obstacles that ask for it, after they were moved by `moved` [m] to
/// a place, where they are `here`: corrects v, and returns the displacement [m] that goes with it. See
/// ParticleContact.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE Vector<Real, d>
apply_on_particles(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
                   Vector<Real, d> const& moved, Mask<Real> const& here, Real mass, Real dt,
                   Vector<Real, d>& velocity, Reactions<Chain<Actions...>::obstacles>& reactions)
{
    ParticleContact<Real, d, Chain<Actions...>> contact{chain, place, moved,    here,
                                                        mass,  dt,    velocity, reactions};
    return contact.solve();
}

/// The same where it is too much for a loop's registers beside the rest. What is passed by reference a device
/// keeps in memory: a copy, made where this is called, or something that nobody else needs.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE FIRN_CALLED_ON_DEVICE Vector<Real, d>
call_on_particles(Chain<Actions...> const& chain, LanePosition<Real, d> const& place,
                  Vector<Real, d> const& moved, Mask<Real> const& here, Real mass, Real dt,
                  Vector<Real, d>& velocity, Reactions<Chain<Actions...>::obstacles>& reactions)
{
    return apply_on_particles<Real, d>(chain, place, moved, here, mass, dt, velocity, reactions);
}

} // namespace firn
