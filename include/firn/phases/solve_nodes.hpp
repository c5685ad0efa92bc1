// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/phases/mirrored_node.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/phases/update_grid.hpp>
#include <firn/transfer/integrators.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// What nodes do while an implicit step is solved: the residual of their velocities v,
//
//   r_i = P_i (m_i (v_i - v*_i) + dt sum V0 P F_n^T grad w_i)
//
// and conjugate gradients for the systems H dv = -r. v* is the velocity without stress, and P the projection
// to motion that no obstacle prescribes. At rest, in Solver::settle, m (v - v*) is the impulse of outside
// forces alone, with the opposite sign. Sums are in double precision, and in one order.
namespace firn
{

/// What a loop over nodes adds up while a step is solved.
template <int d>
struct SolveSums
{
    double along_z = 0;                             ///< a residual times the same, preconditioned
    double first = 0, second = 0, third = 0;        ///< each phase says what these are
    double most = 0;                                ///< the largest of what the phase looks for
    Coordinates<d> where = zeros<Coordinates<d>>(); ///< the node that has it
    double stiffest = 0;                            ///< the largest stiffness of a node over its mass
    std::uint64_t inverted = 0;                     ///< nodes of which a particle is turned inside out
    std::uint64_t held = 0;                         ///< nodes of which obstacles prescribe a part
    std::uint64_t refused = 0;                      ///< nodes on which effects act by more than a projection

    FIRN_HOST_DEVICE void merge(SolveSums const& other)
    {
        first += other.first, second += other.second, third += other.third;
        along_z += other.along_z;
        if (other.most > most) most = other.most, where = other.where;
        stiffest = max(stiffest, other.stiffest);
        inverted += other.inverted, held += other.held, refused += other.refused;
    }

    /// Adds the numbers of a lane to a sum, one after the other.
    template <Lane Real>
    FIRN_HOST_DEVICE static void add(double& sum, Real const& lane)
    {
        ScalarOf<Real> numbers[std::size_t(lane_width<Real>)];
        LaneTraits<Real>::store(lane, numbers);
        for (int i = 0; i < lane_width<Real>; ++i) sum += double(numbers[i]);
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
    static constexpr bool looks_around = false;

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

/// A phase of the solve that sees reflecting walls, if there are any.
template <class Phase, class Effects>
struct BesideWalls : Phase
{
    using Phase::d;
    using typename Phase::Number, typename Phase::Result, typename Phase::Sums;
    static constexpr bool looks_around = Effects::walls > 0;
    using Walls = std::array<WallPlane, Effects::walls>;

    StepContext<Number, Effects> const* of_step;

    FIRN_HOST_DEVICE Walls walls() const { return walls_of(of_step->actions); }
    FIRN_HOST_DEVICE static bool looks_around_at(Walls const& walls, Coordinates<d> const& first, int count)
    {
        return is_beside<d>(walls, first, count);
    }
    template <class Node>
    FIRN_HOST_DEVICE void look_around(Walls const& walls, Node& node, Result& result) const
    {
        using Mirrored = MirroredNode<Sums, typename Node::Real, d, Effects::walls>;
        Mirrored const mirrored(walls, node);
        NodesBesideWalls<typename Phase::Own, Node, Mirrored, d> both(node, mirrored);
        (*this)(both, result);
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

/// On nodes that have mass and momentum: what the solve starts from. Forces act as in UpdateGrid, and what
/// obstacles do is found by asking them about motion along each axis: `c(v) = P v + (I - P) w` for a
/// projection P to motion that is free. Nodes where it is not so are counted as refused.
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
        auto free = this->template free_node<Real>(
            place, sum, [](int) { return Real(0); }, [](int, Real const&) {}, Real(1) < Real(0));
        Mask<Real> const filled = free.nodes.filled;
        Real const mass = select(filled, free.nodes.mass, Real(0));
        auto const touched = [&](Vector<Real, d> const& v) { return touch<Real>(place, free, sum, v); };

        Mask<Real> const counts = counted(node);
        Vector<Real, d> still = touched(zeros<Vector<Real, d>>());
        Matrix<Real, d> P;
        Real bent(0);
        for (int a = 0; a < d; ++a) {
            Vector<Real, d> along = zeros<Vector<Real, d>>();
            along[a] = Real(1);
            Vector<Real, d> const forth = touched(along) - still;
            along[a] = Real(-1);
            Vector<Real, d> const back = touched(along) - still;
            for (int i = 0; i < d; ++i) {
                P(i, a) = forth[i];
                bent = max(bent, abs(forth[i] + back[i]));
            }
        }
        if constexpr (requires { node.on_wall(0); })
            for (int a = 0; a < d; ++a) {
                Mask<Real> const on = node.on_wall(a);
                still[a] = select(on, Real(0), still[a]);
                for (int b = 0; b < d; ++b) {
                    P(a, b) = select(on, Real(0), P(a, b));
                    P(b, a) = select(on, Real(0), P(b, a));
                }
            }
        Matrix<Real, d> const twice = product<Real, d>(P, P);
        Real share_held(0);
        for (int i = 0; i < d; ++i) {
            share_held += Real(1) - P(i, i);
            for (int j = 0; j < d; ++j)
                bent = max(bent, max(abs(twice(i, j) - P(i, j)), abs(P(i, j) - P(j, i))));
        }
        auto const count = [](Mask<Real> const& lanes) {
            return static_cast<std::uint64_t>(popcount(bits(lanes)));
        };
        Real const rounding(Number(1e-3));
        Mask<Real> refused = filled & (bent > rounding);
        if (at_rest)
            for (int a = 0; a < d; ++a) refused = refused | (filled & (abs(still[a]) > Real(0)));
        result.refused += count(refused & counts);
        result.held += count(filled & counts & (share_held > Real(Number(0.5))));
        result.look(select(refused, Real(1), Real(0)), node.first(), node.offset()[d - 1]);

        auto const old =
            make_vector<Real, d>([&](int a) { return sum(Sums::momentum + a) * free.inverse_mass; });
        Vector<Real, d> const target = old + (free.velocity - old) * Real(part_of_step);
        Vector<Real, d> begin = at_rest ? zeros<Vector<Real, d>>() : touched(target);
        if constexpr (requires { node.on_wall(0); })
            for (int a = 0; a < d; ++a) begin[a] = select(node.on_wall(a), Real(0), begin[a]);
        Vector<Real, d> const of_begin = product<Real, d>(P, begin); // what is free in it
        Real pushed(0), speed2(0);
        for (int a = 0; a < d; ++a) {
            Real const start = select(filled, begin[a], Real(0)), change = target[a] - old[a];
            pushed += change * change;
            speed2 += target[a] * target[a];
            node.set(Own::target + a, select(filled, target[a], Real(0)));
            node.set(Own::solution + a, start);
            node.set(Values::velocity + a, start);
            node.set(Own::change + a, select(filled, of_begin[a], Real(0)));
            node.set(Own::offset + a, Real(0));
            for (int b = 0; b <= a; ++b) node.set(Own::free_at(a, b), select(filled, P(a, b), Real(0)));
        }
        node.set(Own::mass, mass);
        Result::add(result.first, select(counts, mass, Real(0)));
        Result::add(result.second, select(filled & counts, mass * pushed, Real(0)));
        Result::add(result.third, select(filled & counts, mass * speed2, Real(0)));
    }

private:
    FIRN_HOST_DEVICE static int popcount(std::uint64_t lanes)
    {
        int count = 0;
        for (; lanes != 0; lanes &= lanes - 1) ++count;
        return count;
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

/// On nodes that have the sums of TryVelocities: the residual of the velocities that were tried, as the right
/// side of the next linear system, and the diagonal by which that is preconditioned: the mass, and as much as
/// stress along one axis resists.
///
/// Sums: r z with the preconditioned z, first |r|^2 / m, second r times the change that was tried, third m
/// |v|^2; largest: |r|^2 / m^2.
template <class Space, class Kernel, class Transfer>
struct FindResidual : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Number, typename Phase::Own, typename Phase::Sums, typename Phase::Result;

    bool at_rest;
    bool is_first;     ///< its residual is the offset of loads that follow
    Number left_out;   ///< the share of that offset that is left for later
    Number stiffening; ///< of the diagonal, for a wave modulus times V0 [s^2 / m^2]

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Mask<Real> const counts = counted(node);
        Real const mass = node.value(Own::mass), inverse_mass = Phase::inverse_of(mass),
                   stiffness = node.sum(Sums::mass);
        Vector<Real, d> const impulse = Phase::impulse(node), target = Phase::vector(node, Own::target);
        Phase::set(node, Own::impulse, impulse);
        if constexpr (requires { node.behind(0, 1); })
            for (int a = 0; a < d; ++a)
                for (int const side : {-1, 1}) node.set(Own::behind_at(a, side), node.behind(a, side));
        Vector<Real, d> of_mass = -target;
        Vector<Real, d> const v = Phase::vector(node, Phase::Values::velocity);
        if (!at_rest) of_mass += v;
        Result::add(result.third, select(counts, mass * dot<Real, d>(v, v), Real(0)));
        Vector<Real, d> r = Phase::projected(node, Vector<Real, d>(of_mass * mass + impulse));
        if (at_rest) {
            if (is_first) Phase::set(node, Own::offset, r);
            r -= Phase::vector(node, Own::offset) * Real(left_out);
        }
        Phase::set(node, Own::residual, Vector<Real, d>(-r));
        Real const resists = stiffness * Real(stiffening);
        result.stiffest = max(result.stiffest, double(largest(resists * inverse_mass)));
        Real const weight = (at_rest ? Real(0) : mass) + resists;
        // where nothing resists a node has little to do with the rest: its mass stands for that
        Real const diagonal = select(weight > Real(0), weight, mass);
        node.set(Own::stiffness, diagonal);
        Mask<Real> const has_mass = counts & (mass > Real(0));
        Real const r2 = select(has_mass, dot<Real, d>(r, r) * inverse_mass, Real(0));
        Result::add(result.first, r2);
        Result::add(result.second,
                    select(has_mass, dot<Real, d>(r, Phase::vector(node, Own::change)), Real(0)));
        result.look(r2 * inverse_mass, node.first(), node.offset()[d - 1]);
        Result::add(result.along_z,
                    select(has_mass, dot<Real, d>(r, r) * Phase::inverse_of(diagonal), Real(0)));
        if (any(stiffness < Real(0))) ++result.inverted;
    }
};

/// On any nodes: what was tried is accepted, and the search begins anew along the preconditioned residual.
template <class Space, class Kernel, class Transfer>
struct AcceptVelocities : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Result, typename Phase::Values;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        Vector<Real, d> const r = Phase::vector(node, Own::residual);
        Vector<Real, d> const z = r * Phase::inverse_of(node.value(Own::stiffness));
        Phase::set(node, Own::solution, Phase::vector(node, Values::velocity));
        Phase::set(node, Values::velocity, z);
        Phase::set(node, Own::change, zeros<Vector<Real, d>>());
    }
};

/// On nodes that have the sums of ProductOfStress: p H p of the direction p.
///
/// Sums: first p H p.
template <class Space, class Kernel, class Transfer>
struct FindCurvature : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Result, typename Phase::Values;

    bool at_rest;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Vector<Real, d> const p = Phase::vector(node, Values::velocity);
        Result::add(result.first, select(counted(node), dot<Real, d>(p, times(node, p)), Real(0)));
    }

    /// H p, of the direction p.
    template <class Node, class Real = typename Node::Real>
    FIRN_HOST_DEVICE Vector<Real, d> times(Node const& node, Vector<Real, d> const& p) const
    {
        Vector<Real, d> q = Phase::impulse(node);
        if (!at_rest) q += p * node.value(Own::mass);
        return Phase::projected(node, q);
    }
};

/// On the same nodes: goes on along the direction, by a step of conjugate gradients.
///
/// Sums: r z.
template <class Space, class Kernel, class Transfer>
struct AdvanceSearch : FindCurvature<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Number, typename Phase::Own, typename Phase::Result, typename Phase::Values;

    Number along;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Vector<Real, d> const p = Phase::vector(node, Values::velocity);
        Phase::set(node, Own::change, Vector<Real, d>(Phase::vector(node, Own::change) + p * Real(along)));
        Vector<Real, d> const r = Phase::vector(node, Own::residual) - this->times(node, p) * Real(along);
        Phase::set(node, Own::residual, r);
        Result::add(result.along_z,
                    select(counted(node), dot<Real, d>(r, r) * Phase::inverse_of(node.value(Own::stiffness)),
                           Real(0)));
    }
};

/// On any nodes: the next direction, z and a share of the one before.
template <class Space, class Kernel, class Transfer>
struct TurnSearch : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Number, typename Phase::Own, typename Phase::Result, typename Phase::Values;

    Number share;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        Real const inverse = Phase::inverse_of(node.value(Own::stiffness));
        for (int a = 0; a < d; ++a)
            node.set(Values::velocity + a, node.value(Own::residual + a) * inverse +
                                               node.value(Values::velocity + a) * Real(share));
    }
};

/// On any nodes: velocities to try, the solution and a share of the change that the linear system found.
template <class Space, class Kernel, class Transfer>
struct ChooseVelocities : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Number, typename Phase::Own, typename Phase::Result, typename Phase::Values;

    Number share;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        Phase::set(node, Values::velocity,
                   Vector<Real, d>(Phase::vector(node, Own::solution) +
                                   Phase::vector(node, Own::change) * Real(share)));
    }
};

/// On nodes that have mass and momentum again: the grid update of the step, with the impulse of stress that
/// was found. Effects act as in UpdateGrid and obstacles receive what they hold back, and then nodes take the
/// solution.
template <class Space, class Kernel, class Transfer, class Effects>
struct ConcludeSolve : UpdateGrid<Space, Kernel, Transfer, Effects>
{
    using Update = UpdateGrid<Space, Kernel, Transfer, Effects>;
    using Own = typename SolvePhase<Space, Kernel, Transfer>::Own;
    using typename Update::Number, typename Update::Sums, typename Update::Values, typename Update::Result;
    using Update::d;

    using typename Update::Walls;

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
            if (c >= Sums::impulse && c < Sums::impulse + d)
                total -= node.value(Own::impulse + c - Sums::impulse) * Real(steps_of_impulse);
            return total;
        };
        auto const set = [&](int c, Real const& value) {
            bool const is_velocity = c >= Values::velocity && c < Values::velocity + d;
            node.set(c, is_velocity ? node.value(Own::solution + c - Values::velocity) : value);
        };
        this->template update<Real>(
            place, sum, [](int) { return Real(0); }, set, Real(0) <= Real(0), reactions);
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
        this->template update<Real>(
            place, [&](int c) { return mirrored.sums[c]; }, [](int) { return Real(0); },
            [&](int c, Real const& value) { values[c] = value; }, received, reactions);
        Real solution[std::size_t(d)];
        for (int a = 0; a < d; ++a) { // nodes on a wall hold what it receives until it is booked
            solution[a] = both.value(Own::solution + a);
            values[Values::velocity + a] = select(both.on_wall(a), values[Values::velocity + a], solution[a]);
        }
        this->book_walls(mirrored, values, place.relative_to({0, 0, 0}), received, reactions);
        for (int a = 0; a < d; ++a) values[Values::velocity + a] = solution[a];
        for (int c = 0; c < Update::channels; ++c) {
            int const a = Values::axis(c);
            both.set(c, a >= 0 ? select(both.on_wall(a), Real(0), values[c]) : values[c]);
        }
    }

private:
    /// Adds the impulse of stress to the sums of nodes and their images.
    template <class Real, class Node, class Mirrored>
    FIRN_HOST_DEVICE void add_stress(Node& node, Mirrored& mirrored) const
    {
        NodesBesideWalls<Own, Node, Mirrored, d> const both(node, mirrored);
        for (int a = 0; a < d; ++a) {
            if (at_rest) mirrored.sums[Sums::momentum + a] = Real(0);
            mirrored.sums[Sums::impulse + a] -= both.value(Own::impulse + a) * Real(steps_of_impulse);
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
