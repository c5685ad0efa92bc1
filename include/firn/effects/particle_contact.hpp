// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/actions.hpp>
#include <firn/effects/entered_surface.hpp>
#include <firn/effects/particles_at_obstacles.hpp>
#include <firn/effects/spared_depths.hpp>
#include <firn/math/product.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace firn
{

/// Contact of lanes of particles, after the grid has moved them, with the obstacles that act on particles; if
/// there are any, reflecting walls take part.
///
/// Solids act first, then shells, then walls. Each of them corrects the velocity into it, takes back the
/// motion into it, and pushes out what is still inside. Solids and shells push by at most a quarter of a cell
/// in a step, so a particle deep inside comes out over several. The motion is the one that moved the
/// particle: a particle with a velocity of its own may fly at an obstacle that has already stopped the grid's
/// motion.
///
/// In a corner one obstacle pushes into the other, so all of them act again until nothing moves: projections
/// onto convex sets in turn (von Neumann 1950, *Functional operators* II, chapter 13: where two planes meet
/// at an angle theta, what remains falls by cos² theta each time). Friction acts in the first pass alone. A
/// particle that is still inside after the last pass stays where it was at the beginning of the step, or goes
/// along with one of the obstacles, whichever leaves it least deep.
///
/// Several solids have one surface where they touch, overlap or share a face, that of their union. The face
/// nearest to a particle in one of them may lie within another one, or be that at its back. So a particle is
/// pushed out by the nearest face only if it was in front of that when the step began; else by the one
/// through which it came. A particle that is near two of them meets the one first that it comes into first,
/// even if it is out of it again at the end of the step, as where no more than edges touch. Solids are larger
/// by a thousandth of a cell then, so that rounding does not tell which side of a face particles are on.
template <Lane Real, int d, class Effects>
struct ParticleContact : ParticlesAtObstacles<Real, d, Effects>
{
    using Obstacles = ParticlesAtObstacles<Real, d, Effects>;
    using Obstacles::chain, Obstacles::place, Obstacles::moved, Obstacles::here, Obstacles::dt,
        Obstacles::velocity, Obstacles::may_fail, Obstacles::obstacles;
    static constexpr int passes = 8; ///< leave nothing in a corner of 75 degrees, a fifth of it in one of 30

    Vector<Real, d> displacement = zeros<Vector<Real, d>>(); ///< from the place [m]
    /// Velocity of the motion in this step [m/s]: the grid's, unless the transfer has one of its own.
    Vector<Real, d> motion = moved * (Real(1) / dt);
    Mask<Real> between = Real(1) < Real(0); ///< whether two solids are as near as the way of the step is long
    SparedDepths<Real, obstacles, (Effects::groups_on_particles > 0)> spared{};
    Real last{Number(-1)}; ///< the obstacle of the last contact

    /// Corrects the velocity, and returns the displacement [m] that goes with it.
    FIRN_HOST_DEVICE Vector<Real, d> solve()
    {
        // One pass is enough for a single solid. Only obstacles that act on particles count.
        std::uint32_t acting = 0;
        bool has_shells = Effects::shells > 0;
        chain.for_each([&](auto const& action) {
            using Action = std::decay_t<decltype(action)>;
            if constexpr (is_group_on_particles<Action>) {
                acting += action.acting; // also those that are far
                has_shells = has_shells || (keeps_sides<Action> && action.acting > 0);
            }
            else if constexpr (is_wall<Action>)
                ++acting;
            else if constexpr (acts_on_particles<Action>)
                acting += action.on_particles ? 1 : 0;
        });
        may_fail = acting > 1 || has_shells;
        int first_turn = 0;
        if constexpr (may_meet_several)
            if (may_fail) {
                if (!look_around()) first_turn = 1;
                if (any(between)) meet_first();
            }
        bool moves = pass(true, first_turn);
        if constexpr (may_meet_several)
            if (may_fail) {
                for (int i = 1; i < passes && moves; ++i) moves = pass(false, 0);
                if (moves) settle();
            }
        return displacement;
    }

private:
    using Obstacles::in_metres, Obstacles::tolerance, Obstacles::skin, Obstacles::way_past, Obstacles::after,
        Obstacles::for_each, Obstacles::nothing, Obstacles::entered, Obstacles::may_meet_several,
        Obstacles::turns, Obstacles::any_turn;
    using typename Obstacles::Number;
    template <class Action>
    static constexpr bool is_solid = Obstacles::template is_solid<Action>;
    using Result = ContactResult<Real, d>;
    using Entered = EnteredSurface<Real, d>;

    /// Finds lanes between solids. False if none of the lanes meets one.
    FIRN_HOST_DEVICE bool look_around()
    {
        Real near(0);
        bool meets = false;
        for_each(0, [&](auto const& action, int, auto const&) {
            using Action = std::decay_t<decltype(action)>;
            if constexpr (is_solid<Action>) {
                Vector<Real, d> const way = this->way_past(action, this->displacement);
                Real const distance =
                    max(-action.overlap(this->place, this->moved) - Real(this->skin()), Real(0));
                near += select(distance * distance <= dot<Real, d>(way, way), Real(1), Real(0));
            }
            else
                meets = true; // what a host has of its own is asked where it acts
        });
        between = here & (near > Real(Number(1.5)));
        return meets || any(here & (near > Real(0)));
    }
    /// Lets lanes between solids meet the one that they come into first.
    FIRN_HOST_DEVICE void meet_first()
    {
        Entered first{between, Real(2), Real(0), zeros<Vector<Real, d>>()};
        Real number{Number(-1)};
        for_each(0, [&](auto const& action, int i, auto const&) {
            if constexpr (is_solid<std::decay_t<decltype(action)>>) {
                Entered const of = this->entered(action, this->displacement, between);
                Mask<Real> const is_first = of.found & (of.when < first.when);
                number = select(is_first, Real(Number(i)), number);
                first.take(is_first, of);
            }
        });
        for_each(0, [&](auto const& action, int i, auto const& receive) {
            if constexpr (is_solid<std::decay_t<decltype(action)>>) {
                first.found = between & exactly_equal(number, Real(Number(i)));
                if (!any(first.found)) return;
                Result touched = this->nothing(action, this->after(this->displacement));
                touch_where_entered<Real, d>(action, first, this->velocity, action.contact, touched);
                this->out_of(touched, i, receive, action.contact, true, Real(0));
            }
        });
    }

    /// One pass over all obstacles. True if one moved something, which may now be inside another.
    FIRN_HOST_DEVICE bool pass(bool first, int first_turn)
    {
        Mask<Real> pushed = Real(1) < Real(0);
        for (int turn = first_turn; turn < turns; ++turn)
            for_each(turn, [&](auto const& action, int i, auto const& receive) {
                pushed = pushed | push(action, i, receive, first);
            });
        return any(pushed);
    }

    /// Takes away the velocity into one obstacle, and moves out what is inside it. Returns the lanes that it
    /// moved.
    template <class Action, class Receive>
    FIRN_HOST_DEVICE Mask<Real> push(Action const& action, int i, Receive const& receive, bool first)
    {
        Contact rule = Contact::slip();
        if constexpr (!is_wall<Action>)
            if (first) rule = action.contact;
        Result touched = touch(action, rule);
        if (!any(touched.inside)) return touched.inside;
        Number const lost_beyond = action.template lost_beyond<Number>(place.lattice);
        Real const depth = min(touched.depth, Real(lost_beyond));
        Real spare = max(depth - Real(in_metres(0.25)), Real(0));
        if (first)
            spared.set(i, spare);
        else
            spare = spared.of(i, depth, in_metres(0.25));
        return out_of(touched, i, receive, rule, first, spare);
    }

    /// Contact of lanes where they are now.
    template <class Action>
    FIRN_HOST_DEVICE Result touch(Action const& action, Contact const& rule) const
    {
        LanePosition<Real, d> const there = after(displacement);
        if constexpr (!may_meet_several || !is_solid<Action>) {
            Result touched = action.hold(there, Vector<Real, d>(moved + displacement), velocity, rule);
            touched.inside = touched.inside & here;
            return touched;
        }
        else {
            Result touched = action.template touch<Real>(there, velocity, rule, skin());
            touched.inside = touched.inside & here;
            if (!may_fail) return touched;
            Mask<Real> doubtful = between & !touched.inside;
            if (any(touched.inside)) { // were they behind the plane of the nearest face?
                Real const back = dot<Real, d>(way_past(action, displacement), touched.normal);
                doubtful = doubtful | (touched.inside & (back > Real(skin()) - touched.depth));
            }
            if (!any(doubtful)) return touched;
            Entered const of = entered(action, displacement, doubtful);
            if (!any(of.found)) return touched;
            if (!any(touched.inside)) touched = nothing(action, after(displacement));
            touch_where_entered<Real, d>(action, of, velocity, rule, touched);
            return touched;
        }
    }

    /// Moves lanes out by all but `spare` of their depth [m]. Returns those that it moved.
    template <class Receive>
    FIRN_HOST_DEVICE Mask<Real> out_of(Result const& touched, int i, Receive const& receive,
                                       Contact const& rule, bool first, Real spare)
    {
        receive(touched);
        Vector<Real, d> shift = zeros<Vector<Real, d>>();
        if (first) {
            Vector<Real, d> const left =
                touched.surface +
                rule.after<Real, d>(Vector<Real, d>(motion - touched.surface), touched.normal);
            shift = (left - motion) * dt;
            for (int a = 0; a < d; ++a) motion[a] = select(touched.inside, left[a], motion[a]);
        }
        Real out = touched.depth - spare;
        // The corrected motion already moves particles by `shift`, so they need less of a push. A single
        // solid pushes by all of the depth, since its distance may be an estimate, and too far out is better.
        if (may_fail) out = max(out - dot<Real, d>(shift, touched.normal), Real(0));
        for (int a = 0; a < d; ++a)
            shift[a] = select(touched.inside, shift[a] + touched.normal[a] * out, Real(0));
        displacement += shift;
        velocity = touched.velocity;
        last = select(touched.inside, Real(Number(i)), last);
        return dot<Real, d>(shift, shift) > tolerance() * tolerance();
    }

    /// How deep [m] lanes are in an obstacle after a displacement.
    template <class Action>
    FIRN_HOST_DEVICE Real overlap(Action const& action, Vector<Real, d> const& way) const
    {
        Real deep = action.overlap(after(way), Vector<Real, d>(moved + way));
        if constexpr (is_solid<Action>)
            if (Mask<Real> const doubtful = between | (deep > tolerance()); any(doubtful)) {
                Entered const of = entered(action, way, doubtful);
                deep = select(of.found, max(deep, of.depth - Real(skin()) * Real(Number(0.5))), deep);
            }
        return deep;
    }
    /// The cost of a displacement [m] from the place: the sum of the depths inside all obstacles [m], and far
    /// more where one of them would lose the particle.
    FIRN_HOST_DEVICE Real depths(Vector<Real, d> const& way) const
    {
        Real sum(0);
        for_each(any_turn, [&](auto const& action, int i, auto const&) {
            Real const deep = overlap(action, way);
            Real const lost_beyond(action.template lost_beyond<Number>(place.lattice));
            sum += max(deep - spared.of(i, min(deep, lost_beyond), in_metres(0.25)), Real(0)) +
                   select(deep > lost_beyond, Real(in_metres(1000)), Real(0));
        });
        return sum;
    }

    /// The last resort after all passes: see ParticleContact.
    FIRN_HOST_DEVICE void settle()
    {
        Real least = depths(displacement);
        Mask<Real> const stuck = here & (least > tolerance() * Real(2));
        if (!any(stuck)) return;
        Mask<Real> settled = Real(1) < Real(0);
        int all = obstacles;
        if constexpr (Effects::groups_on_particles > 0) {
            all = 0;
            for_each(any_turn, [&](auto const&, int, auto const&) { ++all; });
        }
        for (int with = -1; with < all; ++with) { // -1: back to where it was
            Vector<Real, d> way = -moved;
            [[maybe_unused]] int at = 0; // groups are asked where they are among the arguments
            for_each(any_turn, [&](auto const& action, [[maybe_unused]] int i, auto const&) {
                if ((Effects::groups_on_particles > 0 ? at++ : i) == with)
                    way += action.carried(place, moved, dt);
            });
            Real const depth = depths(way);
            Mask<Real> const better = stuck & (depth < least);
            least = select(better, depth, least);
            for (int a = 0; a < d; ++a) displacement[a] = select(better, way[a], displacement[a]);
            settled = settled | better;
        }
        if (!any(settled)) return;
        ContactResult<Real, d> touched;
        for (int a = 0; a < d; ++a)
            touched.velocity[a] = select(settled, (moved[a] + displacement[a]) / dt, velocity[a]);
        for_each(any_turn, [&](auto const& action, int i, auto const& receive) {
            touched.inside = settled & exactly_equal(last, Real(Number(i)));
            touched.arm = place.relative_to(action.reference());
            receive(touched);
        });
        velocity = touched.velocity;
    }
};

} // namespace firn
