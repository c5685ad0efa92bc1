// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/actions.hpp>
#include <firn/math/product.hpp>

#include <array>

namespace firn
{

/// Contact of lanes of particles with the obstacles that act on them, and with reflecting walls then, after
/// the grid has moved them.
///
/// One after the other takes the velocity into it, and back the way that led into it, and moves what is still
/// inside out: solids first, then shells, by at most a quarter of a cell in a step (who is deep inside comes
/// out over several), then walls. The way is that by which the particle moved: one that keeps a velocity of
/// its own may fly at an obstacle while the grid, which it moves with, was stopped by it already. In a corner
/// one pushes into the other. So it begins anew until none of them moves anything (projections onto
/// convex sets in turn, von Neumann 1950, *Functional operators* II, chapter 13: where two planes meet at an
/// angle theta what remains falls by cos² theta each time); without friction, which has acted once. What then
/// still is where it must not be stays where it was at the beginning of the step, or goes along with one of
/// the obstacles, whichever is least inside any of them.
template <Lane Real, int d, class Effects>
struct ParticleContact
{
    static constexpr int obstacles = Effects::obstacles;
    static constexpr int passes = 8; ///< leaves nothing in a corner of 75 degrees, a fifth of it in one of 30

    Effects const& chain;
    LanePosition<Real, d> const& place;
    Vector<Real, d> const& moved; ///< to the place, since the step began [m]
    Mask<Real> const& here;
    Real mass, dt;
    Vector<Real, d>& velocity;
    Reactions<obstacles>& reactions;

    Vector<Real, d> displacement = zeros<Vector<Real, d>>(); ///< from the place [m]
    /// By which they move in this step [m/s]: the grid's, unless the transfer has one of its own.
    Vector<Real, d> motion = moved * (Real(1) / dt);
    bool may_fail = false; ///< whether to go through the obstacles once may not be enough
    std::array<Real, std::size_t(obstacles)> spared =
        no_depths();       ///< which each of them leaves inside in this step [m]
    Real last{Number(-1)}; ///< which of them has touched it last

    /// Corrects the velocity, and returns the displacement [m] that goes with it.
    FIRN_HOST_DEVICE Vector<Real, d> solve()
    {
        // A single solid is as good as its distance. Who does not act on particles does not count.
        int acting = 0;
        for_each([&](auto const&, int) { ++acting; });
        may_fail = acting > 1 || Effects::shells > 0;
        bool moves = pass(true);
        if constexpr (obstacles > 1 || Effects::shells > 0)
            if (may_fail) {
                for (int i = 1; i < passes && moves; ++i) moves = pass(false);
                if (moves) settle();
            }
        return displacement;
    }

private:
    using Number = ScalarOf<Real>;

    FIRN_HOST_DEVICE static std::array<Real, std::size_t(obstacles)> no_depths()
    {
        std::array<Real, std::size_t(obstacles)> depths;
        for (Real& depth : depths) depth = Real(0);
        return depths;
    }

    FIRN_HOST_DEVICE Number in_metres(double cells) const { return Number(cells * place.lattice.cell_size); }
    /// What counts as outside: single precision tells no less, a few cells from the reference.
    FIRN_HOST_DEVICE Real tolerance() const { return Real(in_metres(1e-5)); }

    /// The place after a displacement [m].
    FIRN_HOST_DEVICE LanePosition<Real, d> after(Vector<Real, d> const& way) const
    {
        LanePosition<Real, d> there = place;
        there.offset += way * Real(Number(1 / place.lattice.cell_size));
        return there;
    }

    /// Calls `use(action, i)` for those that act on particles, `i` counting all obstacles.
    template <class Use>
    FIRN_HOST_DEVICE void for_each(Use const& use) const
    {
        int i = 0;
        chain.for_each([&](auto const& action) {
            using Action = std::decay_t<decltype(action)>;
            if constexpr (is_wall<Action>)
                use(action, i);
            else if constexpr (acts_on_particles<Action>)
                if (action.on_particles) use(action, i);
            if constexpr (is_obstacle<Action>) ++i;
        });
    }

    /// Goes through all of them once. True if one moved something, which may now be inside another.
    FIRN_HOST_DEVICE bool pass(bool first)
    {
        Mask<Real> pushed = Real(1) < Real(0);
        // Later ones have it their way: nothing is to pass a shell, and rounding is what is left before a
        // wall.
        for (int turn = 0; turn < 3; ++turn)
            for_each([&](auto const& action, int i) {
                using Action = std::decay_t<decltype(action)>;
                if (turn == (is_wall<Action> ? 2 : keeps_sides<Action> ? 1 : 0))
                    pushed = pushed | push(action, i, first);
            });
        return any(pushed);
    }

    /// Takes the velocity into one of them, and what is inside it out. Returns where that moved something.
    template <class Action>
    FIRN_HOST_DEVICE Mask<Real> push(Action const& action, int i, bool first)
    {
        Contact rule = Contact::slip();
        if constexpr (!is_wall<Action>)
            if (first) rule = action.contact;
        auto touched =
            action.hold(after(displacement), Vector<Real, d>(moved + displacement), velocity, rule);
        touched.inside = touched.inside & here;
        if (!any(touched.inside)) return touched.inside;

        detail::book<Real, d>(reactions.of[static_cast<std::size_t>(i)], touched, velocity, mass);
        Real& spare = spared[static_cast<std::size_t>(i)];
        Number const lost_beyond = action.template lost_beyond<Number>(place.lattice);
        if (first) spare = max(min(touched.depth, Real(lost_beyond)) - Real(in_metres(0.25)), Real(0));
        Vector<Real, d> shift = zeros<Vector<Real, d>>();
        if (first) {
            Vector<Real, d> const left =
                touched.surface +
                rule.after<Real, d>(Vector<Real, d>(motion - touched.surface), touched.normal);
            shift = (left - motion) * dt;
            for (int a = 0; a < d; ++a) motion[a] = select(touched.inside, left[a], motion[a]);
        }
        Real out = touched.depth - spare;
        // What the motion no longer does needs no push, unless no other acts on particles: where a distance
        // is an estimate, too far out is better.
        if (may_fail) out = max(out - dot<Real, d>(shift, touched.normal), Real(0));
        for (int a = 0; a < d; ++a)
            shift[a] = select(touched.inside, shift[a] + touched.normal[a] * out, Real(0));
        displacement += shift;
        velocity = touched.velocity;
        last = select(touched.inside, Real(Number(i)), last);
        return dot<Real, d>(shift, shift) > tolerance() * tolerance();
    }

    /// How bad it would be to have gone a way [m] from the place: the depths inside all of them [m], and far
    /// more where one would have lost it.
    FIRN_HOST_DEVICE Real depths(Vector<Real, d> const& way) const
    {
        Real sum(0);
        for_each([&](auto const& action, int i) {
            Real const overlap = action.overlap(after(way), Vector<Real, d>(moved + way));
            Real const lost_beyond(action.template lost_beyond<Number>(place.lattice));
            sum += max(overlap - spared[static_cast<std::size_t>(i)], Real(0)) +
                   select(overlap > lost_beyond, Real(in_metres(1000)), Real(0));
        });
        return sum;
    }

    /// The last resort: see above.
    FIRN_HOST_DEVICE void settle()
    {
        Real least = depths(displacement);
        Mask<Real> const stuck = here & (least > tolerance() * Real(2));
        if (!any(stuck)) return;
        Mask<Real> settled = Real(1) < Real(0);
        for (int with = -1; with < obstacles; ++with) { // none of them: stays where it was
            Vector<Real, d> way = -moved;
            for_each([&](auto const& action, int i) {
                if (i == with) way += action.carried(place, moved, dt);
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
        for_each([&](auto const& action, int i) {
            touched.inside = settled & exactly_equal(last, Real(Number(i)));
            touched.arm = place.relative_to(action.reference());
            detail::book<Real, d>(reactions.of[static_cast<std::size_t>(i)], touched, velocity, mass);
        });
        velocity = touched.velocity;
    }
};

} // namespace firn
