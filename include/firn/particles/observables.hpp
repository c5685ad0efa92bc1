// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/models/response.hpp>
#include <firn/particles/table_view.hpp>

#include <cstddef>

// Fields that are not stored, but computed from what particles store when they are asked for: by
// Solver::download and Solver::write, in the backend's loops. Each tag says how. One of your own has a
// `name`, a `shape`, `is_observed`, `uses_velocity_gradient<Model>` and `observe`, as those below.
namespace firn
{

/// A field that is computed when it is asked for.
template <class Tag>
concept ObservedField = requires
{
    requires Tag::is_observed;
};

/// The volume of a particle over its volume at rest, J [-], by what it stores: det F, that of the elastic
/// part times that of the plastic part, or e^(ln J). A model that stores something else tells it by `template
/// <firn::Lane Real, class Particle> Real volume_ratio(Particle const& state) const`.
template <Lane Real, int d, class Model, class Particle>
FIRN_HOST_DEVICE inline Real volume_ratio([[maybe_unused]] Model const& model, Particle const& state)
{
    if constexpr (requires { model.template volume_ratio<Real>(state); })
        return model.template volume_ratio<Real>(state);
    else {
        using State = typename Model::State;
        constexpr bool is_solid = State::template contains<DisplacementGradient>;
        static_assert(
            is_solid || State::template contains<LogVolumeRatio>,
            "the model lacks 'template <firn::Lane Real, class Particle> Real volume_ratio(Particle "
            "const& state) const': its fields do not tell how its volume has changed");
        Real ratio(1), logarithm(0);
        if constexpr (is_solid) ratio += volume_change<Real, d>(state[DisplacementGradient{}]);
        if constexpr (State::template contains<PlasticVolumeRatio>) ratio *= state[PlasticVolumeRatio{}];
        if constexpr (State::template contains<LogPlasticVolumeRatio>)
            logarithm += state[LogPlasticVolumeRatio{}];
        if constexpr (State::template contains<LooseVolume>) logarithm += state[LooseVolume{}];
        if constexpr (State::template contains<LogVolumeRatio>) logarithm += state[LogVolumeRatio{}];
        return ratio * exp(logarithm);
    }
}

/// The Cauchy stress sigma = tau / J [Pa], symmetric, tension above 0: the model's response to the stored
/// state, and of a viscous model to the VelocityGradient.
struct Stress
{
    static constexpr auto name = "stress";
    static constexpr auto shape = FieldShape::matrix;
    static constexpr bool is_observed = true;
    template <class Model>
    static constexpr bool uses_velocity_gradient = Viscous<Model>;

    template <Lane Real, int d, class Model, class Particle>
    FIRN_HOST_DEVICE static Matrix<Real, d> observe(Model const& model, Particle const& particle,
                                                    Matrix<Real, d> const& velocity_gradient)
    {
        Particle state = particle; // a response may change it
        auto const tau = model.template respond<Real>(state, velocity_gradient, Real(0)).kirchhoff_stress;
        Real const half_over_J = Real(ScalarOf<Real>(0.5)) / volume_ratio<Real, d>(model, particle);
        return make_matrix<Real, d>([&](int i, int j) { return (tau(i, j) + tau(j, i)) * half_over_J; });
    }
};

/// The pressure -tr sigma / d [Pa]. In the plane it is the mean of the pressures in the plane: that of a
/// fluid, but not of a solid, whose stress across the plane is another one.
struct Pressure
{
    static constexpr auto name = "pressure";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr bool is_observed = true;
    template <class Model>
    static constexpr bool uses_velocity_gradient = Viscous<Model>;

    template <Lane Real, int d, class Model, class Particle>
    FIRN_HOST_DEVICE static Real observe(Model const& model, Particle const& particle,
                                         Matrix<Real, d> const& velocity_gradient)
    {
        auto const stress = Stress::observe<Real, d>(model, particle, velocity_gradient);
        return Real(ScalarOf<Real>(-1.0 / d)) * sum_of<Real, d>([&](int i) { return stress(i, i); });
    }
};

/// Von Mises' equivalent stress sqrt(3/2) |dev sigma| [Pa]: sigma in uniaxial stress in space. In the plane
/// the stress across it counts as the mean of the two in it, as in the yield criterion of VonMises. So a
/// particle flows where this, times J, comes to the yield stress, in the plane and in space.
struct VonMisesStress
{
    static constexpr auto name = "von_mises_stress";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr bool is_observed = true;
    template <class Model>
    static constexpr bool uses_velocity_gradient = Viscous<Model>;

    template <Lane Real, int d, class Model, class Particle>
    FIRN_HOST_DEVICE static Real observe(Model const& model, Particle const& particle,
                                         Matrix<Real, d> const& velocity_gradient)
    {
        auto stress = Stress::observe<Real, d>(model, particle, velocity_gradient);
        Real const mean =
            Real(ScalarOf<Real>(1.0 / d)) * sum_of<Real, d>([&](int i) { return stress(i, i); });
        for (int i = 0; i < d; ++i) stress(i, i) -= mean;
        return sqrt(Real(ScalarOf<Real>(1.5)) * squared_norm<Real, d>(stress));
    }
};

/// The elastic energy per volume at rest [J/m^3], in the plane for a metre of depth.
struct EnergyDensity
{
    static constexpr auto name = "energy_density";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr bool is_observed = true;
    template <class Model>
    static constexpr bool uses_velocity_gradient = false;

    template <Lane Real, int d, class Model, class Particle>
    FIRN_HOST_DEVICE static Real observe(Model const& model, Particle const& particle, Matrix<Real, d> const&)
    {
        constexpr bool is_told = TellsEnergy<Model, Real, Particle>;
        static_assert(is_told, "the model lacks 'template <firn::Lane Real, class Particle> Real "
                               "energy(Particle const& state) const', its elastic energy per volume at rest; "
                               "of an Elastoplastic its law lacks 'template <firn::Lane Real, int d> Real "
                               "energy(firn::Vector<Real, d> const& strains, Real mu, Real lambda) const'");
        if constexpr (is_told)
            return model.template energy<Real>(particle);
        else
            return Real(0);
    }
};

/// The volume over that at rest, J [-]: see volume_ratio. Where materials do not store it there is a
/// difference: sand's is without what it opens by dilatancy, Cam-Clay's has the changes of alpha by flow in
/// shear in it, and that of a fluid that parts is at most 1.
struct VolumeRatio
{
    static constexpr auto name = "volume_ratio";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr bool is_observed = true;
    template <class Model>
    static constexpr bool uses_velocity_gradient = false;

    template <Lane Real, int d, class Model, class Particle>
    FIRN_HOST_DEVICE static Real observe(Model const& model, Particle const& particle, Matrix<Real, d> const&)
    {
        return volume_ratio<Real, d>(model, particle);
    }
};

/// The velocity gradient dv_i/dx_j [1/s]: the affine matrix of MLS, TPIC and APIC, which with APIC differs
/// from sum v_i grad w_i by the square of the cell size. With PIC, FLIP and XPIC it is that sum on the grid
/// of the last step; after particles were added, removed, uploaded, restored or saved it is 0 until the next
/// step.
struct VelocityGradient
{
    static constexpr auto name = "velocity_gradient";
    static constexpr auto shape = FieldShape::matrix;
    static constexpr bool is_observed = true;
    template <class Model>
    static constexpr bool uses_velocity_gradient = true;

    template <Lane Real, int d, class Model, class Particle>
    FIRN_HOST_DEVICE static Matrix<Real, d> observe(Model const&, Particle const&,
                                                    Matrix<Real, d> const& velocity_gradient)
    {
        return velocity_gradient;
    }
};

/// Velocity gradients of particles in the backend's memory: component c of the particle in a row is
/// `of[row * row_stride + c * component_stride]`. They are zero where `of` is null.
template <class Number>
struct GradientsByRow
{
    Number const* of = nullptr;
    std::size_t row_stride = 0, component_stride = 0;
};

/// Computes and writes an observed field of a particle: called for every place of a particle.
template <class Tag, class Space, class Model, class PersistentFields>
struct ObserveField
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;

    Model model;
    TableView<Number const, d, PersistentFields> particles;
    GradientsByRow<Number> gradients;
    Number* to; ///< component c of the particle in a row at to[row * stride + c]
    std::size_t stride;

    FIRN_HOST_DEVICE void operator()(std::size_t place) const
    {
        Record<Number, d, PersistentFields> particle;
        particle.for_each([&](int c, Number& value) { value = particles.component[std::size_t(c)][place]; });
        std::size_t const row = particles.id[place];
        auto const gradient = make_matrix<Number, d>([&](int i, int j) {
            std::size_t const c = static_cast<unsigned>(i * d + j);
            return gradients.of ? gradients.of[row * gradients.row_stride + c * gradients.component_stride]
                                : Number(0);
        });
        auto const value = Tag::template observe<Number, d>(model, particle, gradient);
        for_each_component<Tag, d>(value, [&](int c, Number const& component) {
            to[row * stride + static_cast<unsigned>(c)] = component;
        });
    }
};

} // namespace firn
