// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/hooks.hpp>

#include <concepts>
#include <type_traits>
#include <utility>

// What the hooks of an effect's action must be, and the check that none of its members would be ignored.
namespace firn
{

namespace detail
{
/// Whether on_momentum accepts a temporary: its change of the momentum would then be lost.
template <class Action, class Real, int d>
concept TakesCopyOfMomentum = requires(Action const action, Real const mass)
{
    action.on_momentum(Vector<Real, d>(), mass);
};

/// The same of on_impulse.
template <class Action, class Real, int d>
concept TakesCopyOfImpulse = requires(Action const action, Vector<Real, d> const momentum)
{
    action.on_impulse(Vector<Real, d>(), momentum);
};
} // namespace detail

/// Whether an action is that of a reflecting wall, which UpdateGrid applies.
template <class Action>
inline constexpr bool is_wall = requires
{
    requires Action::mirrors;
};

/// On what obstacles act whose number is known at run time.
enum class ActsOn
{
    nodes,     ///< which is what a solid does unless it says `on_particles`
    particles, ///< and on the particles themselves, those with `on_particles`; steps on a device cost more
    surface,   ///< by impulses at points of their surface: see SurfacePoint
    surface_and_particles, ///< so, and on the particles themselves, those with `on_particles`
};
/// Whether surfaces are among that.
constexpr bool acts_at_surface(ActsOn on)
{
    return on == ActsOn::surface || on == ActsOn::surface_and_particles;
}
/// Whether particles are among that.
constexpr bool acts_on_particles_too(ActsOn on)
{
    return on == ActsOn::particles || on == ActsOn::surface_and_particles;
}

/// Whether an action is that of many obstacles, whose number is known at run time: see Obstacles.
template <class Action>
inline constexpr bool is_group = requires
{
    requires Action::is_group;
};
/// The same of obstacles that act by impulses at points of their surface, for which UpdateGrid does nothing.
template <class Action>
inline constexpr bool is_group_at_surface = requires
{
    requires Action::is_group && Action::acts_at_surface;
};
/// The same of obstacles that act on nodes, in UpdateGrid.
template <class Action>
inline constexpr bool is_group_on_nodes = is_group<Action> && !is_group_at_surface<Action>;
/// The same of obstacles of which some may act on particles.
template <class Action>
inline constexpr bool is_group_on_particles = requires
{
    requires Action::is_group && Action::acts_on_particles;
};

/// Whether an action is that of an obstacle, which has a reaction.
template <class Action>
inline constexpr bool is_obstacle =
    is_wall<Action> || detail::has_touch<Action> || detail::has_touch_marked<Action>;

/// Whether an obstacle's action may act on particles, too.
template <class Action>
inline constexpr bool acts_on_particles = detail::has_hold<Action>;

/// Whether what an action does to momentum is the same in any unit of mass: it is then called with the
/// solver's own, which saves a conversion.
template <class Action>
inline constexpr bool takes_any_unit_of_mass = requires
{
    requires Action::takes_any_unit_of_mass;
};

/// An action that accelerates lanes of nodes where they are [m/s^2]: `m a dt` is added to their momentum, dt
/// being the time for which forces act.
template <class Action, class Real, int d>
concept AcceleratesNodes = requires(Action const action, LanePosition<Real, d> const place)
{
    {
        action.acceleration(place)
        } -> std::same_as<Vector<Real, d>>;
};

/// An action that changes the momentum [kg m/s] of lanes of nodes of a mass [kg].
template <class Action, class Real, int d>
concept ChangesMomentum = !detail::TakesCopyOfMomentum<Action, Real, d> &&
                          requires(Action const action, Vector<Real, d> momentum, Real const mass)
{
    {
        action.on_momentum(momentum, mass)
        } -> std::same_as<void>;
};

/// An action that returns a force [N] on lanes of outward areas [m^2], which particles have scattered: see
/// LoadedSurfaces. Both may be over one unit of mass, so the force is linear in the area.
template <class Action, class Real, int d>
concept LoadsSurfaces = requires(Action const action, Vector<Real, d> const area)
{
    {
        action.surface_force(area)
        } -> std::same_as<Vector<Real, d>>;
};

/// An action that accelerates what is marked by `Action::Marked` on lanes of nodes [m/s^2], where they are:
/// see Marks. `m a dt` is added to their momentum, m being the mass that is marked.
template <class Action, class Real, int d>
concept AcceleratesMarked = requires(Action const action, LanePosition<Real, d> const place)
{
    typename Action::Marked;
    {
        action.marked_acceleration(place)
        } -> std::same_as<Vector<Real, d>>;
};

/// An action that changes the impulse of all forces on lanes of nodes in the step, knowing their momentum
/// before it, both in one unit: with transfers that sum the forces apart from the momentum.
template <class Action, class Real, int d>
concept ChangesImpulse =
    !detail::TakesCopyOfImpulse<Action, Real, d> &&
    requires(Action const action, Vector<Real, d> impulse, Vector<Real, d> const momentum)
{
    {
        action.on_impulse(impulse, momentum)
        } -> std::same_as<void>;
};

/// An action that returns a new velocity [m/s] for lanes of nodes.
template <class Action, class Real, int d>
concept ChangesVelocity = requires(Action const action, LaneNode<Real, d> const node,
                                   Vector<Real, d> const velocity)
{
    {
        action.on_node(node, velocity)
        } -> std::same_as<Vector<Real, d>>;
};

/// An obstacle's action on lanes of nodes with a velocity [m/s], by its `contact` or, in the last passes over
/// a corner, by slip: see Obstacle.
template <class Action, class Real, int d>
concept TouchesNodes = requires(Action const action, LanePosition<Real, d> const place,
                                Vector<Real, d> const velocity, Contact const rule)
{
    {
        action.contact
        } -> std::convertible_to<Contact>;
    {
        action.touch(place, velocity, rule)
        } -> std::same_as<ContactResult<Real, d>>;
};

/// An action on lanes of nodes with a velocity [m/s] by the share of their mass, 0 to 1, that is marked by
/// `Action::Marked`: see Marks. It has a reaction, as an obstacle has.
template <class Action, class Real, int d>
concept TouchesMarked = requires(Action const action, LanePosition<Real, d> const place,
                                 Vector<Real, d> const velocity, Real const share)
{
    typename Action::Marked;
    {
        action.touch_marked(place, velocity, share)
        } -> std::same_as<ContactResult<Real, d>>;
};

/// An action that can act on lanes of particles, too: Obstacle::Action documents each of the calls.
template <class Action, class Real, int d>
concept HoldsParticles = requires(Action const action, LanePosition<Real, d> const place,
                                  Vector<Real, d> const vector, Contact const rule, Real const dt)
{
    {
        action.hold(place, vector, vector, rule)
        } -> std::same_as<ContactResult<Real, d>>;
    {
        action.overlap(place, vector)
        } -> std::same_as<Real>;
    {
        action.template lost_beyond<ScalarOf<Real>>(place.lattice)
        } -> std::same_as<ScalarOf<Real>>;
    {
        action.carried(place, vector, dt)
        } -> std::same_as<Vector<Real, d>>;
    {
        action.reference()
        } -> std::convertible_to<Eigen::Vector3d>;
};

/// The same for an obstacle: its member `on_particles` says whether it does.
template <class Action, class Real, int d>
concept MayHoldParticles = HoldsParticles<Action, Real, d> && requires(Action const action)
{
    {
        action.on_particles
        } -> std::convertible_to<bool>;
};

/// An action that mirrors all that is on one side of a plane of nodes: see ReflectingWall.
template <class Action, class Real, int d>
concept MirrorsNodes = HoldsParticles<Action, Real, d> && requires(Action const action)
{
    {
        action.axis
        } -> std::convertible_to<int>;
    {
        action.node
        } -> std::convertible_to<int>;
    {
        action.side
        } -> std::convertible_to<int>;
};

namespace detail
{
/// Whether an action has a hook, and every member with the name of a hook has the signature that is called.
template <class Action, class Real, int d>
constexpr bool has_only_hooks_that_are_called()
{
    bool has = is_obstacle<Action> || is_group<Action>, called = true;
    if constexpr (has_acceleration<Action>) has = true, called = called && AcceleratesNodes<Action, Real, d>;
    if constexpr (has_on_momentum<Action>) has = true, called = called && ChangesMomentum<Action, Real, d>;
    if constexpr (has_surface_force<Action>) has = true, called = called && LoadsSurfaces<Action, Real, d>;
    if constexpr (has_marked_acceleration<Action>)
        has = true, called = called && AcceleratesMarked<Action, Real, d>;
    if constexpr (has_on_impulse<Action>) has = true, called = called && ChangesImpulse<Action, Real, d>;
    if constexpr (has_on_node<Action>) has = true, called = called && ChangesVelocity<Action, Real, d>;
    if constexpr (is_wall<Action>)
        called = called && !has_touch<Action> && !has_touch_marked<Action> && MirrorsNodes<Action, Real, d>;
    else if constexpr (!is_group<Action>) {
        if constexpr (has_touch<Action>) called = called && TouchesNodes<Action, Real, d>;
        if constexpr (has_touch_marked<Action>)
            called = called && !has_touch<Action> && TouchesMarked<Action, Real, d>;
        if constexpr (has_hold<Action>)
            called = called && has_touch<Action> && MayHoldParticles<Action, Real, d>;
        else
            called = called && !has_other_contact<Action>;
    }
    return has && called;
}
} // namespace detail

/// What an effect's `over(interval)` returns: a plain value with at least one of the hooks above, const and
/// for lanes of the type that the backend computes with; on devices they are FIRN_HOST_DEVICE. Every member
/// with the name of a hook is taken for that hook, and refused if the library does not call that signature.
///
/// Of an action that has several, acceleration is called first, then on_momentum, surface_force,
/// marked_acceleration, on_impulse, on_node, and then contact. Actions act in the order in which their
/// effects are passed: all of them on momentum, then all on the impulse of the forces, then all on
/// velocities.
template <class Action, class Real, int d>
concept NodeAction =
    Lane<Real> && std::is_class_v<Action> && !std::is_final_v<Action> &&
    std::is_trivially_destructible_v<Action> && detail::has_only_hooks_that_are_called<Action, Real, d>();

} // namespace firn
