// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/effects/actions.hpp>

#include <limits>
#include <string>

// Checks the effects and predicates of a call before anything changes.
namespace firn::detail
{

/// Refuses a bound that is negative or not finite.
inline void require_bound(double bound, char const* what, char const* unit)
{
    require(bound >= 0 && bound <= std::numeric_limits<double>::max(), what, "an effect", unit);
}

/// Refuses invalid bounds of an effect in d dimensions, by which no step could be chosen.
template <int d, class Effect>
void validate_bounds(Effect const& effect)
{
    if constexpr (requires { effect.largest_acceleration(); })
        require_bound(effect.largest_acceleration(),
                      "its largest acceleration is not a finite number, 0 or above", "Return m/s^2.");
    char const* const speed = "its largest speed is not a finite number, 0 or above";
    if constexpr (requires { effect.largest_speed(d); })
        require_bound(effect.largest_speed(d), speed, "Return m/s.");
    else if constexpr (requires { effect.largest_speed(); })
        require_bound(effect.largest_speed(), speed, "Return m/s.");
}

[[noreturn, gnu::cold]] inline void refuse_effect(Error const& error, int place, char const* call)
{
    throw Error{error.what_is_wrong(), error.where() + ", effect " + std::to_string(place) + " of " + call,
                error.remedy()};
}

/// Refuses an invalid effect, the argument of a call in this place.
template <class Scene, class Effect>
void validate_effect(char const* call, int place, [[maybe_unused]] Scene const& scene, Effect const& effect)
{
    using Backend = typename Scene::Backend;
    constexpr int d = Scene::d;
    if constexpr (requires { Effect::in_host_memory; })
        static_assert(Backend::reaches_host_memory || !Effect::in_host_memory,
                      "the obstacle's shape lies in memory of the host: pass shape.on(backend)");
    try {
        effect.validate();
        if constexpr (d == 2 && requires { effect.validate_in_plane(); }) effect.validate_in_plane();
        if constexpr (requires { effect.validate_in(scene.lattice, d); })
            effect.validate_in(scene.lattice, d);
        validate_bounds<d>(effect);
        if constexpr (Chain<ActionOf<Effect, typename Scene::Number, d>>::uses_kilograms)
            require(scene.bears_kilograms(),
                    "it asks for masses in kg, and those of the scene are beyond its numbers", "an effect",
                    "Compute in double, or let particles have 1e-27 to 1e28 kg.");
    }
    catch (Error const& error) {
        refuse_effect(error, place, call);
    }
}

/// Refuses invalid effects of a call on a scene, which is a SceneState; the error says which argument it is.
template <class Scene, class... Effects>
void validate_effects([[maybe_unused]] char const* call, [[maybe_unused]] Scene const& scene,
                      Effects const&... effects)
{
    [[maybe_unused]] int place = 0;
    (validate_effect(call, ++place, scene, effects), ...);
}

/// Refuses an invalid predicate of positions, such as Inside<Shape>.
template <class Backend, int d, class Predicate>
void validate_predicate(Predicate const& predicate)
{
    if constexpr (requires { Predicate::in_host_memory; })
        static_assert(Backend::reaches_host_memory || !Predicate::in_host_memory,
                      "the shape lies in memory of the host: pass shape.on(backend)");
    if constexpr (requires { predicate.validate(); }) predicate.validate();
    if constexpr (d == 2 && requires { predicate.validate_in_plane(); }) predicate.validate_in_plane();
}

} // namespace firn::detail
