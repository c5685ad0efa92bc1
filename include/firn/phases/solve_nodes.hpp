// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/phases/scatter_stress.hpp>
#include <firn/phases/solve_phase.hpp>
#include <firn/phases/solve_search.hpp>

// The phases of nodes in which an implicit step finds its residual and searches: see solve_phase.hpp.
namespace firn
{

/// On nodes that have the sums of TryVelocities: the residual of the velocities that were tried, as the right
/// side of the next linear system, and the diagonal by which that is preconditioned: the mass, and as much as
/// stress along one axis resists.
///
/// Sums: first |r|^2 / m, second r times the change that was tried, third m
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
        else
            r -= Phase::vector(node, Own::offset); // friction, along motion that is free
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
        if (any(stiffness < Real(0))) ++result.inverted;
    }
};

/// On any nodes: what was tried is accepted, and the search begins anew along the preconditioned residual.
template <class Space, class Kernel, class Transfer>
struct AcceptVelocities : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Values;
    using Result = NothingFound;
    static constexpr bool asks_no_sums = true;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, NothingFound&) const
    {
        using Real = typename Node::Real;
        Vector<Real, d> const r = Phase::vector(node, Own::residual);
        Phase::template precondition<Real>(node, r);
        Phase::set(node, Own::solution, Phase::vector(node, Values::velocity));
        Phase::set(node, Values::velocity, zeros<Vector<Real, d>>());
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
    using Sums = StressSums<d>;
    static constexpr bool takes_zero_sums = true; // where nothing is deformed a direction has mass

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
        Vector<Real, d> q = make_vector<Real, d>([&](int a) { return node.sum(Sums::impulse + a); });
        if (!at_rest) q += p * node.value(Own::mass);
        return Phase::projected(node, q);
    }
};

/// On the same nodes: goes on along the direction, by a step of conjugate gradients.
template <class Space, class Kernel, class Transfer>
struct AdvanceSearch : FindCurvature<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Values;
    using Result = NothingFound;

    SearchState const* search;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, NothingFound&) const
    {
        using Real = typename Node::Real;
        if (search->has_ended) return;
        Real const along(static_cast<ScalarOf<Real>>(search->along));
        Vector<Real, d> const p = Phase::vector(node, Values::velocity);
        Phase::set(node, Own::change, Vector<Real, d>(Phase::vector(node, Own::change) + p * along));
        Vector<Real, d> const r = Phase::vector(node, Own::residual) - this->times(node, p) * along;
        Phase::set(node, Own::residual, r);
        Phase::template precondition<Real>(node, r);
    }
};

/// On any nodes: what coarse grids have added to the preconditioned residual z leaves what is held as it is.
///
/// Sums: first r z.
template <class Space, class Kernel, class Transfer>
struct ProjectConditioned : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Result;
    static constexpr bool asks_no_sums = true;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Vector<Real, d> const z = Phase::projected(node, Phase::vector(node, Own::conditioned));
        Phase::set(node, Own::conditioned, z);
        Result::add(result.first, select(counted(node) & (node.value(Own::mass) > Real(0)),
                                         dot<Real, d>(Phase::vector(node, Own::residual), z), Real(0)));
    }
};

/// On any nodes: the next direction, z and a share of the one before.
template <class Space, class Kernel, class Transfer>
struct TurnSearch : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Values;
    using Result = NothingFound;
    static constexpr bool asks_no_sums = true;

    SearchState const* search;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, NothingFound&) const
    {
        using Real = typename Node::Real;
        if (search->has_ended) return;
        Real const share(static_cast<ScalarOf<Real>>(search->share));
        for (int a = 0; a < d; ++a)
            node.set(Values::velocity + a,
                     node.value(Own::conditioned + a) + node.value(Values::velocity + a) * share);
    }
};

/// On any nodes: velocities to try, the solution and a share of the change that the linear system found.
template <class Space, class Kernel, class Transfer>
struct ChooseVelocities : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Number, typename Phase::Own, typename Phase::Values;
    using Result = NothingFound;
    static constexpr bool asks_no_sums = true;

    Number share;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, NothingFound&) const
    {
        using Real = typename Node::Real;
        Phase::set(node, Values::velocity,
                   Vector<Real, d>(Phase::vector(node, Own::solution) +
                                   Phase::vector(node, Own::change) * Real(share)));
    }
};

} // namespace firn
