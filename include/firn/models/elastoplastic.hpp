// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/field_sets.hpp>
#include <firn/core/parameters.hpp>
#include <firn/math/principal_axes.hpp>
#include <firn/models/elastic_law.hpp>
#include <firn/models/lame.hpp>
#include <firn/models/principal_product.hpp>
#include <firn/models/response.hpp>

#include <type_traits>

// Isotropic solids in principal axes: an elastic law gives the principal stresses of its strains, a plastic
// flow gives the elastic part of a trial strain, and Elastoplastic does what all of them share, with one
// search for the principal axes per step.
//
// An elastic law (elasticity/) is a struct with a `name` and functions of d principal values, in no order. It
// may have parameters beside the Lamé ones, which it validates and names as a flow does:
//
// - strains(extension): extensions, stretches less one, in the law's measure: themselves, or logarithms
//
// - extensions(strains): the way back
//
// - stress(strains, mu, lambda): PrincipalStress
//
// - energy(strains, mu, lambda) [Pa], of which the stress is the derivative; may be left out
//
// - tangent(extension, mu, lambda): PrincipalTangent, for implicit steps; may be left out
//
// - inverted(extension): where there is no stress for such stretches
//
// - capped(extension): where the law clamps stretches; MeasuredByExtension has strains, extensions and this
// one
//
// Extensions rather than stretches: near rest, differences of stretches from one are rounding errors.
//
// A plastic flow (plasticity/) is a struct of parameters with its Space, a `name`, the fields that it stores
// for a particle (`State`), defaults of density and elasticity, validate(), or validate(Lame) if its bounds
// depend on the moduli, and
//
// - hardening_of(state): the factor of the moduli that the state has, for implicit steps; may be left out if
// nothing hardens them
//
// - supports<Law>: whether it is stated in the measure of this law
//
// - flow(trial, Lame<Real>, state, dt): PlasticFlow; updates what is stored
//
// - for_each_parameter(use), so that snapshots notice other parameters: see parameters.hpp
namespace firn
{

/// The result of a plastic flow for principal trial strains.
template <class Real, int d>
struct PlasticFlow
{
    Vector<Real, d> strains; ///< their elastic part
    Mask<Real> flowed;       ///< they differ from the trial strains
    Real hardening;          ///< factor of the moduli
    Mask<Real> capped;       ///< the state reached a stated cap
};

/// A solid that does not yield.
template <class SpaceType>
struct NoFlow
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<>;
    static constexpr Number default_density = 1000;
    static Lame<Number> usual_elasticity() { return lame<Number>(1e5, 0.3); }
    template <class Law>
    static constexpr bool supports = true;

    void validate() const {}
};

namespace detail
{
/// The name of a solid: that of its flow, or of its law if it does not yield.
template <class Law, class Flow>
constexpr char const* name_of_solid()
{
    if constexpr (requires { Flow::name; })
        return Flow::name;
    else
        return Law::name;
}

/// The fields that a flow stores; without them it is refused with a sentence.
template <class Flow>
struct FieldsOfFlow
{
    static_assert(sizeof(Flow) == 0,
                  "the plastic flow lacks 'using State = firn::Fields<...>', what it stores "
                  "for a particle; firn::Fields<> if that is nothing");
    using Type = Fields<>;
};
template <class Flow>
    requires requires { typename Flow::State; }
struct FieldsOfFlow<Flow>
{
    using Type = typename Flow::State;
};

template <class Law, class Real, int d>
concept LawTellsEnergy = requires(Law const law, Vector<Real, d> const strains, Real modulus)
{
    law.template energy<Real, d>(strains, modulus, modulus);
};
template <class Flow, class Particle, class Real>
concept FlowTellsHardening = requires(Flow const flow, Particle const state)
{
    flow.template hardening_of<Real>(state);
};
template <class Law, class Real, int d>
concept LawTellsTangent = requires(Law const law, Vector<Real, d> const extension, Real modulus)
{
    law.template tangent<Real, d>(extension, modulus, modulus);
};
} // namespace detail

/// An isotropic solid of an elastic law and a plastic flow; the parameters of both are members of the solid,
/// too. The Lamé ones are those of small strains, whatever the law.
///
/// Stores F_E - I and the flow's own fields. The principal axes of the trial deformation F_E = sum sigma_i
/// u_i v_i^T serve the return map (F_E = sum sigma_i' u_i v_i^T) and the stress (tau = sum tau_i u_i u_i^T),
/// since an isotropic law has its axes in common with F_E F_E^T.
template <class LawType, class FlowType>
struct Elastoplastic : FlowType, LawType
{
    using Law = LawType;
    using Flow = FlowType;
    using Space = typename Flow::Space;
    using Number = typename Space::Scalar;
    using State = Join<Fields<DisplacementGradient>, typename detail::FieldsOfFlow<Flow>::Type>;
    static constexpr auto name = detail::name_of_solid<Law, Flow>();
    static constexpr bool yields = !std::is_same_v<Flow, NoFlow<Space>>;
    static_assert(Flow::template supports<Law>, "this plastic flow is stated in the strains of another law");

    Number density = Flow::default_density;             ///< [kg/m^3]
    Lame<Number> elasticity = Flow::usual_elasticity(); ///< before any hardening [Pa]

    void for_each_parameter(auto const& use) const
    {
        use("elasticity", elasticity);
        if constexpr (SaysParameters<Law>) Law::for_each_parameter(use);
        if constexpr (SaysParameters<Flow>) Flow::for_each_parameter(use);
    }

    void validate() const
    {
        require_density(double(density), name);
        elasticity.validate(name);
        if constexpr (requires { this->Law::validate(); }) Law::validate();
        if constexpr (requires { this->Flow::validate(elasticity); })
            Flow::validate(elasticity);
        else
            Flow::validate();
    }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        return answer<Real, yields>(state, velocity_gradient, dt);
    }

    /// The same as long as nothing flows: the elastic predictor, with moduli as they have hardened before.
    /// Implicit steps ask for it, and the return map follows at their end.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    predict(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient,
            Real dt) const requires yields
    {
        return answer<Real, false>(state, velocity_gradient, dt);
    }

    /// The state in its principal axes, with moduli as they have hardened.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE StateInAxes<Real, Space::dimension>
    in_axes(Particle const& state) const requires detail::LawTellsTangent<Law, Real, Space::dimension>
    {
        Lame<Real> const moduli = hardened<Real>(state);
        return state_in_axes<Real, Space::dimension>(static_cast<Law const&>(*this),
                                                     state[DisplacementGradient{}], moduli.mu, moduli.lambda);
    }

    /// Q = dP F^T, for dF = dl F, while nothing flows: see product_in_axes.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Matrix<Real, Space::dimension> product(Particle const& state,
                                                            Matrix<Real, Space::dimension> const& change)
        const requires detail::LawTellsTangent<Law, Real, Space::dimension>
    {
        return product_in_axes<Real, Space::dimension>(in_axes<Real>(state), change);
    }

    /// The elastic energy [J/m^3], with hardened moduli where the flow hardens them.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real
    energy(Particle const& state) const requires detail::LawTellsEnergy<Law, Real, Space::dimension>
    {
        constexpr int d = Space::dimension;
        Law const& law = *this;
        auto const axes = principal_axes<Real, d>(state[DisplacementGradient{}]);
        Vector<Real, d> strains = law.template strains<Real, d>(axes.extension);
        Real mu(elasticity.mu), lambda(elasticity.lambda);
        if constexpr (yields) { // no further, but the flow knows the hardening
            Particle after = state;
            PlasticFlow<Real, d> const plastic =
                this->Flow::template flow<Real, d>(strains, Lame<Real>{mu, lambda}, after, Real(0));
            strains = plastic.strains;
            mu = mu * plastic.hardening;
            lambda = lambda * plastic.hardening;
        }
        return law.template energy<Real, d>(strains, mu, lambda);
    }

private:
    /// The moduli as they have hardened.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Lame<Real> hardened([[maybe_unused]] Particle const& state) const
    {
        Real const mu(elasticity.mu), lambda(elasticity.lambda);
        if constexpr (detail::FlowTellsHardening<Flow, Particle, Real>) {
            Real const factor = this->template hardening_of<Real>(state);
            return {mu * factor, lambda * factor};
        }
        else
            return {mu, lambda};
    }

    template <Lane Real, bool flows, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    answer(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient,
           [[maybe_unused]] Real dt) const
    {
        constexpr int d = Space::dimension;
        Law const& law = *this;
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        Matrix<Real, d> const trial = deformed<Real, d>(H, velocity_gradient, dt);
        auto const axes = principal_axes<Real, d>(trial);
        Vector<Real, d> strains = law.template strains<Real, d>(axes.extension);
        Real mu(elasticity.mu), lambda(elasticity.lambda);
        if constexpr (yields && !flows) {
            Lame<Real> const moduli = hardened<Real>(state);
            mu = moduli.mu;
            lambda = moduli.lambda;
        }
        Response<Real, d> response;
        response.inverted = law.template inverted<Real, d>(axes.extension);
        response.capped = law.template capped<Real, d>(axes.extension);

        if constexpr (flows) {
            PlasticFlow<Real, d> const plastic =
                this->Flow::template flow<Real, d>(strains, Lame<Real>{mu, lambda}, state, dt);
            strains = plastic.strains;
            mu = mu * plastic.hardening;
            lambda = lambda * plastic.hardening;
            response.capped = response.capped | plastic.capped;
            // F changes by the plastic flow alone, along each axis by (sigma' - sigma) u v^T: if it were
            // rebuilt from its axes, their rounding errors would add up over the steps.
            H = trial;
            Vector<Real, d> const left = law.template extensions<Real, d>(strains);
            FIRN_UNROLL
            for (int i = 0; i < d; ++i) {
                Real const sigma = Real(1) + axes.extension[i];
                Mask<Real> const flowed =
                    plastic.flowed & !exactly_equal(sigma, Real(0)); // where sigma is 0 there is no axis
                Real const change = (left[i] - axes.extension[i]) / select(flowed, sigma, Real(1));
                H += axes.U.col(i) * (axes.stretched.col(i) * select(flowed, change, Real(0))).transpose();
            }
        }
        else
            H = trial;

        PrincipalStress<Real, d> const principal = law.template stress<Real, d>(strains, mu, lambda);
        response.kirchhoff_stress = axes.U * principal.kirchhoff.asDiagonal() * axes.U.transpose();
        response.wave_modulus = principal.wave_modulus;
        return response;
    }
};

} // namespace firn
