// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/fields.hpp>
#include <firn/math/singular_values.hpp>
#include <firn/models/lame.hpp>
#include <firn/models/response.hpp>

#include <type_traits>

// Isotropic solids in principal axes: an elastic law says what the principal stresses of its strains are, a
// plastic flow which part of a trial strain is elastic, and Elastoplastic does what all of them share, with
// one singular value decomposition a step.
//
// An elastic law (elasticity/) is a type with a `name` and static functions of d principal values:
//   strains(sigma)               the strains in the law's measure: stretches, or their logarithms
//   stretches(strains)           the way back
//   stress(strains, mu, lambda)  PrincipalStress
//   inverted(sigma)              where there is no stress for such stretches
// A plastic flow (plasticity/) is a struct of parameters with its Space, a `name`, what it keeps of a
// particle (`Kept`), defaults of density and elasticity, validate(), and
//   suits<Law>                   whether it is stated in the measure of this law
//   flow(trial, Lame<Real>, state, dt)  PlasticFlow; evolves what is kept
namespace firn
{

/// What an elastic law answers to principal strains.
template <class Real, int d>
struct PrincipalStress
{
    Vector<Real, d> kirchhoff; ///< [Pa]
    Real wave_modulus;         ///< rho_0 c^2 of the fastest wave along a principal axis [Pa]
};

/// What a plastic flow makes of principal trial strains.
template <class Real, int d>
struct PlasticFlow
{
    Vector<Real, d> strains; ///< what is left of them as elastic strains
    Mask<Real> flowed;       ///< they differ from the trial strains
    Real hardening;          ///< factor of the moduli
    Mask<Real> capped;       ///< the state reached a stated cap
};

/// A solid that does not yield.
template <class SpaceType>
struct NoFlow
{
    using Space = SpaceType;
    using Number = typename Space::Real;
    using Kept = Fields<>;
    static constexpr Number usual_density = 1000;
    static Lame<Number> usual_elasticity() { return lame<Number>(1e5, 0.3); }
    template <class Law>
    static constexpr bool suits = true;

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
} // namespace detail

/// An isotropic solid of an elastic law and a plastic flow, whose parameters are members of the solid too.
///
/// Stores F_E - I and what the flow keeps. One singular value decomposition F_E = U diag(sigma) V^T of the
/// trial deformation serves the return map (F_E = U diag(sigma') V^T) and the stress (tau = U diag(tau_i)
/// U^T), since an isotropic law has its principal axes in common with F_E F_E^T.
template <class LawType, class FlowType>
struct Elastoplastic : FlowType
{
    using Law = LawType;
    using Flow = FlowType;
    using Space = typename Flow::Space;
    using Number = typename Space::Real;
    using State = Join<Fields<DisplacementGradient>, typename Flow::Kept>;
    static constexpr auto name = detail::name_of_solid<Law, Flow>();
    static constexpr bool yields = !std::is_same_v<Flow, NoFlow<Space>>;
    static_assert(Flow::template suits<Law>, "this plastic flow is stated in the strains of another law");

    Number density = Flow::usual_density;               ///< [kg/m^3]
    Lame<Number> elasticity = Flow::usual_elasticity(); ///< of the state that has not hardened [Pa]

    void validate() const
    {
        require_density(double(density), name);
        elasticity.validate(name);
        Flow::validate();
    }

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, Space::dimension>
    respond(Particle& state, Matrix<Real, Space::dimension> const& velocity_gradient, Real dt) const
    {
        constexpr int d = Space::dimension;
        Matrix<Real, d>& H = state[DisplacementGradient{}];
        Matrix<Real, d> const trial = deformed<Real, d>(H, velocity_gradient, dt);
        auto const svd = singular_values(deformation_gradient<Real, d>(trial));
        Vector<Real, d> strains = Law::template strains<Real, d>(svd.sigma);
        Real mu(elasticity.mu), lambda(elasticity.lambda);
        Response<Real, d> response;
        response.inverted = Law::template inverted<Real, d>(svd.sigma);
        response.capped = nowhere<Real>();

        if constexpr (yields) {
            PlasticFlow<Real, d> const plastic =
                this->template flow<Real, d>(strains, Lame<Real>{mu, lambda}, state, dt);
            strains = plastic.strains;
            mu = mu * plastic.hardening;
            lambda = lambda * plastic.hardening;
            response.capped = plastic.capped;
            // Where nothing flowed F stays as it is: rebuilding it would add the rounding of the SVD with
            // every step.
            Matrix<Real, d> const F_E =
                svd.U * Law::template stretches<Real, d>(strains).asDiagonal() * svd.V.transpose();
            Matrix<Real, d> const mapped = displacement_gradient<Real, d>(F_E);
            FIRN_UNROLL
            for (int i = 0; i < d; ++i) FIRN_UNROLL
            for (int j = 0; j < d; ++j) H(i, j) = select(plastic.flowed, mapped(i, j), trial(i, j));
        }
        else
            H = trial;

        PrincipalStress<Real, d> const principal = Law::template stress<Real, d>(strains, mu, lambda);
        response.kirchhoff_stress = svd.U * principal.kirchhoff.asDiagonal() * svd.U.transpose();
        response.wave_modulus = principal.wave_modulus;
        return response;
    }
};

} // namespace firn
