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
        add_lanes(result.third, select(counts, mass * dot<Real, d>(v, v), Real(0)));
        Vector<Real, d> r = Phase::projected(node, Vector<Real, d>(of_mass * mass + impulse));
        r -= Phase::vector(node, Own::friction); // friction, along motion that is free
        Phase::set(node, Own::residual, Vector<Real, d>(-r));
        Real const resists = stiffness * Real(stiffening);
        result.stiffest = max(result.stiffest, double(largest(resists * inverse_mass)));
        Real const weight = (at_rest ? Real(0) : mass) + resists;
        // where nothing resists a node has little to do with the rest: its mass stands for that
        Real const diagonal = select(weight > Real(0), weight, mass);
        node.set(Own::stiffness, diagonal);
        Mask<Real> const has_mass = counts & (mass > Real(0));
        Real const r2 = select(has_mass, dot<Real, d>(r, r) * inverse_mass, Real(0));
        add_lanes(result.first, r2);
        add_lanes(result.second,
                  select(has_mass, dot<Real, d>(r, Phase::vector(node, Own::change)), Real(0)));
        result.look(r2 * inverse_mass, node.first(), node.offset()[d - 1]);
        if (any(stiffness < Real(0))) ++result.inverted;
    }
};

/// On any nodes: what was tried is accepted, and the search begins anew along the preconditioned residual z.
///
/// Adds up r z, without what coarse grids will add.
template <class Space, class Kernel, class Transfer>
struct AcceptVelocities : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Values;
    using Result = SearchSum;
    static constexpr bool asks_no_sums = true;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Phase::template precondition<Real>(node, Phase::vector(node, Own::residual), result);
        Phase::set(node, Own::solution, Phase::vector(node, Values::velocity));
        Phase::set(node, Values::velocity, zeros<Vector<Real, d>>());
        Phase::set(node, Own::change, zeros<Vector<Real, d>>());
    }
};

/// On nodes that have the sums of ProductOfStress: q = H p of the direction p, in place of the impulse of
/// stress, which the next residual finds anew.
///
/// Adds up p q.
template <class Space, class Kernel, class Transfer>
struct FindCurvature : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Values;
    using Result = SearchSum;
    using Sums = StressSums<d>;
    static constexpr bool takes_zero_sums = true; // where nothing is deformed a direction has mass

    bool at_rest;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        Vector<Real, d> const p = Phase::vector(node, Values::velocity);
        Vector<Real, d> q = make_vector<Real, d>([&](int a) { return node.sum(Sums::impulse + a); });
        if (!at_rest) q += p * node.value(Own::mass);
        q = Phase::projected(node, q);
        Phase::set(node, Own::impulse, q);
        add_lanes(result.sum, select(counted(node), dot<Real, d>(p, q), Real(0)));
    }
};

/// On any nodes: goes on along the direction, by a step of conjugate gradients.
///
/// Adds up r z of the residual that is left, without what coarse grids will add.
template <class Space, class Kernel, class Transfer>
struct AdvanceSearch : SolvePhase<Space, Kernel, Transfer>
{
    using Phase = SolvePhase<Space, Kernel, Transfer>;
    using Phase::d;
    using typename Phase::Own, typename Phase::Values;
    using Result = SearchSum;
    static constexpr bool asks_no_sums = true;

    SearchState const* search;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        if (search->has_ended) return;
        Real const along(static_cast<ScalarOf<Real>>(search->along));
        Vector<Real, d> const p = Phase::vector(node, Values::velocity),
                              q = Phase::vector(node, Own::impulse),
                              r = Phase::vector(node, Own::residual) - q * along;
        Phase::set(node, Own::change, Vector<Real, d>(Phase::vector(node, Own::change) + p * along));
        Phase::set(node, Own::residual, r);
        Phase::template precondition<Real>(node, r, result);
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
