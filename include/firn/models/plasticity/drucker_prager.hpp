// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/models/elasticity/hencky.hpp>
#include <firn/models/plasticity/deviator.hpp>

namespace firn
{

/// alpha of the cone |dev tau| = -alpha tr tau for an angle of internal friction phi [rad]. In space
/// sqrt(2/3) 2 sin phi / (3 - sin phi): triaxial compression yields as Mohr–Coulomb does (Klár et al. 2016,
/// section 7.1). In the plane sin phi / sqrt(2), which is Mohr–Coulomb itself; the cone of space would give
/// an angle of asin(sqrt(2) alpha) there, 27.5 instead of 30 degrees.
inline double friction_cone(int d, double friction_angle)
{
    require(is_number(friction_angle) && friction_angle >= 0 && friction_angle < 1.5707,
            "the angle of friction is outside [0, pi/2)", "friction_cone",
            "Pass radians, e.g. 0.61 (35 degrees) for dry sand.");
    require(d == 2 || d == 3, "there are scenes in 2 and in 3 dimensions", "friction_cone",
            "Pass one of these.");
    double const s = std::sin(friction_angle);
    return d == 2 ? s / std::sqrt(2.0) : std::sqrt(2.0 / 3) * 2 * s / (3 - s);
}

/// Sand of Drucker and Prager (Klár et al. 2016, section 7): grains that touch bear shear up to a share of
/// their pressure, and flow keeps their volume; loose grains bear nothing.
///
/// What volume they gain while loose is kept, and taken back before they touch again (Tampubolon et al. 2017,
/// section 4.3.4): sand would otherwise swell with every landing.
template <class SpaceType>
struct DruckerPragerFlow
{
    using Space = SpaceType;
    using Number = typename Space::Real;
    using Kept = Fields<LooseVolume>;
    static constexpr auto name = "sand";
    static constexpr Number usual_density = 1600;
    static Lame<Number> usual_elasticity() { return lame<Number>(1e6, 0.3); }
    template <class Law>
    static constexpr bool suits = std::is_same_v<Law, HenckyLaw>;

    Number cone = Number(friction_cone(Space::dimension, 0.6108652381980153)); ///< alpha; here of 35 degrees
    Number cohesion = 0; ///< logarithmic strain in all directions up to which grains stick together

    void for_each_parameter(auto const& use) const
    {
        use("cone", cone);
        use("cohesion", cohesion);
    }

    void validate() const
    {
        require(cone >= 0 && is_finite(cone), "the slope of the cone is not a finite number, 0 or above",
                name, "Pass friction_cone(dimension, angle).");
        // beyond a stretch of e Hencky's law has lost its stability, and strains are rounded as this one is
        require(is_between(0, cohesion, 10), "the cohesion is outside [0, 10]", name,
                "Pass a logarithmic strain, e.g. 0 for dry sand; what never parts is VonMises or Hencky.");
    }

    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const& moduli,
                                               Particle& state, Real) const
    {
        Real& loose = state[LooseVolume{}];
        Real const shift = loose * Real(Number(1.0 / d)) - Real(cohesion);
        Vector<Real, d> strains;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) strains[i] = trial[i] + shift;
        Deviator<Real, d> const deviator(strains);
        Real const two_mu = Real(2) * moduli.mu;
        Real const multiplier =
            deviator.norm + (Real(Number(d)) * moduli.lambda + two_mu) / two_mu * deviator.trace * Real(cone);
        Mask<Real> const parted = !(deviator.trace < Real(0)); // the tip of the cone
        Mask<Real> const slides = (!parted) & (multiplier > Real(0));
        Real const shrink = select(slides, multiplier, Real(0)) / select(slides, deviator.norm, Real(1));

        PlasticFlow<Real, d> plastic;
        plastic.flowed = parted | slides | (loose > Real(0));
        Real closed = loose;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            Real const touching = strains[i] - deviator.part[i] * shrink;
            Real const left = select(parted, Real(0), touching) + Real(cohesion);
            plastic.strains[i] = select(plastic.flowed, left, trial[i]);
            closed += trial[i] - plastic.strains[i];
        }
        loose = max(closed, Real(0));
        plastic.hardening = Real(1);
        plastic.capped = nowhere<Real>();
        return plastic;
    }
};

/// Dry sand: Hencky's law and Drucker and Prager's cone.
template <class Space>
using Sand = Elastoplastic<HenckyLaw, DruckerPragerFlow<Space>>;

} // namespace firn
