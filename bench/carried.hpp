// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/core/lane.hpp>
#include <firn/transfer/all.hpp>
#include <firn/transfer/marks.hpp>

#include <tuple>

// What particles may carry through the grid beside their motion, to be measured against MLS alone.
namespace firn::bench
{

struct Concentration
{
    static constexpr auto name = "concentration";
    static constexpr auto shape = FieldShape::scalar;
};
struct NodeDye
{
    static constexpr auto name = "node_dye";
    static constexpr auto shape = FieldShape::scalar;
};

/// A scalar that is scattered, averaged in the nodes and gathered: the dye of the guide to transfers.
struct Dye
{
    double share = 0.1; ///< of the neighbours' average that a particle takes

    static constexpr auto name = "dye";
    using State = Fields<Concentration>;
    using Stored = Fields<Concentration>;
    using ScatteredTerms = Fields<NodeDye>;
    using NodeFields = Fields<NodeDye>;
    using GatheredTerms = Fields<NodeDye>;

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const& particle, Real mass, Real, Terms& terms) const
    {
        terms[NodeDye{}] = particle[Concentration{}] * mass;
    }
    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const& sums, Real inverse_mass, Real, Values& values) const
    {
        values[NodeDye{}] = sums[NodeDye{}] * inverse_mass;
    }
    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle& particle, Terms const& terms, Real) const
    {
        Real const own = particle[Concentration{}];
        particle[Concentration{}] = own + (terms[NodeDye{}] - own) * Real(ScalarOf<Real>(share));
    }
};

/// A scalar that is scattered alone, one that is gathered as well, and one with a gradient both ways.
using CarryingTransfers =
    std::tuple<Carrying<Mls, Marks<Mark>>, Carrying<Mls, Dye>, Carrying<Mls, Conduction>>;

} // namespace firn::bench
