// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/phases/gather.hpp>
#include <firn/phases/scatter.hpp>

// The passes before the grid update in which a transfer extends nodal velocities, see Xpic: with S+ and S
// from particles to nodes and back, the extended ones are
//
//   v* = sum_k<m (I - S+ S)^k v^n,   by   u_1 = v^n,   u_k+1 = u_k + v^n - S+ S u_k,   v* = u_m
//
// so that S v* = (I - (I - S S+)^m) v (Hammerquist & Nairn 2017, in a form without binomials, whose terms
// would cancel).
namespace firn
{

/// On nodes: computes u_1, or u_k+1 from the S+ S u_k that particles scattered. A node stores u_k in place of
/// its velocity and v^n in place of the old one.
template <class Space>
struct ExtendVelocities
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Sums = NodeSums<d, Fields<NodeMass, NodeMomentum, NodeImpulse>>;
    using Values = NodeValues<d, Fields<NodeVelocity, NodeOldVelocity>>;
    static constexpr bool looks_around = false;
    using Result = NothingFound;

    Number smallest_mass; ///< see UpdateGrid
    bool first;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        Real const mass = node.sum(Sums::mass);
        Mask<Real> const filled = mass > Real(smallest_mass);
        Real const inverse_mass = select(filled, Real(1) / select(filled, mass, Real(1)), Real(0));
        for (int a = 0; a < d; ++a) {
            Real const found = node.sum(Sums::momentum + a) * inverse_mass;
            Real const old = first ? found : node.value(Values::old_velocity + a);
            Real const now = first ? found : node.value(Values::velocity + a) + (old - found);
            node.set(Values::old_velocity + a, old);
            node.set(Values::velocity + a, now);
        }
    }
};

/// On particles: they gather u_k from the nodes and scatter it again, weighted by their mass.
template <class Space, class Kernel, class PersistentFields>
struct ReturnVelocities
{
    /// Velocities only.
    struct Transfer
    {
        template <class>
        static constexpr Terms scatter_terms{};
        template <class>
        static constexpr Terms gather_terms{};
        static constexpr bool keeps_old_velocity = false;
    };
    using Scatter = firn::Scatter<Space, Kernel, Transfer>;
    using Gather = firn::Gather<Space, Kernel, Transfer>;
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    static constexpr CellWork work{.gathers = true, .scatters_to = ScatterTarget::next_sums};
    static constexpr int node_channels = Gather::node_channels, channels = Scatter::channels;
    static constexpr int scratch_channels = Gather::scratch_channels > Scatter::scratch_channels
                                                ? Gather::scratch_channels
                                                : Scatter::scratch_channels;
    template <class Real>
    using CellNodes = typename Gather::template CellNodes<Real>;
    using Result = NothingFound;

    TableView<Number const, d, PersistentFields> particles;
    MassGroups<Number> mass_groups;

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        Gather::template set_position<typename Items::Real>(items, particles.position(items));
    }

    template <class Row>
    FIRN_HOST_DEVICE static void gather(Row& row_of_cells)
    {
        Gather::gather(row_of_cells);
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result&) const
    {
        using Real = typename Items::Real;
        Vector<Real, d> const x = Gather::template position_of<Real>(items);
        Real const mass = mass_groups.find(items, particles.id).mass;
        ParticleContribution<Real, d> contribution;
        contribution.momentum = Gather::template gathered<Real>(items).velocity * mass;
        Scatter::store(items, x, mass, contribution, {});
    }

    template <class Row, class SumsOfCells>
    FIRN_HOST_DEVICE static void scatter(Row const& row_of_cells, SumsOfCells& sums)
    {
        Scatter::scatter(row_of_cells, sums);
    }
};

} // namespace firn
