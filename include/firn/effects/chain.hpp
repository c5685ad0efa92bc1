// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/obstacle.hpp>

#include <array>

namespace firn
{

/// The sum of what obstacles received, in the order in which they were passed.
template <int obstacles>
struct Reactions
{
    std::array<Reaction, obstacles> of{};
    double largest_surface_speed2 = 0; ///< of an obstacle where something touched it [m^2/s^2]

    FIRN_HOST_DEVICE void merge(Reactions const& other)
    {
        for (int i = 0; i < obstacles; ++i) of[i] += other.of[i];
        largest_surface_speed2 = max(largest_surface_speed2, other.largest_surface_speed2);
    }
};

/// Whether an action is that of a shell.
template <class Action>
inline constexpr bool keeps_sides = requires
{
    requires Action::keeps_sides;
};

/// Whether an action is that of a reflecting wall, which UpdateGrid takes care of.
template <class Action>
inline constexpr bool is_wall = requires
{
    requires Action::mirrors;
};

/// The actions of a step's effects, applied in the order in which they were passed.
template <class... Actions>
struct Chain;

template <>
struct Chain<>
{
    static constexpr int obstacles = 0, walls = 0;
    template <class Visit>
    FIRN_HOST_DEVICE void for_each(Visit const&) const
    {}
};

template <class First, class... Rest>
struct Chain<First, Rest...>
{
    First first;
    Chain<Rest...> rest;
    static constexpr int obstacles = int(First::is_obstacle) + Chain<Rest...>::obstacles;
    static constexpr int walls = int(is_wall<First>) + Chain<Rest...>::walls;

    template <class Visit>
    FIRN_HOST_DEVICE void for_each(Visit const& visit) const
    {
        visit(first);
        rest.for_each(visit);
    }
};

/// Whether one of them acts on particles, too.
template <class... Actions>
FIRN_HOST_DEVICE bool touches_particles(Chain<Actions...> const& chain)
{
    bool wanted = false;
    chain.for_each([&](auto const& action) {
        if constexpr (std::decay_t<decltype(action)>::is_obstacle) wanted = wanted || action.on_particles;
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

/// The effects of a step as plain values, from which their actions follow wherever the step's length is
/// known.
template <class... Effects>
struct PlainEffects;

template <>
struct PlainEffects<>
{
    template <class Number, int d>
    FIRN_HOST_DEVICE Chain<> during(Interval const&) const
    {
        return {};
    }
    bool touch_particles() const { return false; }
};

template <class First, class... Rest>
struct PlainEffects<First, Rest...>
{
    First first;
    PlainEffects<Rest...> rest;

    /// The chain of the effects' actions during a step.
    template <class Number, int d>
    FIRN_HOST_DEVICE auto during(Interval const& interval) const
    {
        return detail::linked(first.template during<Number, d>(interval),
                              rest.template during<Number, d>(interval));
    }

    /// Whether one of them acts on particles, too.
    bool touch_particles() const
    {
        if constexpr (requires { first.on_particles; })
            if (first.on_particles) return true;
        return rest.touch_particles();
    }
};

inline PlainEffects<> plain_effects() { return {}; }

template <class First, class... Rest>
auto plain_effects(First const& first, Rest const&... rest)
{
    auto const plain = [&] {
        if constexpr (requires { first.plain(); })
            return first.plain();
        else
            return first;
    }();
    return [&]<class... Others>(PlainEffects<Others...> const& others) {
        return PlainEffects<std::remove_const_t<decltype(plain)>, Others...>{plain, others};
    }(plain_effects(rest...));
}

namespace detail
{
/// Books what contact took from lanes of mass m: impulse m (before - after), and its moment about the
/// reference point.
template <Lane Real, int d>
FIRN_HOST_DEVICE void book(Reaction& reaction, Touched<Real, d> const& touched, Vector<Real, d> const& before,
                           Real mass)
{
    constexpr int width = lane_width<Real>;
    Scalar<Real> impulse[d][width], arm[d][width];
    for (int a = 0; a < d; ++a) {
        // lanes without a particle may hold anything
        Real const taken = select(touched.inside, (before[a] - touched.velocity[a]) * mass, Real(0));
        LaneTraits<Real>::store(taken, impulse[a]);
        LaneTraits<Real>::store(touched.arm[a], arm[a]);
    }
    for (int lane = 0; lane < width; ++lane) {
        Eigen::Vector3d p = Eigen::Vector3d::Zero(), r = Eigen::Vector3d::Zero();
        for (int a = 0; a < d; ++a) p[a] = impulse[a][lane], r[a] = arm[a][lane];
        reaction.impulse += p;
        reaction.angular_impulse += r.cross(p);
    }
}
} // namespace detail

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
FIRN_HOST_DEVICE Vector<Real, d> apply_on_nodes(Chain<Actions...> const& chain, Place<Real, d> const& place,
                                                Real mass, Vector<Real, d> velocity,
                                                Reactions<Chain<Actions...>::obstacles>& reactions)
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
                    detail::book<Real, d>(reactions.of[obstacle], touched, velocity, mass);
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
/// a place, where they are `here`: corrects v, and returns the displacement [m] that goes with it, a push out
/// of the obstacle of at most a quarter of a cell included.
template <Lane Real, int d, class... Actions>
FIRN_HOST_DEVICE Vector<Real, d>
apply_on_particles(Chain<Actions...> const& chain, Place<Real, d> const& place, Vector<Real, d> const& moved,
                   Mask<Real> const& here, Real mass, Real dt, Vector<Real, d>& velocity,
                   Reactions<Chain<Actions...>::obstacles>& reactions)
{
    Vector<Real, d> displacement = Vector<Real, d>::Zero();
    int obstacle = 0;
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (is_wall<Action>)
            ++obstacle;
        else if constexpr (Action::is_obstacle) {
            if (!keeps_sides<Action> && action.on_particles) {
                auto touched = action.template touch<Real>(place, velocity, action.contact);
                touched.inside = touched.inside & here;
                if (any(touched.inside)) {
                    detail::book<Real, d>(reactions.of[obstacle], touched, velocity, mass);
                    // a particle deep inside comes out over several steps: a step that moves it by a cell is
                    // rejected
                    Real const out = min(touched.depth, Real(Scalar<Real>(0.25 * place.lattice.cell_size)));
                    displacement += (touched.velocity - velocity) * dt + touched.normal * out;
                    velocity = touched.velocity;
                }
            }
            ++obstacle;
        }
    });
    // Shells have the last word, or a solid might push particles through one.
    obstacle = 0;
    chain.for_each([&](auto const& action) {
        using Action = std::decay_t<decltype(action)>;
        if constexpr (keeps_sides<Action>) {
            Place<Real, d> there = place;
            there.offset += displacement * Real(Scalar<Real>(1 / place.lattice.cell_size));
            Vector<Real, d> correction;
            auto touched =
                action.template keep_side<Real>(there, moved + displacement, velocity, dt, correction);
            touched.inside = touched.inside & here;
            if (any(touched.inside)) {
                detail::book<Real, d>(reactions.of[obstacle], touched, velocity, mass);
                displacement += correction;
                velocity = touched.velocity;
            }
        }
        obstacle += int(Action::is_obstacle);
    });
    return displacement;
}

} // namespace firn
