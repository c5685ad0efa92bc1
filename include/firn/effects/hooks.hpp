// SPDX-License-Identifier: MIT
#pragma once

// Which hooks an effect's action has, by their names: node_action.hpp says what each of them must be.
namespace firn
{

namespace detail
{
/// The names of all hooks. An action has a member of such a name if the name is ambiguous in NamesOf.
struct HookNames
{
    int acceleration, on_momentum, surface_force, marked_acceleration, on_impulse, on_node, touch,
        touch_marked, hold, on_particles, overlap, lost_beyond, carried, reference;
};
template <class Action>
struct NamesOf : Action, HookNames
{};
template <class Action>
inline constexpr bool has_acceleration = !requires
{
    &NamesOf<Action>::acceleration;
};
template <class Action>
inline constexpr bool has_on_momentum = !requires
{
    &NamesOf<Action>::on_momentum;
};
template <class Action>
inline constexpr bool has_surface_force = !requires
{
    &NamesOf<Action>::surface_force;
};
template <class Action>
inline constexpr bool has_marked_acceleration = !requires
{
    &NamesOf<Action>::marked_acceleration;
};
template <class Action>
inline constexpr bool has_on_impulse = !requires
{
    &NamesOf<Action>::on_impulse;
};
template <class Action>
inline constexpr bool has_on_node = !requires
{
    &NamesOf<Action>::on_node;
};
template <class Action>
inline constexpr bool has_touch = !requires
{
    &NamesOf<Action>::touch;
};
template <class Action>
inline constexpr bool has_touch_marked = !requires
{
    &NamesOf<Action>::touch_marked;
};
template <class Action>
inline constexpr bool has_hold = !requires
{
    &NamesOf<Action>::hold;
};
template <class Action> // the other hooks, which only particle contact calls
inline constexpr bool has_other_contact = !requires
{
    &NamesOf<Action>::on_particles;
}
|| !requires { &NamesOf<Action>::overlap; }
|| !requires { &NamesOf<Action>::lost_beyond; }
|| !requires { &NamesOf<Action>::carried; }
|| !requires { &NamesOf<Action>::reference; };
} // namespace detail

} // namespace firn
