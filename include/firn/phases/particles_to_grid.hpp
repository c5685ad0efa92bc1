// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/phases/scatter.hpp>

namespace firn
{

/// Phase 1: particles scatter mass, momentum and the impulse of their stress to the nodes. The stress follows
/// from the state: it is the model's response to no deformation.
///
/// G2p2g scatters to the next step's grid in the pass that moves particles. This phase remains for the first
/// step, and for the correction where a step gets another length than was guessed.
template <class Space, class Model, class Kernel, class TransferType, class PersistentFields,
          class DerivedFields>
struct ParticlesToGrid : Scatter<Space, Kernel, TransferType>
{
    using Transfer = TransferType;
    using Scatter = firn::Scatter<Space, Kernel, Transfer>;
    using Scatter::d, Scatter::scratch_channels;
    using Number = typename Space::Scalar;
    using Result = NothingFound;
    static constexpr CellWork work{.scatters_to = ScatterTarget::sums};

    Model model;
    Transfer transfer;
    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number const, d, DerivedFields> velocities;
    MassGroups<Number> mass_groups;
    Number dt;         ///< [s]; if `impulse_only`, the difference to the dt already scattered
    Number cell_size;  ///< [m]
    bool impulse_only; ///< mass and momentum have been scattered already

    /// Whether it adds to what has been scattered before; otherwise the sums are made afresh.
    bool adds_to_sums() const { return impulse_only; }

    /// Computes and stores the particles' contributions.
    template <class Items>
    FIRN_HOST_DEVICE void prepare(Items& items) const
    {
        using Real = typename Items::Real;
        auto particle = Record<Real, d, Join<PersistentFields, DerivedFields>>::at_rest();
        particles.load(items, particle);
        if (!impulse_only) velocities.load(items, particles.id, particle);
        auto const own = mass_groups.find(items, particles.id);
        Matrix<Real, d> L = zeros<Matrix<Real, d>>();
        // The viscous stress comes from the last step's motion, if particles have an affine velocity.
        if constexpr (Viscous<Model> &&
                      Join<PersistentFields, DerivedFields>::template contains<AffineVelocity>)
            L = particle[AffineVelocity{}];
        auto const response = model.template respond<Real>(particle, L, Real(0));
        // dt f_i = -dt V0 tau grad w_i, with the gradient taken per cell
        Matrix<Real, d> const impulse = response.kirchhoff_stress * (own.volume * Real(-dt / cell_size));
        Real const scattered_mass = impulse_only ? Real(0) : own.mass;
        Record<Real, d, typename Scatter::CarriedTerms> carried_terms;
        carried_by(transfer).template scatter<Real, d>(particle, scattered_mass, Real(cell_size),
                                                       carried_terms);
        Scatter::store(
            items, particles.position(items), scattered_mass,
            transfer.template scatter<Kernel, Real, d>(particle, scattered_mass, impulse, Real(cell_size)),
            carried_terms);
    }
};

} // namespace firn
