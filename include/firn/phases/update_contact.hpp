// SPDX-License-Identifier: MIT
#pragma once

#include <firn/phases/begin_solve.hpp>
#include <firn/phases/solve_contact.hpp>

// What obstacles leave of nodes' motion, found anew while an implicit step is solved: see solve_contact.hpp.
namespace firn
{

/// On nodes of which a velocity was tried: what contact leaves free of them now. Forces drive a node to
/// y = v - r / w with the residual r before anything is held and the node's stiffness w: whatever w is, v =
/// c(y) where the step is solved. Nodes get the velocity that is prescribed, and friction as an impulse.
///
/// Sums: how many nodes touch an obstacle, and how many of these it holds.
template <class Space, class Kernel, class Transfer, class Effects>
struct UpdateContact : BeginSolve<Space, Kernel, Transfer, Effects>
{
    using Begin = BeginSolve<Space, Kernel, Transfer, Effects>;
    using Phase = typename Begin::Phase;
    using Begin::d;
    using typename Begin::Number, typename Begin::Values, typename Begin::Own, typename Begin::Result;
    static constexpr bool keeps_values = true;

    Number share_of_stiffness; ///< the weight w, of which the solution does not depend

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& result) const
    {
        using Real = typename Node::Real;
        this->template with_obstacles<Real>(node, [&](auto const& touched, Mask<Real> const& filled) {
            Mask<Real> const bent = filled & Begin::is_bent(free_motion<Real, d>(touched));
            if (any(bent)) update<Real>(node, touched, bent, result);
        });
    }

private:
    template <class Real, class Node, class Touched>
    FIRN_HOST_DEVICE void update(Node& node, Touched const& touched, Mask<Real> const& bent,
                                 Result& result) const
    {
        Vector<Real, d> const v = Phase::vector(node, Values::velocity);
        Real const weight = node.value(Own::stiffness) * Real(share_of_stiffness),
                   inverse = Phase::inverse_of(weight);
        Vector<Real, d> const of_mass = this->at_rest ? Vector<Real, d>(-Phase::vector(node, Own::target))
                                                      : Vector<Real, d>(v - Phase::vector(node, Own::target));
        Vector<Real, d> const r = of_mass * node.value(Own::mass) + Phase::vector(node, Own::impulse);
        ContactNow<Real, d> const contact =
            contact_now<Real, d>(touched, Vector<Real, d>(v - r * inverse), weight);
        Vector<Real, d> const way = contact.velocity - v, along = product<Real, d>(contact.free, way);
        Real held(0);
        for (int a = 0; a < d; ++a) {
            held += Real(1) - contact.free(a, a);
            node.set(Values::velocity + a, select(bent, contact.velocity[a] - along[a], v[a]));
            node.set(Own::friction + a, select(bent, contact.friction[a], node.value(Own::friction + a)));
            for (int b = 0; b <= a; ++b)
                node.set(Own::free_at(a, b),
                         select(bent, contact.free(a, b), node.value(Own::free_at(a, b))));
        }
        Mask<Real> const counts = bent & counted(node);
        result.touching += Begin::count(counts);
        result.held += Begin::count(counts & (held > Real(Number(0.5))));
    }
};

/// On nodes of a scene that is brought to rest, with the residual r of no displacement: a share of what
/// drives them is left for another load step. That is what contact leaves of r: it is at y = -r / w, as in
/// UpdateContact, and -w c(y) of r is left.
template <class Space, class Kernel, class Transfer, class Effects>
struct LeaveLoad : BeginSolve<Space, Kernel, Transfer, Effects>
{
    using Begin = BeginSolve<Space, Kernel, Transfer, Effects>;
    using Phase = typename Begin::Phase;
    using Begin::d;
    using typename Begin::Number, typename Begin::Own, typename Begin::Result;
    static constexpr bool keeps_values = true;

    Number share;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        this->template with_obstacles<Real>(node, [&](auto const& touched, Mask<Real> const& filled) {
            Real const mass = node.value(Own::mass), weight = node.value(Own::stiffness);
            Vector<Real, d> const load = Phase::vector(node, Own::target),
                                  y = (load * mass - Phase::vector(node, Own::impulse)) *
                                      Phase::inverse_of(weight),
                                  drives = touched(y) * (weight * Phase::inverse_of(mass));
            for (int a = 0; a < d; ++a)
                node.set(Own::target + a, select(filled, load[a] - drives[a] * Real(share), load[a]));
        });
    }
};

} // namespace firn
