// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/transfer/carrying.hpp>

#include <type_traits>

// Nodes have fields as particles do: tags in lists. What nodes sum from the scatter to the grid update, and
// what they hold from there to the gather, is mass and motion, and what the transfer carries beside them.
namespace firn
{

/// The mass of a node: the sum of w_i m_p, in the scene's unit of mass.
struct NodeMass
{
    static constexpr auto name = "node_mass";
    static constexpr auto shape = FieldShape::scalar;
};

/// The momentum of a node, together with the impulse of the material's forces unless that is apart [m/s,
/// times the unit of mass].
struct NodeMomentum
{
    static constexpr auto name = "node_momentum";
    static constexpr auto shape = FieldShape::vector;
};

/// The impulse of the material's forces during the step [m/s, times the unit of mass].
struct NodeImpulse
{
    static constexpr auto name = "node_impulse";
    static constexpr auto shape = FieldShape::vector;
};

/// The velocity of a node after its update [m/s].
struct NodeVelocity
{
    static constexpr auto name = "node_velocity";
    static constexpr auto shape = FieldShape::vector;
};

/// The velocity of a node before the forces of the step [m/s], or what Xpic stores in its place.
struct NodeOldVelocity
{
    static constexpr auto name = "node_old_velocity";
    static constexpr auto shape = FieldShape::vector;
};

/// The outward area of surfaces that particles scatter to a node, for a Traction to act on [m^2 over the unit
/// of mass]: see LoadedSurfaces.
struct NodeArea
{
    static constexpr auto name = "node_area";
    static constexpr auto shape = FieldShape::vector;
};

/// The mass of a node that a mark is about, in the scene's unit of mass: see Marks.
template <class Tag>
struct NodeMark
{
    static constexpr auto name = "node_mark";
    static constexpr auto shape = FieldShape::scalar;
};

/// The fields that nodes sum for a transfer.
template <class Transfer>
using SumsOf = Join<Fields<NodeMass, NodeMomentum>,
                    std::conditional_t<Transfer::keeps_old_velocity, Fields<NodeImpulse>, Fields<>>,
                    FieldsOfTerms<typename CarriedBy<Transfer>::ScatteredTerms>>;

/// The fields that nodes hold for a transfer.
template <class Transfer>
using ValuesOf = Join<Fields<NodeVelocity>,
                      std::conditional_t<Transfer::keeps_old_velocity, Fields<NodeOldVelocity>, Fields<>>,
                      typename CarriedBy<Transfer>::NodeFields>;

/// A node's channels between the scatter and the grid update. `Set` has mass and momentum, and the forces'
/// impulse if it is apart.
template <int d, class Set>
struct NodeSums
{
    /// Where the components of a field begin.
    template <class Tag>
    static constexpr int channel = Set::template first_component<Tag>(d);
    static constexpr bool forces_are_apart = Set::template contains<NodeImpulse>;
    static constexpr int mass = channel<NodeMass>, momentum = channel<NodeMomentum>;
    static constexpr int impulse =
        channel<std::conditional_t<forces_are_apart, NodeImpulse, NodeMomentum>>; ///< of the forces
    static constexpr int channels = Set::components(d);

    /// The axis of a vector's component; -1 for a scalar.
    FIRN_HOST_DEVICE static constexpr int axis(int c) { return axis_of_component(Set{}, d, c); }
};

/// How many channels of nodes a gather reads at a time: no more than stay in the fastest cache.
template <class Kernel, int d>
inline constexpr int channels_at_once = Kernel::degree <= 2 ? d : 1;

/// A node's channels between its update and the gather. `Set` begins with the velocity, and the old one if
/// the transfer keeps it; what it carries comes behind them.
template <int d, class Set>
struct NodeValues
{
    /// Where the components of a field begin.
    template <class Tag>
    static constexpr int channel = Set::template first_component<Tag>(d);
    static constexpr int velocity = channel<NodeVelocity>;
    static constexpr int old_velocity = velocity + d;
    static constexpr int carried = Set::template contains<NodeOldVelocity> ? 2 * d : d;
    static constexpr int fields = Set::components(d); ///< components of all fields
    /// With those that are always zero, so that the gather reads as many at a time as it does.
    template <class Kernel>
    static constexpr int channels =
        (fields + channels_at_once<Kernel, d> - 1) / channels_at_once<Kernel, d>* channels_at_once<Kernel, d>;

    /// The axis of a vector's component; -1 for a scalar, and for what is always zero.
    FIRN_HOST_DEVICE static constexpr int axis(int c) { return axis_of_component(Set{}, d, c); }
};

} // namespace firn
