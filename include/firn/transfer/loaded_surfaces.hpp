// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/transfer/carrying.hpp>
#include <firn/transfer/node_fields.hpp>

namespace firn
{

/// The part of a body's surface that a particle stands for, over the particle's mass: its area times the
/// outward unit normal [m^2/kg; in two dimensions m/(kg/m)]. 0 for particles inside, and unless told
/// otherwise. See mark_face().
struct AreaPerMass
{
    static constexpr auto name = "area_per_mass";
    static constexpr auto shape = FieldShape::vector;
};

/// Lets a Traction act on the particles at a body's surface: these are marked by their AreaPerMass, and nodes
/// know by it how much of the surface is theirs. `Carrying<Mls, LoadedSurfaces>` is a transfer with it.
///
///   A_i = sum_p w_ip m_p (A_p / m_p)
///
/// Areas and normals are those of the marking, whatever the body's deformation since then: dead loads.
struct LoadedSurfaces
{
    static constexpr auto name = "loaded_surfaces";
    using State = Fields<AreaPerMass>;
    using Stored = Fields<AreaPerMass>;
    using ScatteredTerms = Fields<NodeArea>;
    using NodeFields = Fields<>;
    using GatheredTerms = Fields<>;

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const& particle, Real mass, Real, Terms& terms) const
    {
        terms[NodeArea{}] = particle[AreaPerMass{}] * mass;
    }

    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const&, Real, Real, Values&) const
    {}

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle&, Terms const&, Real) const
    {}
};

} // namespace firn
