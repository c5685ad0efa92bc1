// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/chain.hpp>
#include <firn/phases/particles_to_grid.hpp>
#include <firn/phases/step_now.hpp>

namespace firn
{

/// What a node holds between its update and the gather: the new velocity, and the old one if the transfer
/// keeps it.
template <int d, bool keeps_old_velocity>
struct NodeVelocities
{
    static constexpr int velocity = 0;
    static constexpr int old_velocity = d;
    static constexpr int channels = keeps_old_velocity ? 2 * d : d;
};

/// Phase 2: momentum becomes velocity, forces, gravity and obstacles act on it.
///
///   v_i = chain((m v + dt f + dt m g)_i / m_i)      Stomakhin et al. 2013, steps 4 and 5
///
/// A node of less than `smallest_mass` counts as empty: its quotient would be rounding alone.
template <class Space, class Kernel, class Transfer, class Effects>
struct UpdateGrid
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Real;
    using Sums = NodeSums<d, Transfer::keeps_old_velocity>;
    using Velocities = NodeVelocities<d, Transfer::keeps_old_velocity>;
    using Result = Reactions<Effects::obstacles>;
    static constexpr int channels = Velocities::channels;

    StepNow<Number, Effects> const* now;
    Lattice lattice;
    Number smallest_mass;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result& reactions) const
    {
        using Real = typename Node::Real;
        Real const mass = node.sum(Sums::mass);
        Mask<Real> const filled = mass > Real(smallest_mass);
        Real const inverse_mass = select(filled, Real(1) / select(filled, mass, Real(1)), Real(0));

        Vector<Real, d> momentum;
        for (int a = 0; a < d; ++a) {
            momentum[a] = node.sum(Sums::momentum + a);
            if constexpr (Transfer::keeps_old_velocity) {
                node.set(Velocities::old_velocity + a, momentum[a] * inverse_mass);
                momentum[a] += node.sum(Sums::impulse + a);
            }
        }
        apply_on_momentum<Real, d>(now->actions, momentum, mass);
        Vector<Real, d> velocity = momentum * inverse_mass;
        Place<Real, d> const place{lattice, node.first(), node.offset(), kernel_reach(Kernel::order)};
        velocity =
            apply_on_nodes<Real, d>(now->actions, place, select(filled, mass, Real(0)), velocity, reactions);
        for (int a = 0; a < d; ++a) node.set(Velocities::velocity + a, select(filled, velocity[a], Real(0)));
    }
};

} // namespace firn
