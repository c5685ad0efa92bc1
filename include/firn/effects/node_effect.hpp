// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/node_action.hpp>

#include <concepts>
#include <type_traits>
#include <utility>

// What an effect is, and the sentences that say why a type is none.
namespace firn
{

namespace detail
{
/// The names of an effect's optional members.
struct NamesOfEffects
{
    int plain, validate_in_plane, largest_acceleration, largest_speed, on_particles;
};
template <class Effect>
struct WithNamesOfEffects : Effect, NamesOfEffects
{};
template <class Effect>
inline constexpr bool has_plain = !requires
{
    &WithNamesOfEffects<Effect>::plain;
};
template <class Effect>
inline constexpr bool has_validate_in_plane = !requires
{
    &WithNamesOfEffects<Effect>::validate_in_plane;
};
template <class Effect>
inline constexpr bool has_largest_acceleration = !requires
{
    &WithNamesOfEffects<Effect>::largest_acceleration;
};
template <class Effect>
inline constexpr bool has_largest_speed = !requires
{
    &WithNamesOfEffects<Effect>::largest_speed;
};

template <class Effect>
inline constexpr bool has_on_particles = !requires
{
    &WithNamesOfEffects<Effect>::on_particles;
};

template <class Effect>
concept BoundsAcceleration = requires(Effect const effect)
{
    {
        effect.largest_acceleration()
        } -> std::convertible_to<double>;
};
template <class Effect, int d>
concept BoundsSpeed = requires(Effect const effect)
{
    {
        effect.largest_speed(d)
        } -> std::convertible_to<double>;
}
|| requires(Effect const effect)
{
    {
        effect.largest_speed()
        } -> std::convertible_to<double>;
};
template <class Effect>
concept IsMadePlain = requires(Effect const effect, double begin)
{
    effect.plain(begin);
}
|| requires(Effect const effect) { effect.plain(); };
template <class Effect>
concept IsValidatedInPlane = requires(Effect const effect)
{
    effect.validate_in_plane();
};

/// Whether every member of an effect with one of these names can be called as the library does.
template <class Effect, int d>
constexpr bool all_is_called()
{
    if constexpr (!std::is_class_v<Effect> || std::is_final_v<Effect>)
        return false; // the members of a final class cannot be found
    else {
        bool called = true;
        if constexpr (has_plain<Effect>) called = called && IsMadePlain<Effect>;
        if constexpr (has_validate_in_plane<Effect>) called = called && IsValidatedInPlane<Effect>;
        if constexpr (has_largest_acceleration<Effect>) called = called && BoundsAcceleration<Effect>;
        if constexpr (has_largest_speed<Effect>) called = called && BoundsSpeed<Effect, d>;
        return called;
    }
}

/// An effect as a plain value, for a call that begins at a time [s].
template <class Effect>
auto plain_effect(Effect const& effect, [[maybe_unused]] double begin)
{
    if constexpr (requires { effect.plain(begin); })
        return effect.plain(begin);
    else if constexpr (requires { effect.plain(); })
        return effect.plain();
    else
        return effect;
}
template <class Effect>
using PlainEffect = decltype(plain_effect(std::declval<Effect const&>(), 0.0));

/// The action of an effect.
template <class Effect, class Number, int d>
using ActionOf =
    decltype(std::declval<PlainEffect<Effect> const&>().template over<Number, d>(std::declval<Interval>()));

/// Has the members that every effect has.
template <class T, class Number, int d>
concept DescribesEffect = requires(T const effect)
{
    {
        effect.validate()
        } -> std::same_as<void>;
    typename ActionOf<T, Number, d>;
};

/// Whether an effect has the bounds on the time step that its action needs; and `on_particles` if its action
/// can act on particles, and only then.
template <class T, class Action, int d>
constexpr bool says_what_steps_need()
{
    bool says = true;
    if constexpr (has_acceleration<Action> || has_marked_acceleration<Action>)
        says = says && BoundsAcceleration<T>;
    if constexpr (has_touch<Action> || has_touch_marked<Action>) says = says && BoundsSpeed<T, d>;
    if constexpr (has_touch<Action> && has_hold<Action>) says = says && requires(PlainEffect<T> const plain)
        {
            bool(plain.on_particles);
        };
    else if constexpr (!std::is_final_v<PlainEffect<T>>)
        says = says && !has_on_particles<PlainEffect<T>>;
    return says;
}
} // namespace detail

/// An effect in a scene of `d` dimensions whose backend computes with lanes `Real`: it has `void validate()
/// const`, which refuses parameters, and `template <class Number, int d> Action over(firn::Interval const&)
/// const`, which makes its action for a step (see NodeAction).
///
/// If the action has an acceleration, or one of what is marked, the effect has `double largest_acceleration()
/// const` [m/s^2]; if it has contact, `double largest_speed() const` [m/s], or one that takes the number of
/// dimensions. These are finite bounds that limit the time step, and other effects may have them. An effect
/// may also have `void validate_in_plane() const` for scenes in two dimensions, and `auto plain(double begin)
/// const`, with or without the time [s] at which the call begins: it returns an effect that is a plain value,
/// and `over` is called on that.
template <class T, class Real, int d>
concept NodeEffect = detail::DescribesEffect<T, ScalarOf<Real>, d> &&
    NodeAction<detail::ActionOf<T, ScalarOf<Real>, d>, Real, d> &&
    std::is_trivially_destructible_v<detail::PlainEffect<T>> &&
    detail::says_what_steps_need<T, detail::ActionOf<T, ScalarOf<Real>, d>, d>() &&
    detail::all_is_called<T, d>();

namespace detail
{
/// Explains in a sentence why a type is not an effect; the compiler's note names the type.
template <class T, class Real, int d, bool describes = DescribesEffect<T, ScalarOf<Real>, d>>
struct CheckedEffect
{
    static_assert(
        describes,
        "what was passed is no effect of this scene: pass Gravity, Obstacle<Shape>, Obstacles<Shape>, "
        "ReflectingWall or one of your own, which has 'void validate() const' and 'template <class Number, "
        "int d> Action "
        "over(firn::Interval const&) const', each as an argument; a RigidBody goes in as an Obstacle with "
        "its motion");
    static constexpr bool value = false;
};
template <class T, class Real, int d>
struct CheckedEffect<T, Real, d, true>
{
    static constexpr bool has_action = NodeAction<ActionOf<T, ScalarOf<Real>, d>, Real, d>;
    static_assert(
        has_action,
        "the action that the effect's over() returns is to have at least one of "
        "'firn::Vector<Real, d> acceleration(firn::LanePosition<Real, d> const& place) const' [m/s^2], "
        "'void on_momentum(firn::Vector<Real, d>& momentum, Real mass) const' [kg m/s, kg], "
        "'firn::Vector<Real, d> surface_force(firn::Vector<Real, d> const& area) const' [N, m^2], "
        "'firn::Vector<Real, d> marked_acceleration(firn::LanePosition<Real, d> const& place) const' or "
        "'firn::ContactResult<Real, d> touch_marked(firn::LanePosition<Real, d> const& place, "
        "firn::Vector<Real, d> const& velocity, Real share) const' beside a type 'Marked', "
        "'void on_impulse(firn::Vector<Real, d>& impulse, firn::Vector<Real, d> const& momentum) const', "
        "'firn::Vector<Real, d> on_node(firn::LaneNode<Real, d> const& node, firn::Vector<Real, d> const& "
        "velocity) const' [m/s] and contact, 'firn::ContactResult<Real, d> touch(firn::LanePosition<Real, d> "
        "const& place, firn::Vector<Real, d> const& velocity, firn::Contact const& rule) const' beside a "
        "'firn::Contact contact'; each for the lanes Real that the backend computes with (template "
        "<firn::Lane Real>), none of these names with another signature or as data, nor hold, on_particles, "
        "carried, reference, overlap, lost_beyond or mirrors, which are those of obstacles and walls, in a "
        "plain class that is not final: see firn/effects/node_action.hpp");
    static constexpr bool is_plain = std::is_trivially_destructible_v<PlainEffect<T>>;
    static_assert(is_plain, "the effect owns something, and steps know it as a plain value: it lacks 'auto "
                            "plain() const', which returns an effect that is one");
    template <class Action>
    static constexpr bool bounds()
    {
        if constexpr (has_action && all_is_called<T, d>())
            return says_what_steps_need<T, Action, d>();
        else
            return true;
    }
    static_assert(bounds<ActionOf<T, ScalarOf<Real>, d>>(),
                  "the effect lacks what bounds the time step: 'double largest_acceleration() const' [m/s^2] "
                  "where its action has an acceleration, 'double largest_speed() const' [m/s] where it has "
                  "contact, 'bool on_particles' where its action has 'hold'; or it says on_particles where "
                  "nothing holds them");
    static_assert(all_is_called<T, d>(),
                  "the effect has a member by the name of plain, validate_in_plane, largest_acceleration or "
                  "largest_speed that cannot be called as the library does, or it is a final class, of which "
                  "that cannot "
                  "be told: see firn/effects/node_effect.hpp");
    static constexpr bool value = NodeEffect<T, Real, d>;
};

/// Fails to compile, with a sentence, if one of the types is not an effect.
template <class Real, int d, class... Others>
constexpr void require_effects()
{
    [[maybe_unused]] constexpr bool checked[]{CheckedEffect<Others, Real, d>::value...};
}
} // namespace detail

} // namespace firn
