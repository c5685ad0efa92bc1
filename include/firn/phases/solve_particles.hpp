// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/math/inverse.hpp>
#include <firn/models/answers_product.hpp>
#include <firn/models/cached_tangent.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/mass_groups.hpp>
#include <firn/particles/table_view.hpp>
#include <firn/phases/gather.hpp>
#include <firn/phases/scatter.hpp>
#include <firn/phases/scatter_stress.hpp>

// The passes of an implicit step from nodes to particles and back. Both gather a gradient of what nodes hold
// as their velocity, and scatter an impulse of stress. With L the velocity gradient of a particle,
// A = I + dt L, F = A F_n and tau = P F^T:
//
//   the impulse of stress   dt sum V0 P F_n^T grad w_i,  P F_n^T = tau A^-T
//   its derivative          dt sum V0 Q A^-T grad w_i,   Q = dP F^T by dl = dt dL A^-1, of CachedTangent
//
// (Gast et al. 2015, Optimization integrator for large time steps; all but F_n of Q and dl is of the state at
// the end of the step, so that a model answers a spatial product.)
namespace firn
{

/// Where a particle is in its cell, from the cell's centre [cells].
struct KeptOffset
{
    static constexpr auto name = "kept_offset";
    static constexpr auto shape = FieldShape::vector;
};

/// What a particle of a model keeps while a step is solved: its place, and of its state at the velocities
/// that were tried. A product so loads all by slot, and does not look up where particles lie.
template <class Model>
using TrialFields = Join<Fields<KeptOffset>, typename CachedTangent<Model>::Kept>;

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
    static constexpr bool gathers_velocity = false;

    /// The gradient of what was gathered, per cell: MLS-MPM's is its affine matrix.
    template <class Kernel, Lane Real, int d>
    FIRN_HOST_DEVICE static Matrix<Real, d> gradient(Gathered<Real, d> const& gathered)
    {
        if constexpr (by_gradient<Kernel>)
            return gathered.gradient;
        else
            return gathered.affine;
    }
    /// What scatters an impulse of stress [N s per cell].
    template <class Kernel, Lane Real, int d>
    FIRN_HOST_DEVICE static Matrix<Real, d> scattered(Matrix<Real, d> const& impulse)
    {
        if constexpr (by_gradient<Kernel>)
            return impulse;
        else
            return impulse * Real(ScalarOf<Real>(Kernel::inverse_inertia));
    }
    template <class Kernel, Lane Real, int d>
    FIRN_HOST_DEVICE static ParticleContribution<Real, d> contribution(Matrix<Real, d> const& impulse)
    {
        ParticleContribution<Real, d> made;
        made.momentum = zeros<Vector<Real, d>>();
        (by_gradient<Kernel> ? made.gradient : made.affine) = scattered<Kernel, Real, d>(impulse);
        return made;
    }
};

/// The response of a material to a step that is tried. At rest flow belongs to the state that is looked for,
/// while steps map stress back at their end.
template <Lane Real, class Model, class Particle, int d = Model::Space::dimension>
FIRN_HOST_DEVICE Response<Real, d> respond_to_trial(Model const& model, Particle& particle,
                                                    Matrix<Real, Model::Space::dimension> const& L,
                                                    Real const& dt, bool at_rest)
{
    if constexpr (PredictsResponse<Model, Particle, Real>)
        if (ActsOnRates<Model> || !at_rest) return model.template predict<Real>(particle, L, dt);
    return model.template respond<Real>(particle, L, dt);
}

/// What both passes have in common.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields,
          template <class, class, class> class ScatterBy>
struct StressPass
{
    using Transfer = StressTransfer<Scheme>;
    using Scatter = ScatterBy<Space, Kernel, Transfer>;
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
    FieldsById<Number, d, Fields<KeptOffset>> offset;                   ///< by slot
    FieldsById<Number, d, typename CachedTangent<Model>::Kept> tangent; ///< by slot
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
    /// The velocity gradient that a particle gathered, per cell.
    template <class Real, class Items>
    FIRN_HOST_DEVICE static Matrix<Real, d> gradient(Items const& items)
    {
        return Transfer::template gradient<Kernel, Real, d>(Gather::template gathered<Real>(items));
    }
};

/// Particles try the nodes' velocities: they cache their state at the end of such a step, and scatter the
/// impulse of its stress. As mass they scatter V0 times the wave modulus [J], a measure of the stiffness of
/// nodes, or a negative value where the step would turn them inside out.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct TryVelocities : StressPass<Space, Model, Kernel, Scheme, PersistentFields, Scatter>
{
    using Pass = StressPass<Space, Model, Kernel, Scheme, PersistentFields, Scatter>;
    using Pass::d;
    using typename Pass::Number;

    /// What a particle scatters that is turned inside out: no sum of others makes up for it.
    static constexpr Number of_inverted = Number(-1e30);

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, NothingFound&) const
    {
        using Real = typename Items::Real;
        Matrix<Real, d> const L = this->template gradient<Real>(items) * Real(this->inverse_cell_size);
        Record<Real, d, PersistentFields> const before = load<Real>(items);
        Record<Real, d, PersistentFields> particle = before;
        auto const response = respond_to_trial<Real>(this->model, particle, L, Real(this->dt), this->at_rest);
        Real const volume = this->mass_groups.find(items, this->particles.id).volume;
        Matrix<Real, d> stress = response.kirchhoff_stress, inverse_transpose;
        Mask<Real> inverted = no_lanes<Real>();
        if constexpr (!ActsOnRates<Model>) {
            Matrix<Real, d> A = L * Real(this->dt);
            for (int i = 0; i < d; ++i) A(i, i) += Real(1);
            Matrix<Real, d> const C = cofactors(A);
            Real const determinant = sum_of<Real, d>([&](int k) { return A(k, 0) * C(k, 0); });
            inverted = response.inverted | !(determinant > Real(0));
            inverse_transpose = C * (Real(1) / select(inverted, Real(1), determinant));
            stress = product<Real, d>(response.kirchhoff_stress, inverse_transpose);
        }
        Real const in_cells(this->dt * this->inverse_cell_size);
        auto kept = CachedTangent<Model>::template of<Real>(this->model, before, particle, inverse_transpose,
                                                            Real(volume * in_cells * in_cells));
        this->tangent.store_by_slot(items, kept);
        Record<Real, d, Fields<KeptOffset>> place;
        place[KeptOffset{}] = Pass::Gather::template position_of<Real>(items);
        this->offset.store_by_slot(items, place);
        Matrix<Real, d> const impulse = make_matrix<Real, d>(
            [&](int i, int j) { return select(inverted, Real(0), stress(i, j) * (volume * in_cells)); });
        Real const stiffness = select(inverted, Real(0), volume * response.wave_modulus);
        Pass::Scatter::store(items, place[KeptOffset{}],
                             select(items.here() & inverted, Real(of_inverted), stiffness),
                             Pass::Transfer::template contribution<Kernel, Real, d>(impulse), {});
    }

private:
    template <class Real, class Items>
    FIRN_HOST_DEVICE Record<Real, d, PersistentFields> load(Items& items) const
    {
        Record<Real, d, PersistentFields> particle;
        this->particles.load(items, particle);
        return particle;
    }
};

/// Particles gather a change of the nodes' velocities, and scatter the change of the impulse of stress that
/// it makes, in first order at the state that was tried last.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct ProductOfStress : StressPass<Space, Model, Kernel, Scheme, PersistentFields, ScatterStress>
{
    using Pass = StressPass<Space, Model, Kernel, Scheme, PersistentFields, ScatterStress>;
    using Pass::d;
    static constexpr CellWork work{
        .gathers = true, .scatters_to = ScatterTarget::next_sums, .loads_stored = true};

    /// Says what update() will load, and begin() for other particles.
    template <class Items>
    FIRN_HOST_DEVICE void expect(Items const& items) const
    {
        for (auto const* const array : this->tangent.component) items.expect_stored(array);
        for (auto const* const array : this->offset.component) items.expect_next(array);
    }

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        Record<typename Items::Real, d, Fields<KeptOffset>> place;
        this->offset.load_by_slot(items, place);
        Pass::Gather::template set_position<typename Items::Real>(items, place[KeptOffset{}]);
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, NothingFound&) const
    {
        using Real = typename Items::Real;
        Record<Real, d, typename CachedTangent<Model>::Kept> kept;
        this->tangent.load_by_slot(items, kept);
        Pass::Scatter::store(
            items,
            Pass::Transfer::template scattered<Kernel, Real, d>(CachedTangent<Model>::template product<Real>(
                this->model, kept, this->template gradient<Real>(items), Real(this->dt))));
    }
};

/// The same transfer where particles gather velocities, too.
template <class Scheme>
struct SolutionTransfer : StressTransfer<Scheme>
{
    static constexpr bool gathers_velocity = true;
};

/// The wave modulus of a particle in the state that settle() has found [Pa].
struct FoundModulus
{
    static constexpr auto name = "found_modulus";
    static constexpr auto shape = FieldShape::scalar;
};

/// Particles gather the velocities that settle() has found, and their state at the end of such a step, by
/// row.
template <class Space, class Model, class Kernel, class Scheme, class PersistentFields>
struct GatherSolution : Gather<Space, Kernel, SolutionTransfer<Scheme>>
{
    using Transfer = SolutionTransfer<Scheme>;
    using Gather = firn::Gather<Space, Kernel, Transfer>;
    using Gather::d;
    using Number = typename Space::Scalar;
    static constexpr CellWork work{.gathers = true};
    using Result = NothingFound;

    using Found = Join<Fields<Velocity, FoundModulus>, typename Model::State>;

    Model model;
    TableView<Number const, d, PersistentFields> particles;
    FieldsById<Number, d, Found> found;
    Number dt;                ///< [s]
    Number inverse_cell_size; ///< [1/m]

    template <class Items>
    FIRN_HOST_DEVICE void begin(Items& items) const
    {
        Gather::template set_position<typename Items::Real>(items, particles.position(items));
    }

    template <class Items>
    FIRN_HOST_DEVICE void update(Items& items, Result&) const
    {
        using Real = typename Items::Real;
        auto const gathered = Gather::template gathered<Real>(items);
        Record<Real, d, Join<PersistentFields, Found>> particle;
        particles.load(items, particle);
        auto const response = respond_to_trial<Real>(
            model, particle,
            Matrix<Real, d>(Transfer::template gradient<Kernel, Real, d>(gathered) * Real(inverse_cell_size)),
            Real(dt), true);
        particle[Velocity{}] = gathered.velocity;
        particle[FoundModulus{}] = response.wave_modulus;
        found.store(items, particles.id, particle);
    }
};

} // namespace firn
