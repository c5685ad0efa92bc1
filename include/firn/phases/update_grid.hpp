// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/effects/chain.hpp>
#include <firn/phases/mirrored_node.hpp>
#include <firn/phases/scatter.hpp>
#include <firn/phases/step_context.hpp>

#include <cassert>
#include <cstdint>
#include <type_traits>

namespace firn
{

namespace detail
{
/// Whether a set of node fields has the marks that the actions of a chain ask for.
template <class Set, class... Actions>
constexpr bool finds_marks(std::type_identity<Chain<Actions...>>)
{
    [[maybe_unused]] auto const finds = []<class Action>(std::type_identity<Action>) {
        if constexpr (has_marked_acceleration<Action> || has_touch_marked<Action>)
            return Set::template contains<NodeMark<typename Action::Marked>>;
        else
            return true;
    };
    return (true && ... && finds(std::type_identity<Actions>{}));
}
} // namespace detail

/// Phase 2: forces, gravity and obstacles act on momentum, which becomes velocity.
///
///   v_i = chain((m v + dt f + dt m g)_i / m_i)      Stomakhin et al. 2013, steps 4 and 5
///
/// What the transfer carries beside mass and momentum is updated by the policies that declare it.
///
/// A node of less than `smallest_mass` counts as empty: its quotient would be rounding error alone.
///
/// A node beside a reflecting wall adds the sums of its images to its own, see MirroredNode: it reads them
/// (`looks_around`), and so does each image. Both then have the same values, but for the sign of vectors
/// across the wall, which are 0 along its axis on it.
template <class Space, class Kernel, class Transfer, class Effects>
struct UpdateGrid : CarriedBy<Transfer>
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Carried = CarriedBy<Transfer>;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    using Values = NodeValues<d, ValuesOf<Transfer>>;
    using Result = Reactions<Effects::obstacles>;
    static constexpr int channels = Values::template channels<Kernel>;
    static constexpr bool looks_around = Effects::walls > 0;

    static_assert(!(ExtendsVelocities<Transfer> && looks_around),
                  "Xpic knows no ReflectingWall: choose another transfer, or an Obstacle for a wall");

    static_assert(!Effects::changes_impulse || Transfer::keeps_old_velocity,
                  "LocalDamping, and any action with on_impulse, needs the forces apart from the momentum: "
                  "choose Flip or Asflip as the transfer, or pass Damping instead");

    static_assert(!Effects::loads_surfaces || SumsOf<Transfer>::template contains<NodeArea>,
                  "Traction loads particles that are marked, and the transfer does not carry their marks: "
                  "choose Carrying<Mls, LoadedSurfaces>, or another base");

    static_assert(
        detail::finds_marks<SumsOf<Transfer>>(std::type_identity<Effects>{}),
        "MarkedForce and HeldMarked act on particles that are marked, and the transfer does not carry their "
        "marks: choose Carrying<Mls, Marks<Mark>>, with the mark that the effect names, or another "
        "base");

    StepContext<Number, Effects> const* now;
    Lattice lattice;
    Number smallest_mass;
    Number flip_fraction; ///< the share of its own velocity that a particle keeps: see Flip
    Number mass_unit = 1; ///< of the scene's masses [kg], for effects that ask for it

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& reactions) const
    {
        using Real = typename Node::Real;
        LanePosition<Real, d> const place{lattice, node.first(), node.offset(), kernel_reach(Kernel::degree)};
        update<Real>(
            place, [&](int c) { return node.sum(c); }, [&](int a) { return withheld<Real>(node, a); },
            [&](int c, Real const& value) { node.set(c, value); }, exactly_equal(Real(0), Real(0)),
            reactions);
    }

    /// The walls whose images nodes read.
    using Walls = std::array<WallPlane, Effects::walls>;
    FIRN_HOST_DEVICE Walls walls() const { return walls_of(now->actions); }

    /// Whether one of `count` nodes in a row along the last axis reads other nodes.
    FIRN_HOST_DEVICE static bool looks_around_at(Walls const& walls, Coordinates<d> const& first, int count)
    {
        return is_beside<d>(walls, first, count);
    }

    /// The same as operator() for a lane of nodes that read others.
    template <class Node>
    FIRN_HOST_DEVICE void look_around(Walls const& walls, Node& node, Result& reactions) const
    {
        using Real = typename Node::Real;
        MirroredNode<Sums, Real, d, Effects::walls> const mirrored(walls, node);
        LanePosition<Real, d> place{lattice, mirrored.first, zeros<Vector<Real, d>>(),
                                    kernel_reach(Kernel::degree)};
        place.offset[d - 1] = mirrored.along;
        Mask<Real> const received = !mirrored.is_image(); // else reactions were booked twice
        Real values[std::size_t(channels)];
        update<Real>(
            place, [&](int c) { return mirrored.sums[c]; }, [](int) { return Real(0); },
            [&](int c, Real const& value) { values[c] = value; }, received, reactions);
        book_walls(mirrored, values, place.relative_to({0, 0, 0}), received, reactions);
        for (int a = 0; a < d; ++a) {
            Mask<Real> const on_wall = mirrored.on_wall(a);
            for (int c = 0; c < channels; ++c) {
                if (Values::axis(c) != a) continue;
                Real const value = select(on_wall, Real(0), values[c]);
                node.set(c, select(mirrored.flipped[std::size_t(a)], -value, value));
            }
        }
        for (int c = Values::carried; c < channels; ++c)
            if (Values::axis(c) < 0) node.set(c, values[c]);
    }

protected:
    /// v_i^n - v_i*: the part of a node's old velocity that extending removed, where a transfer does so.
    template <class Real, class Node>
    FIRN_HOST_DEVICE static Real withheld(Node const& node, int a)
    {
        if constexpr (ExtendsVelocities<Transfer>)
            return node.value(Values::old_velocity + a) - node.value(Values::velocity + a);
        else
            return Real(0);
    }

    /// `received` are the lanes whose obstacle reactions are booked.
    template <class Real, class Sum, class Withheld, class Set>
    FIRN_HOST_DEVICE void update(LanePosition<Real, d> const& place, Sum const& sum, Withheld const& withheld,
                                 Set const& set, Mask<Real> const& received, Result& reactions) const
    {
        Free<Real> const node = free_node<Real>(place, sum, withheld, set, received);
        finish_node<Real>(place, node, node.velocity, sum, set, reactions);
    }

    /// Lanes of nodes on which forces have acted, and no obstacle has yet.
    template <class Real>
    struct Free
    {
        NodesOfStep<Real> nodes;
        Real inverse_mass; ///< 0 where a node is empty
        Vector<Real, d> velocity;
    };
    template <class Real, class Sum, class Withheld, class Set>
    FIRN_HOST_DEVICE Free<Real> free_node(LanePosition<Real, d> const& place, Sum const& sum,
                                          Withheld const& withheld, Set const& set,
                                          Mask<Real> const& received) const
    {
        Real const mass = sum(Sums::mass);
        assert(all(mass >= Real(0)) && "the mass of a node is not below 0");
        Mask<Real> const filled = mass > Real(smallest_mass);
        Real const inverse_mass = select(filled, Real(1) / select(filled, mass, Real(1)), Real(0));

        Vector<Real, d> momentum;
        [[maybe_unused]] Vector<Real, d> before;
        for (int a = 0; a < d; ++a) {
            momentum[a] = sum(Sums::momentum + a);
            if constexpr (Effects::changes_impulse) before[a] = momentum[a];
            if constexpr (Transfer::keeps_old_velocity) {
                set(Values::old_velocity + a,
                    ExtendsVelocities<Transfer> ? withheld(a) : momentum[a] * inverse_mass);
                momentum[a] += sum(Sums::impulse + a);
            }
        }
        NodesOfStep<Real> const nodes{mass, filled, select(filled & received, mass, Real(0)), now->forces,
                                      mass_unit};
        apply_on_momentum<Real, d>(now->actions, place, nodes, momentum);
        if constexpr (Effects::loads_surfaces)
            apply_on_surfaces<Real, d>(now->actions, nodes, make_vector<Real, d>([&](int a) {
                                           return sum(Sums::template channel<NodeArea> + a);
                                       }),
                                       momentum);
        if constexpr (Effects::accelerates_marked)
            apply_on_marked<Real, d>(
                now->actions, place, nodes,
                [&](auto tag) { return sum(Sums::template channel<NodeMark<decltype(tag)>>); }, momentum);
        if constexpr (Effects::changes_impulse) apply_on_impulse<Real, d>(now->actions, before, momentum);
        return {nodes, inverse_mass, momentum * inverse_mass};
    }

    /// Obstacles act, and the node has its values for the gather.
    template <class Real, class Sum, class Set>
    FIRN_HOST_DEVICE void finish_node(LanePosition<Real, d> const& place, Free<Real> const& node,
                                      Vector<Real, d> velocity, Sum const& sum, Set const& set,
                                      Result& reactions) const
    {
        if constexpr (Effects::touches_marked)
            velocity =
                apply_on_nodes<Real, d>(now->actions, place, node.nodes, velocity, reactions, [&](auto tag) {
                    return sum(Sums::template channel<NodeMark<decltype(tag)>>) * node.inverse_mass;
                });
        else
            velocity = apply_on_nodes<Real, d>(now->actions, place, node.nodes, velocity, reactions);
        for (int a = 0; a < d; ++a)
            set(Values::velocity + a, select(node.nodes.filled, velocity[a], Real(0)));
        if constexpr (Carried::any) update_carried<Real>(sum, node.nodes.filled, node.inverse_mass, set);
    }

    template <class Real, class Sum, class Set>
    FIRN_HOST_DEVICE void update_carried(Sum const& sum, Mask<Real> const& filled, Real inverse_mass,
                                         Set const& set) const
    {
        using Summed = FieldsOfTerms<typename Carried::ScatteredTerms>;
        using Held = typename Carried::NodeFields;
        Record<Real, d, Summed> sums;
        for_each_field(Summed{}, [&](auto tag) {
            using Tag = decltype(tag);
            for_each_component<Tag, d>(
                sums[tag], [&](int c, Real& value) { value = sum(Sums::template channel<Tag> + c); });
        });
        Record<Real, d, Held> held;
        static_cast<Carried const&>(*this).template update<Real, d>(sums, inverse_mass, Real(now->dt), held);
        for_each_component_of<Held, d>(held, [&](int c, Real const& value) {
            set(Values::carried + c, select(filled, value, Real(0)));
        });
        for (int c = Values::fields; c < channels; ++c) set(c, Real(0));
    }

    /// Books the impulse that walls receive along their axes: what particles lose to their images.
    ///
    /// On the wall that is all momentum. Behind it, where particles scattered p and gather m times the
    /// velocity -v of their image, p + m v is lost. In front of it the same is lost again, where their images
    /// scattered -p and gather m v of the particles' momentum. Where particles keep a share of their own
    /// velocities, that share of these terms, with the old velocity, is not lost.
    template <class Mirrored, class Real>
    FIRN_HOST_DEVICE void book_walls(Mirrored const& mirrored, Real const* velocity,
                                     Vector<Real, d> const& arm, Mask<Real> const& which,
                                     Result& reactions) const
    {
        Real const two(2), blend(flip_fraction);
        for (std::size_t w = 0; w < mirrored.walls.size(); ++w) {
            WallPlane const& wall = mirrored.walls[w];
            int const a = wall.axis;
            Real const m = mirrored.mass_behind[w], p = mirrored.momentum_behind[w],
                       v = velocity[Values::velocity + a];
            Real on = mirrored.sums[Sums::mass] * v, beside = two * (p + m * v);
            if constexpr (Transfer::keeps_old_velocity) {
                on -= blend * mirrored.sums[Sums::momentum + a];
                beside +=
                    two * (mirrored.impulse_behind[w] - blend * (p + m * velocity[Values::old_velocity + a]));
            }
            Real const received = select(which, select(mirrored.on[w], on, beside), Real(0));
            // most lanes contribute nothing: for a wall across the lanes all but two
            std::uint64_t const giving = bits(!exactly_equal(received, Real(0)));
            if (giving != 0) book(reactions.of[std::size_t(wall.obstacle)], a, received, arm, giving);
        }
    }

private:
    /// Books the impulse of some lanes of nodes along an axis, and its moment about the world's origin.
    template <class Real>
    FIRN_HOST_DEVICE static void book(Reaction& reaction, int axis, Real const& given,
                                      Vector<Real, d> const& arm, std::uint64_t lanes)
    {
        constexpr int width = lane_width<Real>;
        Number impulse[std::size_t(width)], at[std::size_t(d)][std::size_t(width)];
        LaneTraits<Real>::store(given, impulse);
        for (int i = 0; i < d; ++i) LaneTraits<Real>::store(arm[i], at[i]);
        double sum = 0;
        Eigen::Vector3d moment(0, 0, 0);
        for_each_lane<width>(lanes, [&](int lane) {
            sum += impulse[lane];
            for (int i = 0; i < d; ++i) moment[i] += double(at[i][lane]) * impulse[lane];
        });
        // moment x unit vector of the axis. It is written out because nvcc 13 miscompiles a vector of zeros
        // whose component `axis` is set to 1.
        for (int i = 0; i < 3; ++i) {
            if (i == axis) reaction.impulse[i] += sum;
            if ((i + 2) % 3 == axis) reaction.angular_impulse[i] += moment[(i + 1) % 3];
            if ((i + 1) % 3 == axis) reaction.angular_impulse[i] -= moment[(i + 2) % 3];
        }
    }
};

} // namespace firn
