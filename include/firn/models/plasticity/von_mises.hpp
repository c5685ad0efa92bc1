// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/models/elasticity/hencky.hpp>
#include <firn/models/plasticity/deviator.hpp>

#include <string>

namespace firn
{

/// Perfect plasticity of von Mises: the deviator of the Kirchhoff stress stays within sqrt(2/3) times the
/// yield stress, by a radial return in logarithmic strains (Simo 1992, box 4.1). Flow keeps the volume.
///
/// In two dimensions the deviator is that of the plane alone: uniaxial stress then yields at 2/sqrt(3)
/// = 1.1547 times the yield stress. Plane strain proper would need the elastic strain across the plane as
/// well.
template <class SpaceType>
struct VonMisesFlow
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<>;
    static constexpr auto name = "von_mises";
    static constexpr Number default_density = 1800;
    static Lame<Number> usual_elasticity() { return lame<Number>(1e6, 0.3); }
    template <class Law>
    static constexpr bool supports = std::is_same_v<Law, HenckyLaw>;

    Number yield_stress = 1e4; ///< Kirchhoff stress in uniaxial tension at which it yields [Pa]

    void for_each_parameter(auto const& use) const { use("yield_stress", yield_stress); }

    void validate() const
    {
        require(yield_stress > 0 && is_finite(yield_stress),
                "the yield stress is not a finite number above 0", name, "Pass Pa, e.g. 1e4 for clay.");
    }

    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const& moduli,
                                               Particle&, Real) const
    {
        Real multiplier;
        return return_to<Real, d>(trial, moduli.mu, Real(yield_stress), Real(0), multiplier);
    }

protected:
    /// Returns trial strains to the yield stress `yield` [Pa], which grows by `slope` [Pa] with the
    /// equivalent plastic strain; `multiplier` becomes |eps_trial - eps|.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PlasticFlow<Real, d> return_to(Vector<Real, d> const& trial, Real mu, Real yield,
                                                           Real slope, Real& multiplier)
    {
        constexpr double root = 0.81649658092772603273; // sqrt(2/3)
        Deviator<Real, d> const deviator(trial);
        Real const excess = Real(2) * mu * deviator.norm - Real(Number(root)) * yield;
        PlasticFlow<Real, d> plastic;
        plastic.flowed = excess > Real(0);
        multiplier = select(plastic.flowed, excess, Real(0)) / (Real(2) * mu + Real(Number(2.0 / 3)) * slope);
        Real const shrink = multiplier / select(plastic.flowed, deviator.norm, Real(1));
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) plastic.strains[i] = trial[i] - deviator.part[i] * shrink;
        plastic.hardening = Real(1);
        plastic.capped = no_lanes<Real>();
        return plastic;
    }
};

/// Plasticity of von Mises with linear isotropic hardening (Simo 1992, box 4.1): the yield stress grows by
/// `hardening_modulus` times the equivalent plastic strain, which is stored.
template <class SpaceType>
struct HardeningVonMisesFlow : VonMisesFlow<SpaceType>
{
    using Number = typename SpaceType::Scalar;
    using State = Fields<EquivalentPlasticStrain>;
    static constexpr auto name = "hardening_von_mises";

    Number hardening_modulus = 1e5; ///< H [Pa]

    void for_each_parameter(auto const& use) const
    {
        VonMisesFlow<SpaceType>::for_each_parameter(use);
        use("hardening_modulus", hardening_modulus);
    }

    void validate() const
    {
        VonMisesFlow<SpaceType>::validate();
        require(hardening_modulus >= 0 && is_finite(hardening_modulus),
                "the hardening modulus is not a finite number, 0 or above", name,
                "Pass Pa; what does not harden is VonMises.");
    }

    /// What is wrong with an uploaded or restored state: a yield stress that overflows, so that it would
    /// never yield again.
    template <class Particle>
    std::string objection(Particle const& state) const
    {
        Number const strain = state[EquivalentPlasticStrain{}];
        if (is_finite(this->yield_stress + hardening_modulus * strain)) return {};
        return "an equivalent plastic strain of " + std::to_string(double(strain)) +
               " gives a yield stress beyond all numbers";
    }

    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const& moduli,
                                               Particle& state, Real) const
    {
        Real& strain = state[EquivalentPlasticStrain{}];
        Real const slope(hardening_modulus), yield = Real(this->yield_stress) + slope * strain;
        Real multiplier;
        auto const plastic = this->template return_to<Real, d>(trial, moduli.mu, yield, slope, multiplier);
        strain += Real(Number(0.81649658092772603273)) * multiplier; // sqrt(2/3)
        return plastic;
    }
};

/// Metal and clay that yields at a fixed shear stress: Hencky's law and von Mises.
template <class Space>
using VonMises = Elastoplastic<HenckyLaw, VonMisesFlow<Space>>;

/// Metal that hardens while it flows.
template <class Space>
using HardeningVonMises = Elastoplastic<HenckyLaw, HardeningVonMisesFlow<Space>>;

} // namespace firn
