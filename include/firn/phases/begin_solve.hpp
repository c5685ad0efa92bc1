// SPDX-License-Identifier: MIT
#pragma once

#include <firn/phases/solve_contact.hpp>
#include <firn/phases/solve_phase.hpp>
#include <firn/phases/update_grid.hpp>

#include <cstddef>
#include <cstdint>

// The grid updates with which an implicit step begins and ends: see solve_phase.hpp.
namespace firn
{

/// On nodes that have mass and momentum: what the solve starts from. Forces act as in UpdateGrid, and what
/// obstacles do is found by asking them about motion along each axis: `c(v) = P v + (I - P) w` for a
/// projection P to motion that is free. Where it is not so, nodes touch an obstacle that separates or has
/// friction: UpdateContact finds what is free of them. Effects that act otherwise are counted as refused.
///
/// Sums: first the mass, second m |dv|^2 of the change dv by outside forces, third m |v*|^2.
template <class Space, class Kernel, class Transfer, class Effects>
struct BeginSolve : UpdateGrid<Space, Kernel, Transfer, Effects>
{
    using Update = UpdateGrid<Space, Kernel, Transfer, Effects>;
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using typename Update::Number, typename Update::Sums, typename Update::Values;
    using Update::d;
    using Own = typename Phase::Own;
    using Result = SolveSums<d>;

    bool at_rest;        ///< the scene is brought to rest: what moves does not count
    Number part_of_step; ///< after which velocities are asked for

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        LanePosition<Real, d> const place{this->lattice, node.first(), node.offset(),
                                          kernel_reach(Kernel::degree)};
        auto const sum = [&](int c) {
            return at_rest && c >= Sums::momentum && c < Sums::momentum + d ? Real(0) : node.sum(c);
        };
        auto const free = this->template free_node<Real>(
            place, sum, [](int) { return Real(0); }, [](int, Real const&) {}, Real(1) < Real(0));
        Mask<Real> const filled = free.nodes.filled;
        Real const mass = select(filled, free.nodes.mass, Real(0));
        auto const touched = touch_at<Real>(node, place, free, sum);
        FreeMotion<Real, d> const motion = free_motion<Real, d>(touched);
        Mask<Real> const counts = filled & counted(node), bent = is_bent(motion);
        Mask<Real> refused = bent & (motion.moves > Real(Number(1e-3)));
        if (at_rest)
            for (int a = 0; a < d; ++a) refused = refused | (abs(motion.still[a]) > Real(0));
        result.refused += count(refused & counts);
        result.touching += count(bent & counts);
        result.look(select(refused & counts, Real(1), Real(0)), node.first(), node.offset()[d - 1]);

        auto const old =
            make_vector<Real, d>([&](int a) { return sum(Sums::momentum + a) * free.inverse_mass; });
        Vector<Real, d> const change = (free.velocity - old) * Real(part_of_step), target = old + change;
        Matrix<Real, d> free_part = motion.free;
        Vector<Real, d> friction = zeros<Vector<Real, d>>();
        if (any(bent)) {
            ContactNow<Real, d> const contact = contact_now<Real, d>(touched, target, mass);
            for (int i = 0; i < d; ++i) {
                friction[i] = select(bent, contact.friction[i], Real(0));
                for (int j = 0; j < d; ++j)
                    free_part(i, j) = select(bent, contact.free(i, j), free_part(i, j));
            }
        }
        Real held(0);
        for (int a = 0; a < d; ++a) held += Real(1) - free_part(a, a);
        result.held += count(counts & !bent & (held > Real(Number(0.5))));
        set_start(node, filled, target, at_rest ? motion.still : touched(target), free_part, friction);
        node.set(Own::mass, mass);
        add_lanes(result.first, select(counts, mass, Real(0)));
        add_lanes(result.second, select(counts, mass * dot<Real, d>(change, change), Real(0)));
        add_lanes(result.third, select(counts, mass * dot<Real, d>(target, target), Real(0)));
    }

protected:
    /// Where effects act by more than a projection, beyond rounding.
    template <class Real>
    FIRN_HOST_DEVICE static Mask<Real> is_bent(FreeMotion<Real, d> const& motion)
    {
        return motion.bent > Real(Number(1e-3));
    }

    /// Sets what the solve starts from. What is free of the start is its change, which can be taken back.
    template <class Node, class Real = typename Node::Real>
    FIRN_HOST_DEVICE static void set_start(Node& node, Mask<Real> const& filled,
                                           Vector<Real, d> const& target, Vector<Real, d> const& start,
                                           Matrix<Real, d> const& free, Vector<Real, d> const& friction)
    {
        auto const set = [&](int c, Real const& value) { node.set(c, select(filled, value, Real(0))); };
        Vector<Real, d> const change = product<Real, d>(free, start);
        for (int a = 0; a < d; ++a) {
            set(Own::target + a, target[a]);
            set(Own::solution + a, start[a]);
            set(Values::velocity + a, start[a]);
            set(Own::change + a, change[a]);
            set(Own::friction + a, friction[a]);
            for (int b = 0; b <= a; ++b) set(Own::free_at(a, b), free(a, b));
        }
    }

    template <class Lanes>
    FIRN_HOST_DEVICE static std::uint64_t count(Lanes const& lanes)
    {
        std::uint64_t number = 0;
        for (std::uint64_t rest = bits(lanes); rest != 0; rest &= rest - 1) ++number;
        return number;
    }

    /// Calls `use(touched, filled)` with what obstacles make of a velocity of nodes, and where there are any.
    template <class Real, class Node, class Use>
    FIRN_HOST_DEVICE void with_obstacles(Node const& node, Use const& use) const
    {
        LanePosition<Real, d> const place{this->lattice, node.first(), node.offset(),
                                          kernel_reach(Kernel::degree)};
        auto const sum = [&](int c) { return node.sum(c); };
        auto const free = this->template free_node<Real>(
            place, sum, [](int) { return Real(0); }, [](int, Real const&) {}, Real(1) < Real(0));
        use(touch_at<Real>(node, place, free, sum), free.nodes.filled);
    }

    /// What obstacles make of a velocity of nodes.
    template <class Real, class Node, class Free, class Sum>
    FIRN_HOST_DEVICE auto touch_at([[maybe_unused]] Node const& node, LanePosition<Real, d> const& place,
                                   Free const& free, Sum const& sum) const
    {
        return [&](Vector<Real, d> const& v) {
            Vector<Real, d> after = touch<Real>(place, free, sum, v);
            if constexpr (requires { node.on_wall(0); })
                for (int a = 0; a < d; ++a) after[a] = select(node.on_wall(a), Real(0), after[a]);
            return after;
        };
    }

    /// The velocity after all effects on velocities, of which no reaction is booked.
    template <class Real, class Free, class Sum>
    FIRN_HOST_DEVICE Vector<Real, d> touch(LanePosition<Real, d> const& place, Free const& free,
                                           [[maybe_unused]] Sum const& sum, Vector<Real, d> const& v) const
    {
        Reactions<Effects::obstacles> unbooked;
        if constexpr (Effects::touches_marked)
            return apply_on_nodes<Real, d>(this->now->actions, place, free.nodes, v, unbooked, [&](auto tag) {
                return sum(Sums::template channel<NodeMark<decltype(tag)>>) * free.inverse_mass;
            });
        else
            return apply_on_nodes<Real, d>(this->now->actions, place, free.nodes, v, unbooked);
    }
};

/// On nodes that have mass and momentum again: the grid update of the step, with the impulse of stress that
/// was found. Effects act as in UpdateGrid and obstacles receive what they hold back, and then nodes take the
/// solution. Where that is the velocity in the middle of the step, forces act until then, and obstacles
/// receive twice what they hold back of it: velocities at the end are as far beyond.
template <class Space, class Kernel, class Transfer, class Effects>
struct ConcludeSolve : UpdateGrid<Space, Kernel, Transfer, Effects>
{
    using Update = UpdateGrid<Space, Kernel, Transfer, Effects>;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;
    using typename Update::Number, typename Update::Sums, typename Update::Values, typename Update::Result;
    using Update::d;

    using typename Update::Walls;
    static constexpr bool keeps_values = true, lists_images = true;

    bool at_rest;
    Number steps_of_impulse; ///< how often the impulse of stress fits into the step

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& reactions) const
    {
        using Real = typename Node::Real;
        LanePosition<Real, d> const place{this->lattice, node.first(), node.offset(),
                                          kernel_reach(Kernel::degree)};
        auto const sum = [&](int c) {
            Real total = node.sum(c);
            if (at_rest && c >= Sums::momentum && c < Sums::momentum + d) total = Real(0);
            if (c >= Sums::impulse && c < Sums::impulse + d) total -= not_given(node, c - Sums::impulse);
            return total;
        };
        auto const set = [&](int c, Real const& value) {
            bool const is_velocity = c >= Values::velocity && c < Values::velocity + d;
            node.set(c, is_velocity ? node.value(Own::solution + c - Values::velocity) : value);
        };
        act<Real>(place, sum, set, Real(0) <= Real(0), reactions);
    }

    template <class Node>
    static Mask<typename Node::Real> list_images(Walls const& walls, Node const& node)
    {
        return firn::list_images<d, Sums>(walls, node);
    }

    /// The same beside reflecting walls, as UpdateGrid does it: walls receive what they hold back, of the
    /// impulse of stress, too.
    template <class Node>
    FIRN_HOST_DEVICE void look_around(Walls const& walls, Node& node, Result& reactions) const
    {
        using Real = typename Node::Real;
        using Mirrored = MirroredNode<Sums, Real, d, Effects::walls>;
        Mirrored mirrored(walls, node);
        add_stress<Real>(node, mirrored);
        LanePosition<Real, d> place{this->lattice, mirrored.first, zeros<Vector<Real, d>>(),
                                    kernel_reach(Kernel::degree)};
        place.offset[d - 1] = mirrored.along;
        NodesBesideWalls<Own, Node, Mirrored, d> both(node, mirrored);
        Mask<Real> const received = both.counts();
        Real values[std::size_t(Update::channels)];
        act<Real>(
            place, [&](int c) { return mirrored.sums[c]; },
            [&](int c, Real const& value) { values[c] = value; }, received, reactions);
        Real solution[std::size_t(d)];
        for (int a = 0; a < d; ++a) { // nodes on a wall hold what it receives until it is booked
            solution[a] = both.value(Own::solution + a);
            Real& velocity = values[Values::velocity + a];
            velocity = select(both.on_wall(a), velocity, solution[a]);
            if constexpr (ends_beyond) // the velocity at the end of the step
                velocity = velocity * Real(steps_of_impulse) -
                           values[Values::old_velocity + a] * Real(steps_of_impulse - 1);
        }
        this->book_walls(mirrored, values, place.relative_to({0, 0, 0}), received, reactions);
        for (int a = 0; a < d; ++a) values[Values::velocity + a] = solution[a];
        for (int c = 0; c < Update::channels; ++c) {
            int const a = Values::axis(c);
            both.set(c, a >= 0 ? select(both.on_wall(a), Real(0), values[c]) : values[c]);
        }
    }

private:
    /// Whether the solution is the velocity before the end of the step.
    static constexpr bool ends_beyond = Transfer::Integrator::part_of_step < 1;

    /// What nodes lack at the time of the solution of what other forces give in the step: the impulse of
    /// stress, and what these give after that time.
    template <class Node, class Real = typename Node::Real>
    FIRN_HOST_DEVICE Real not_given(Node const& node, int a) const
    {
        Real lacks = node.value(Own::impulse + a);
        if constexpr (ends_beyond)
            lacks += (node.value(Own::mass) * node.value(Own::target + a) - node.sum(Sums::momentum + a)) *
                     Real(steps_of_impulse - 1);
        return lacks;
    }

    /// UpdateGrid's update, of which obstacles receive what belongs to the whole step.
    template <class Real, class Sum, class Set>
    FIRN_HOST_DEVICE void act(LanePosition<Real, d> const& place, Sum const& sum, Set const& set,
                              Mask<Real> const& received, Result& reactions) const
    {
        auto free = this->template free_node<Real>(
            place, sum, [](int) { return Real(0); }, set, received);
        if constexpr (ends_beyond) free.nodes.booked_mass *= Real(steps_of_impulse);
        this->template finish_node<Real>(place, free, free.velocity, sum, set, reactions);
    }

    /// Adds the impulse of stress to the sums of nodes and their images.
    template <class Real, class Node, class Mirrored>
    FIRN_HOST_DEVICE void add_stress(Node& node, Mirrored& mirrored) const
    {
        NodesBesideWalls<Own, Node, Mirrored, d> const both(node, mirrored);
        for (int a = 0; a < d; ++a) {
            if (at_rest) mirrored.sums[Sums::momentum + a] = Real(0);
            mirrored.sums[Sums::impulse + a] -= not_given(both, a);
        }
        for (std::size_t w = 0; w < mirrored.walls.size(); ++w) {
            WallPlane const& wall = mirrored.walls[w];
            Real const behind =
                Real(steps_of_impulse) * select(mirrored.mass_behind[w] > Real(0),
                                                node.value(Own::behind_at(wall.axis, wall.side)), Real(0));
            if (at_rest) mirrored.mass_behind[w] = mirrored.momentum_behind[w] = Real(0);
            if constexpr (Sums::forces_are_apart)
                mirrored.impulse_behind[w] -= behind;
            else
                mirrored.momentum_behind[w] -= behind;
        }
    }
};

} // namespace firn
