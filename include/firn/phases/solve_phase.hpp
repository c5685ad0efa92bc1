// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/core/components.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/lane.hpp>
#include <firn/math/product.hpp>
#include <firn/phases/mirrored_node.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/transfer/integrators.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// What nodes do while an implicit step is solved: the residual of their velocities v,
//
//   r_i = P_i (m_i (v_i - v*_i) + dt sum V0 P F_n^T grad w_i - f_i)
//
// and conjugate gradients for the systems H dv = -r. v* is the velocity without stress, and P the projection
// to motion that no obstacle prescribes, and f friction as it was found last. At rest, in Solver::settle, m
// (v - v*) is the impulse of outside forces alone, with the opposite sign. Sums are in double precision, and
// in one order.
namespace firn
{

/// Adds the numbers of a lane to a sum, one after the other.
template <Lane Real>
FIRN_HOST_DEVICE inline void add_lanes(double& sum, Real const& lane)
{
    ScalarOf<Real> numbers[std::size_t(lane_width<Real>)];
    LaneTraits<Real>::store(lane, numbers);
    for (int i = 0; i < lane_width<Real>; ++i) sum += double(numbers[i]);
}

/// What a loop over nodes adds up in an iteration of a search.
struct SearchSum
{
    double sum = 0;
    FIRN_HOST_DEVICE void merge(SearchSum const& other) { sum += other.sum; }
    /// See Reactions.
    FIRN_HOST_DEVICE bool has_a_place() const { return !exactly_equal(sum, 0.0); }
};

/// What a loop over nodes adds up while a step is solved.
template <int d>
struct SolveSums
{
    double first = 0, second = 0, third = 0;        ///< each phase says what these are
    double most = 0;                                ///< the largest of what the phase looks for
    Coordinates<d> where = zeros<Coordinates<d>>(); ///< the node that has it
    double stiffest = 0;                            ///< the largest stiffness of a node over its mass
    std::uint64_t inverted = 0;                     ///< nodes of which a particle is turned inside out
    std::uint64_t held = 0;                         ///< nodes of which obstacles prescribe a part
    std::uint64_t refused = 0;  ///< nodes on which effects act neither by a projection nor as contact
    std::uint64_t touching = 0; ///< nodes of which obstacles may let go, or rub

    FIRN_HOST_DEVICE void merge(SolveSums const& other)
    {
        first += other.first, second += other.second, third += other.third;
        if (other.most > most) most = other.most, where = other.where;
        stiffest = max(stiffest, other.stiffest);
        inverted += other.inverted, held += other.held, refused += other.refused, touching += other.touching;
    }

    /// See Reactions.
    FIRN_HOST_DEVICE bool has_a_place() const
    {
        return !exactly_equal(first, 0.0) || !exactly_equal(second, 0.0) || !exactly_equal(third, 0.0) ||
               !exactly_equal(most, 0.0);
    }

    /// Looks for the largest number, of nodes that lie one after another from `first` on.
    template <Lane Real>
    FIRN_HOST_DEVICE void look(Real const& lane, Coordinates<d> const& from, Real const& along)
    {
        if (!(double(largest(lane)) > most)) return;
        ScalarOf<Real> numbers[std::size_t(lane_width<Real>)], way[std::size_t(lane_width<Real>)];
        LaneTraits<Real>::store(lane, numbers);
        LaneTraits<Real>::store(along, way);
        for (int i = 0; i < lane_width<Real>; ++i)
            if (double(numbers[i]) > most) {
                most = double(numbers[i]);
                where = from;
                where[d - 1] += static_cast<int>(way[i]);
            }
    }
};

/// The channels of nodes, and what its phases have in common.
template <class Space, class Kernel, class TransferType>
struct SolvePhase
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Transfer = TransferType;
    using Values = NodeValues<d, ValuesOf<Transfer>>;
    using Own = SolveValues<d, ValuesOf<Transfer>, Values::template channels<Kernel>>;
    /// What the passes to particles and back sum: StressPass.
    using Sums = NodeSums<d, Fields<NodeMass, NodeMomentum>>;
    using Result = SolveSums<d>;
    static constexpr bool looks_around = false, keeps_values = true;

    template <class Node>
    FIRN_HOST_DEVICE static Vector<typename Node::Real, d> vector(Node const& node, int channel)
    {
        return make_vector<typename Node::Real, d>([&](int a) { return node.value(channel + a); });
    }
    template <class Node>
    FIRN_HOST_DEVICE static void set(Node& node, int channel, Vector<typename Node::Real, d> const& value)
    {
        for (int a = 0; a < d; ++a) node.set(channel + a, value[a]);
    }
    template <class Node>
    FIRN_HOST_DEVICE static Vector<typename Node::Real, d> impulse(Node const& node)
    {
        return make_vector<typename Node::Real, d>([&](int a) { return node.sum(Sums::momentum + a); });
    }
    /// The part of a vector along which the node is free.
    template <class Node>
    FIRN_HOST_DEVICE static Vector<typename Node::Real, d>
    projected(Node const& node, Vector<typename Node::Real, d> const& value)
    {
        using Real = typename Node::Real;
        return make_vector<Real, d>([&](int i) {
            return sum_of<Real, d>([&](int j) { return node.value(Own::free_at(i, j)) * value[j]; });
        });
    }
    /// One over a positive number; 0 of others.
    template <Lane Real>
    FIRN_HOST_DEVICE static Real inverse_of(Real const& value)
    {
        Mask<Real> const positive = value > Real(0);
        return select(positive, Real(1) / select(positive, value, Real(1)), Real(0));
    }
    /// Preconditions a residual by the node's own stiffness, before coarse grids add to it; adds r z of nodes
    /// that have mass.
    template <Lane Real, class Node>
    FIRN_HOST_DEVICE static void precondition(Node& node, Vector<Real, d> const& r, SearchSum& result);
};

/// Lanes of nodes beside reflecting walls, or of their images, as a phase of the solve sees them: with the
/// sums of both, and with vectors as in front of the walls. Images hold the same values, mirrored.
template <class Own, class Node, class Mirrored, int d>
class NodesBesideWalls
{
public:
    using Real = typename Node::Real;

    FIRN_HOST_DEVICE NodesBesideWalls(Node& node, Mirrored const& mirrored) : node_(node), mirrored_(mirrored)
    {}

    FIRN_HOST_DEVICE Coordinates<d> first() const { return mirrored_.first; }
    FIRN_HOST_DEVICE Vector<Real, d> offset() const
    {
        Vector<Real, d> steps = zeros<Vector<Real, d>>();
        steps[d - 1] = mirrored_.along;
        return steps;
    }
    FIRN_HOST_DEVICE Real sum(int c) const { return mirrored_.sums[c]; }
    FIRN_HOST_DEVICE Real value(int c) const { return turned(c, node_.value(c)); }
    FIRN_HOST_DEVICE void set(int c, Real const& value) { node_.set(c, turned(c, value)); }
    /// Which lanes count in sums over all nodes: images are not nodes of their own.
    FIRN_HOST_DEVICE Mask<Real> counts() const { return !mirrored_.is_image(); }
    FIRN_HOST_DEVICE Mask<Real> on_wall(int axis) const { return mirrored_.on_wall(axis); }
    /// The part of the impulse that lies behind the wall across an axis on one side of the material, along
    /// the axis.
    FIRN_HOST_DEVICE Real behind(int axis, int side) const
    {
        Real sum(0);
        for (std::size_t w = 0; w < mirrored_.walls.size(); ++w)
            if (mirrored_.walls[w].axis == axis && mirrored_.walls[w].side == side)
                sum += mirrored_.momentum_behind[w];
        return sum;
    }

private:
    /// The value of a channel in front of the wall, or behind it.
    FIRN_HOST_DEVICE Real turned(int c, Real const& value) const
    {
        Real now = value;
        for (int a = 0; a < d; ++a)
            if (Own::turns(c, a)) now = select(mirrored_.flipped[std::size_t(a)], -now, now);
        return now;
    }

    Node& node_;
    Mirrored const& mirrored_;
};

/// Lanes of nodes of which images behind reflecting walls do not count in sums over all nodes, for a phase
/// that asks for no sums of particles: what images hold is mirrored already.
template <class Node>
class NodesOrUncounted
{
public:
    using Real = typename Node::Real;

    FIRN_HOST_DEVICE NodesOrUncounted(Node& node, Mask<Real> const& is_image)
        : node_(node), is_image_(is_image)
    {}

    FIRN_HOST_DEVICE Real value(int c) const { return node_.value(c); }
    FIRN_HOST_DEVICE void set(int c, Real const& value) { node_.set(c, value); }
    FIRN_HOST_DEVICE Mask<Real> counts() const { return !is_image_; }

private:
    Node& node_;
    Mask<Real> is_image_;
};

/// A phase of the solve that sees reflecting walls, if there are any.
template <class Phase, class Effects>
struct BesideWalls : Phase
{
    using Phase::d;
    using typename Phase::Number, typename Phase::Result, typename Phase::Sums;
    static constexpr bool looks_around = Effects::walls > 0, lists_images = true;
    using Walls = std::array<WallPlane, Effects::walls>;

    StepContext<Number, Effects> const* of_step;

    FIRN_HOST_DEVICE Walls walls() const { return walls_of(of_step->actions); }
    FIRN_HOST_DEVICE static bool looks_around_at(Walls const& walls, Coordinates<d> const& first, int count)
    {
        return is_beside<d>(walls, first, count);
    }
    template <class Node>
    static Mask<typename Node::Real> list_images(Walls const& walls, Node const& node)
    {
        return firn::list_images<d, Sums>(walls, node);
    }
    template <class Node>
    FIRN_HOST_DEVICE void look_around(Walls const& walls, Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        if constexpr (AsksNoSums<Phase> && HasListedImages<Node>) {
            NodesOrUncounted<Node> nodes(node, node.are_images());
            (*this)(nodes, result);
        }
        else if constexpr (AsksNoSums<Phase>) {
            NodesOrUncounted<Node> nodes(node,
                                         NodesOrImages<Real, d, Effects::walls>(walls, node).is_image());
            (*this)(nodes, result);
        }
        else {
            using Mirrored = MirroredNode<Sums, Real, d, Effects::walls>;
            Mirrored const mirrored(walls, node);
            NodesBesideWalls<typename Phase::Own, Node, Mirrored, d> both(node, mirrored);
            (*this)(both, result);
        }
    }
};

/// Which lanes of nodes count in sums over all nodes.
template <class Node>
FIRN_HOST_DEVICE Mask<typename Node::Real> counted([[maybe_unused]] Node const& node)
{
    using Real = typename Node::Real;
    if constexpr (requires { node.counts(); })
        return node.counts();
    else
        return Real(0) <= Real(0);
}

template <class Space, class Kernel, class TransferType>
template <Lane Real, class Node>
FIRN_HOST_DEVICE void
SolvePhase<Space, Kernel, TransferType>::precondition(Node& node, Vector<Real, d> const& r, SearchSum& result)
{
    Vector<Real, d> const z = r * inverse_of(node.value(Own::stiffness));
    set(node, Own::conditioned, z);
    Mask<Real> const counts = counted(node) & (node.value(Own::mass) > Real(0));
    add_lanes(result.sum, select(counts, dot<Real, d>(r, z), Real(0)));
}

} // namespace firn
