// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/effects/actions.hpp>
#include <firn/effects/entered_surface.hpp>
#include <firn/math/product.hpp>

#include <cstddef>
#include <type_traits>

namespace firn
{

/// Lanes of particles that the grid has moved, and the obstacles that act on them.
template <Lane Real, int d, class Effects>
struct ParticlesAtObstacles
{
    static constexpr int obstacles = Effects::obstacles;
    static constexpr bool may_meet_several =
        obstacles > 1 || Effects::groups_on_particles > 0 || Effects::shells > 0;
    using Number = ScalarOf<Real>;

    Effects const& chain;
    LanePosition<Real, d> const& place;
    Vector<Real, d> const& moved; ///< to the place, since the step began [m]
    Mask<Real> const& here;
    Real mass, dt;
    Vector<Real, d>& velocity;
    Reactions<obstacles>& reactions;
    bool may_fail = false; ///< whether one pass over the obstacles may not be enough

    /// Whether an action is that of a solid.
    template <class Action>
    static constexpr bool is_solid =
        !is_wall<Action> && !keeps_sides<Action> && requires(Action const& action)
    {
        action.template surface_at<Real>(place, moved);
    };

    FIRN_HOST_DEVICE Number in_metres(double cells) const { return Number(cells * place.lattice.cell_size); }
    /// An overlap [m] that counts as outside: single precision resolves no less a few cells from the
    /// reference.
    FIRN_HOST_DEVICE Real tolerance() const { return Real(in_metres(1e-5)); }

    /// By how much solids are larger where there are several [m].
    FIRN_HOST_DEVICE Number skin() const { return may_fail ? in_metres(1e-3) : Number(0); }
    /// The way of the step with a displacement [m], as it is relative to an obstacle.
    template <class Action>
    FIRN_HOST_DEVICE Vector<Real, d> way_past(Action const& action, Vector<Real, d> const& displaced) const
    {
        return moved + displaced - action.carried(place, moved, dt);
    }
    /// Where lanes came into a solid on this way.
    template <class Action>
    FIRN_HOST_DEVICE EnteredSurface<Real, d> entered(Action const& action, Vector<Real, d> const& displaced,
                                                     Mask<Real> const& lanes) const
    {
        return entered_surface<Real, d>(action, after(displaced), way_past(action, displaced), Real(skin()),
                                        lanes);
    }

    /// The place after a displacement [m].
    FIRN_HOST_DEVICE LanePosition<Real, d> after(Vector<Real, d> const& way) const
    {
        LanePosition<Real, d> there = place;
        there.offset += way * Real(Number(1 / place.lattice.cell_size));
        return there;
    }

    /// When an obstacle acts in a pass. The last to act prevails: nothing may pass a shell, and a wall leaves
    /// no more than rounding behind it.
    template <class Action>
    static constexpr int turn_to_act = is_wall<Action>       ? 2
                                       : keeps_sides<Action> ? 1
                                                             : 0;
    static constexpr int turns = 3, any_turn = -1;

    /// Calls `use(action, i, receive)` for every action on particles that has this turn; `i` counts all
    /// obstacles that are arguments, and behind them those of groups that are near, and `receive(touched)`
    /// books what contact takes.
    template <class Use>
    FIRN_HOST_DEVICE void for_each(int turn, Use const& use) const
    {
        int i = 0;
        [[maybe_unused]] int of_groups[2]{0, 0}; // by turn, so that numbers are the same whatever is skipped
        chain.for_each([&](auto const& action) {
            using Action = std::decay_t<decltype(action)>;
            constexpr int its_turn = turn_to_act<Action>;
            [[maybe_unused]] bool const acts = turn == any_turn || turn == its_turn;
            if constexpr (is_group_on_particles<Action>) {
                if (acts)
                    action.template for_each_near_particles<Real>(
                        place, dt, [&](auto const& one, auto const& add) {
                            use(one, obstacles + 2 * of_groups[its_turn]++ + its_turn,
                                [&](ContactResult<Real, d> const& touched) {
                                    Reaction received;
                                    detail::book<Real, d>(received, touched, velocity, mass);
                                    add(received);
                                });
                        });
            }
            else {
                [[maybe_unused]] auto const receive = [&](ContactResult<Real, d> const& touched) {
                    detail::book<Real, d>(reactions.of[static_cast<std::size_t>(i)], touched, velocity, mass);
                };
                if constexpr (is_wall<Action>) {
                    if (acts) use(action, i, receive);
                }
                else if constexpr (acts_on_particles<Action>)
                    if (acts && action.on_particles) use(action, i, receive);
                if constexpr (is_obstacle<Action>) ++i;
            }
        });
    }

    /// What lanes at a place touch that meet no solid.
    template <class Action>
    FIRN_HOST_DEVICE ContactResult<Real, d> nothing(Action const& action,
                                                    LanePosition<Real, d> const& where) const
    {
        Vector<Real, d> const none = zeros<Vector<Real, d>>();
        return {velocity, where.relative_to(action.position), Real(1) < Real(0), Real(0), none, none,
                Real(0)};
    }
};

} // namespace firn
