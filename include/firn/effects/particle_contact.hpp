// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/actions.hpp>
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
template <Lane Real, int d, class Effects>
struct ParticleContact
{
    static constexpr int obstacles = Effects::obstacles;
    static constexpr int passes = 8; ///< leave nothing in a corner of 75 degrees, a fifth of it in one of 30

    Effects const& chain;
    LanePosition<Real, d> const& place;
    Vector<Real, d> const& moved; ///< to the place, since the step began [m]
    Mask<Real> const& here;
    Real mass, dt;
    Vector<Real, d>& velocity;
    Reactions<obstacles>& reactions;

    Vector<Real, d> displacement = zeros<Vector<Real, d>>(); ///< from the place [m]
    /// Velocity of the motion in this step [m/s]: the grid's, unless the transfer has one of its own.
    Vector<Real, d> motion = moved * (Real(1) / dt);
    bool may_fail = false; ///< whether one pass over the obstacles may not be enough
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
        bool moves = pass(true);
        if constexpr (obstacles > 1 || Effects::groups_on_particles > 0 || Effects::shells > 0)
            if (may_fail) {
                for (int i = 1; i < passes && moves; ++i) moves = pass(false);
                if (moves) settle();
            }
        return displacement;
    }

private:
    using Number = ScalarOf<Real>;

    FIRN_HOST_DEVICE Number in_metres(double cells) const { return Number(cells * place.lattice.cell_size); }
    /// An overlap [m] that counts as outside: single precision resolves no less a few cells from the
    /// reference.
    FIRN_HOST_DEVICE Real tolerance() const { return Real(in_metres(1e-5)); }

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

    /// One pass over all obstacles. True if one moved something, which may now be inside another.
    FIRN_HOST_DEVICE bool pass(bool first)
    {
        Mask<Real> pushed = Real(1) < Real(0);
        for (int turn = 0; turn < turns; ++turn)
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
        auto touched =
            action.hold(after(displacement), Vector<Real, d>(moved + displacement), velocity, rule);
        touched.inside = touched.inside & here;
        if (!any(touched.inside)) return touched.inside;

        receive(touched);
        Number const lost_beyond = action.template lost_beyond<Number>(place.lattice);
        Real const depth = min(touched.depth, Real(lost_beyond));
        Real spare = max(depth - Real(in_metres(0.25)), Real(0));
        if (first)
            spared.set(i, spare);
        else
            spare = spared.of(i, depth, in_metres(0.25));
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

    /// The cost of a displacement [m] from the place: the sum of the depths inside all obstacles [m], and far
    /// more where one of them would lose the particle.
    FIRN_HOST_DEVICE Real depths(Vector<Real, d> const& way) const
    {
        Real sum(0);
        for_each(any_turn, [&](auto const& action, int i, auto const&) {
            Real const overlap = action.overlap(after(way), Vector<Real, d>(moved + way));
            Real const lost_beyond(action.template lost_beyond<Number>(place.lattice));
            sum += max(overlap - spared.of(i, min(overlap, lost_beyond), in_metres(0.25)), Real(0)) +
                   select(overlap > lost_beyond, Real(in_metres(1000)), Real(0));
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
