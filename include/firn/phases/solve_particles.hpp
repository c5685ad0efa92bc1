// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/math/inverse.hpp>
#include <firn/models/answers_product.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/phases/gather.hpp>
#include <firn/phases/scatter.hpp>

#include <type_traits>

// The passes of an implicit step from nodes to particles and back. Both gather a gradient of what nodes hold
// as their velocity, and scatter an impulse of stress. With L the velocity gradient of a particle,
// A = I + dt L, F = A F_n and tau = P F^T:
//
//   the impulse of stress   dt sum V0 P F_n^T grad w_i,  P F_n^T = tau A^-T
//   its derivative          dt sum V0 Q A^-T grad w_i,   Q = dP F^T by dl = dt dL A^-1
//
// (Gast et al. 2015, Optimization integrator for large time steps; all but F_n of Q and dl is of the state at
// the end of the step, so that a model answers a spatial product.)
namespace firn
{

/// The inverse of A = I + dt L, by which a step deforms a particle.
struct InverseStep
{
    static constexpr auto name = "inverse_step";
    static constexpr auto shape = FieldShape::matrix;
};

/// What a particle of a model caches while a step is solved: its state at the velocities that were tried, and
/// by how much they deform it.
template <class Model>
using TrialFields = std::conditional_t<ActsOnRates<Model>, typename Model::State,
                                       Join<Fields<InverseStep>, typename Model::State>>;

/// The transfer of these passes: the gradient of a scheme and its transpose, by which stress acts.
template <class Scheme>
struct StressTransfer
{
    template <class Kernel>
    static constexpr bool by_gradient = Scheme::template gather_terms<Kernel>.gradient;
    template <class Kernel>
    static constexpr Terms scatter_terms{.affine = !by_gradient<Kernel>, .gradient = by_gradient<Kernel>};
    template <class Kernel>
    static constexpr Terms gather_terms = scatter_terms<Kernel>;
    static constexpr bool keeps_old_velocity = false;

    /// The gradient of what was gathered, per cell: MLS-MPM's is its affine matrix.
    template <class Kernel, Lane Real, int d>
    FIRN_HOST_DEVICE static Matrix<Real, d> gradient(Gathered<Real, d> const& gathered)
    {
        if constexpr (by_gradient<Kernel>)
            return gathered.gradient;
        else
            return gathered.affine;
    }
    /// The contribution of an impulse of stress [N s per cell].
    template <class Kernel, Lane Real, int d>
    FIRN_HOST_DEVICE static ParticleContribution<Real, d> contribution(Matrix<Real, d> const& impulse)
    {
        ParticleContribution<Real, d> made;
        made.momentum = zeros<Vector<Real, d>>();
        if constexpr (by_gradient<Kernel>)
            made.gradient = impulse;
        else
            made.affine = impulse * Real(ScalarOf<Real>(Kernel::inverse_inertia));
        return made;
    }
};

/// What both passes have in common.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct StressPass
{
    using Transfer = StressTransfer<Scheme>;
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

    Model model;
    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number, d, TrialFields<Model>> trial; ///< by slot
    MassGroups<Number> mass_groups;
    Number dt;                ///< [s]
    Number inverse_cell_size; ///< [1/m]
    bool at_rest;             ///< the scene is brought to rest

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

    template <class Row, class SumsOfCells>
    FIRN_HOST_DEVICE static void scatter(Row const& row_of_cells, SumsOfCells& sums)
    {
        Scatter::scatter(row_of_cells, sums);
    }

protected:
    /// dt times the gradient that a particle gathered.
    template <class Real, class Items>
    FIRN_HOST_DEVICE Matrix<Real, d> gradient(Items const& items) const
    {
        return Transfer::template gradient<Kernel, Real, d>(Gather::template gathered<Real>(items)) *
               Real(inverse_cell_size);
    }
    /// Stores an impulse of stress V0 stress dt, and a sum that goes with it, as what the particle scatters.
    template <class Real, class Items>
    FIRN_HOST_DEVICE void store(Items& items, Matrix<Real, d> const& stress, Real volume, Real sum) const
    {
        Vector<Real, d> const x = Gather::template position_of<Real>(items);
        Scatter::store(items, x, sum,
                       Transfer::template contribution<Kernel, Real, d>(
                           stress * (volume * Real(dt * inverse_cell_size))),
                       {});
    }
};

/// Particles try the nodes' velocities: they cache their state at the end of such a step, and scatter the
/// impulse of its stress. As mass they scatter V0 times the wave modulus [J], a measure of the stiffness of
/// nodes, or a negative value where the step would turn them inside out.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct TryVelocities : StressPass<Space, Model, Kernel, Scheme, PersistentFields>
{
    using Pass = StressPass<Space, Model, Kernel, Scheme, PersistentFields>;
    using Pass::d;
    using typename Pass::Number;

    /// What a particle scatters that is turned inside out: no sum of others makes up for it.
    static constexpr Number of_inverted = Number(-1e30);

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, NothingFound&) const
    {
        using Real = typename Items::Real;
        Matrix<Real, d> const L = this->template gradient<Real>(items);
        Record<Real, d, Join<PersistentFields, TrialFields<Model>>> particle;
        this->particles.load(items, particle);
        auto const response = respond<Real>(particle, L);
        if constexpr (ActsOnRates<Model>) {
            this->trial.store_by_slot(items, particle);
            Real const volume = this->mass_groups.find(items, this->particles.id).volume;
            this->template store<Real>(items, response.kirchhoff_stress, volume,
                                       volume * response.wave_modulus);
        }
        else
            store_stress<Real>(items, particle, L, response);
    }

private:
    /// The response of a step. At rest flow belongs to the state that is looked for, while steps map stress
    /// back at their end.
    template <class Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, d> respond(Particle& particle, Matrix<Real, d> const& L) const
    {
        Real const duration(this->dt);
        if constexpr (PredictsResponse<Model, Particle, Real>)
            if (ActsOnRates<Model> || !this->at_rest)
                return this->model.template predict<Real>(particle, L, duration);
        return this->model.template respond<Real>(particle, L, duration);
    }

    template <class Real, class Items, class Particle>
    FIRN_HOST_DEVICE void store_stress(Items& items, Particle& particle, Matrix<Real, d> const& L,
                                       Response<Real, d> const& response) const
    {
        Matrix<Real, d> A = L * Real(this->dt);
        for (int i = 0; i < d; ++i) A(i, i) += Real(1);
        Matrix<Real, d> const C = cofactors(A);
        Real const determinant = sum_of<Real, d>([&](int k) { return A(k, 0) * C(k, 0); });
        Mask<Real> const inverted = response.inverted | !(determinant > Real(0));
        Matrix<Real, d> const transposed = C * (Real(1) / select(inverted, Real(1), determinant)); // A^-T
        particle[InverseStep{}] = make_matrix<Real, d>([&](int i, int j) { return transposed(j, i); });
        this->trial.store_by_slot(items, particle);
        Real const volume = this->mass_groups.find(items, this->particles.id).volume;
        Matrix<Real, d> const stress = product<Real, d>(response.kirchhoff_stress, transposed);
        this->template store<Real>(items, make_matrix<Real, d>([&](int i, int j) {
                                       return select(inverted, Real(0), stress(i, j));
                                   }),
                                   volume,
                                   select(items.here() & inverted, Real(of_inverted),
                                          select(inverted, Real(0), volume * response.wave_modulus)));
    }
};

/// Particles gather a change of the nodes' velocities, and scatter the change of the impulse of stress that
/// it makes, in first order at the state that was tried last. As mass they scatter their own.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct ProductOfStress : StressPass<Space, Model, Kernel, Scheme, PersistentFields>
{
    using Pass = StressPass<Space, Model, Kernel, Scheme, PersistentFields>;
    using Pass::d;

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, NothingFound&) const
    {
        using Real = typename Items::Real;
        Matrix<Real, d> const dL = this->template gradient<Real>(items) * Real(this->dt);
        Record<Real, d, TrialFields<Model>> particle;
        this->trial.load_by_slot(items, particle);
        auto const own = this->mass_groups.find(items, this->particles.id);
        if constexpr (ActsOnRates<Model>)
            this->template store<Real>(items,
                                       this->model.template product<Real>(particle, dL, Real(this->dt)),
                                       own.volume, own.mass);
        else {
            Matrix<Real, d> const& inverse_step = particle[InverseStep{}];
            Matrix<Real, d> const Q =
                this->model.template product<Real>(particle, product<Real, d>(dL, inverse_step));
            this->template store<Real>(items, make_matrix<Real, d>([&](int i, int j) { // Q A^-T
                                           return sum_of<Real, d>(
                                               [&](int k) { return Q(i, k) * inverse_step(j, k); });
                                       }),
                                       own.volume, own.mass);
        }
    }
};

/// Particles gather the velocities that a step has found, and their state at its end, by row.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct GatherSolution : Gather<Space, Kernel, StressTransfer<Scheme>>
{
    using Gather = firn::Gather<Space, Kernel, StressTransfer<Scheme>>;
    using Gather::d;
    using Number = typename Space::Scalar;
    static constexpr CellWork work{.gathers = true};
    using Result = NothingFound;

    using Found = Join<Fields<Velocity>, typename Model::State>;

    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number, d, TrialFields<Model>> trial; ///< by slot
    FieldsById<Number, d, Found> found;

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        Gather::template set_position<typename Items::Real>(items, particles.position(items));
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result&) const
    {
        using Real = typename Items::Real;
        Record<Real, d, Join<TrialFields<Model>, Found>> particle;
        trial.load_by_slot(items, particle);
        particle[Velocity{}] = Gather::template gathered<Real>(items).velocity;
        found.store(items, particles.id, particle);
    }
};

} // namespace firn
