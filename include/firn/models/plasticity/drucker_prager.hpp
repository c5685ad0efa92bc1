// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/models/elasticity/hencky.hpp>
#include <firn/models/plasticity/deviator.hpp>

#include <algorithm>
#include <cmath>
#include <limits>

namespace firn
{

/// The experiment in which an angle of friction was measured. Sand that keeps its volume in flow has two such
/// angles: it stands up to phi, and a layer of it flows from atan(sin phi) on.
enum class Friction
{
    standing, ///< strength: phi of triaxial and biaxial tests, the steepest slope that stands
    flowing   ///< shear bands: the incline from which a layer flows
};

namespace detail
{
/// The slope of the cone through Mohr–Coulomb's pyramid of an angle [rad], at triaxial compression in space.
inline double slope_of_cone(int d, double angle, char const* where)
{
    require(d == 2 || d == 3, "there are scenes in 2 and in 3 dimensions", where, "Pass one of these.");
    double const s = std::sin(angle);
    return d == 2 ? s / std::sqrt(2.0) : std::sqrt(2.0 / 3) * 2 * s / (3 - s);
}
} // namespace detail

/// beta of the plastic potential |dev tau| + beta tr tau for an angle of dilatancy psi [rad]: by how much
/// flow in shear opens sand.
///
/// sin psi = e_v / (e_v - 2 e_1) for the plastic change e_v of volume and e_1 of the most compressed axis, in
/// the plane and in triaxial compression (Vermeer & de Borst 1984, *Non-associated plasticity for soils,
/// concrete and rock*). The measure is that of a standing friction_cone: flow is associated where psi is its
/// phi, or where the dilatancy is the cone itself. In space psi, of triaxial compression, is less than that
/// of plane strain.
inline double dilatancy_cone(int d, double dilatancy_angle)
{
    require(dilatancy_angle >= 0 && dilatancy_angle < 1.5707, "the angle of dilatancy is outside [0, pi/2)",
            "dilatancy_cone", "Pass radians, e.g. 0.09 (5 degrees); 0 for flow that keeps the volume.");
    return detail::slope_of_cone(d, dilatancy_angle, "dilatancy_cone");
}

/// alpha of the cone |dev tau| = -alpha tr tau for an angle of friction [rad], which is one of Friction's
/// two; the angle of dilatancy [rad], the model's, matters to the second alone.
///
/// Standing: in the plane alpha = sin phi / sqrt(2), which is Mohr–Coulomb itself. In space sqrt(2/3) 2 sin
/// phi / (3 - sin phi): triaxial compression yields as Mohr–Coulomb does (Klár et al. 2016, section 7.1).
/// Plane strain in space bears more with that cone: without dilatancy sin = 3 alpha / sqrt(2), 43.9 degrees
/// with that of 30. In two dimensions it would bear less, sin = sqrt(2) alpha, 27.5 degrees.
///
/// Flowing: a shear band keeps its length, so the stress along it is not the one at yield on its sides. It
/// bears tan(angle) = sin(phi) cos(psi) / (1 - sin(phi) sin(psi)) (Davis 1968, *Theories of plasticity and
/// the failure of soil masses*; Drescher & Detournay 1993), phi and psi being those of plane strain: sin phi
/// with no dilatancy, tan phi with associated flow.
inline double friction_cone(int d, double friction_angle, Friction measured_on = Friction::standing,
                            double dilatancy_angle = 0)
{
    require(friction_angle >= 0 && friction_angle < 1.5707, "the angle of friction is outside [0, pi/2)",
            "friction_cone", "Pass radians, e.g. 0.61 (35 degrees) for dry sand.");
    double const standing = detail::slope_of_cone(d, friction_angle, "friction_cone"),
                 beta = dilatancy_cone(d, dilatancy_angle);
    if (measured_on == Friction::standing) return standing;
    // Plastic strains of a band, with |dev| = 1 and none across the plane: their difference is `shear`, and
    // their sum d beta.
    double const shear = std::sqrt(std::max(d == 2 ? 2 : 2 - 3 * beta * beta, 0.0)),
                 slope = std::tan(friction_angle), sine_of_psi = d * beta / shear;
    require(sine_of_psi < 1, "no shear band is as dilatant, where flow across its plane is excluded",
            "friction_cone", "Pass a smaller angle of dilatancy: in space less than 0.6435 (36.9 degrees).");
    double const sine = slope / (std::sqrt(1 - sine_of_psi * sine_of_psi) + slope * sine_of_psi); // of phi
    require(sine < 1,
            "no layer flows from so steep an angle: one that keeps its volume from 45 degrees at most",
            "friction_cone", "Pass a smaller angle, or Friction::standing for the angle of the strength.");
    return d == 2 ? sine / shear : 2 * sine / (3 * (shear + beta * sine));
}

/// Sand of Drucker and Prager (Klár et al. 2016, section 7): grains in contact bear shear up to a share of
/// their pressure, plus what cohesion adds. |dev tau| <= k - alpha tr tau, in which k is that of
/// Mohr–Coulomb's cohesion c: sqrt(2) c cos phi in the plane, sqrt(2/3) 6 c cos phi / (3 - sin phi) in space.
/// Tension, the mean of the principal stresses, is at most c / tan phi, which is the tip of the cone, and at
/// most the cut-off.
///
/// Flow in shear goes along the gradient of |dev tau| + beta tr tau, by strains m (n + beta I) for the
/// direction n of the deviator: with beta = 0, the default, it keeps the volume, with beta = alpha it is
/// associated. Tension opens in all directions alike. Both returns, and that to the edge in which they meet
/// (Koiter 1953; at the tip an apex: de Souza Neto, Perić & Owen 2008, section 8.3), are closed forms of the
/// trial strains. With e = |dev|, t = tr, and (e_0, t_0) on that edge:
///
/// - t - t_0 >= d beta max(e - e_0, 0): to t_0 and min(e, e_0);
///
/// - else to the cone, m = (e - e_0 + r alpha (t - t_0)) / (1 + d alpha beta r), r = (d lambda + 2 mu) / 2
/// mu.
///
/// The volume that grains gain while loose, beyond the edge, is stored, and taken back before they touch
/// again (Tampubolon et al. 2017, section 4.3.4): sand would otherwise swell with every landing. The volume
/// that they gain by dilatancy, while they touch, stays, and has no bound since there is no critical state:
/// use small angles, or short flows. Parted grains with cohesion keep pulling until the stored volume is
/// taken back.
template <class SpaceType>
struct DruckerPragerFlow
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<LooseVolume>;
    static constexpr auto name = "sand";
    static constexpr Number default_density = 1600;
    static Lame<Number> usual_elasticity() { return lame<Number>(1e6, 0.3); }
    template <class Law>
    static constexpr bool supports = std::is_same_v<Law, HenckyLaw>;

    Number cone =
        Number(friction_cone(Space::dimension, 0.6108652381980153)); ///< alpha; here phi is 35 degrees
    Number dilatancy = 0; ///< beta, from 0 to alpha: see dilatancy_cone
    Number cohesion = 0;  ///< c of Mohr–Coulomb, at the phi that stands [Pa]
    Number tension_cutoff =
        std::numeric_limits<Number>::max(); ///< the most mean tension [Pa]; here the tip's

    void for_each_parameter(auto const& use) const
    {
        use("cone", cone);
        use("dilatancy", dilatancy);
        use("cohesion", cohesion);
        use("tension_cutoff", tension_cutoff);
    }

    void validate(Lame<Number> const& elasticity) const
    {
        require(cone >= 0 && is_finite(cone), "the slope of the cone is not a finite number, 0 or above",
                name, "Pass friction_cone(dimension, angle).");
        // with more, flow would release energy: it dissipates (k - (alpha - beta) tr tau) m
        require(dilatancy >= 0 && dilatancy <= cone * (1 + 8 * std::numeric_limits<Number>::epsilon()),
                "the slope of the dilatancy is not between 0 and that of the cone", name,
                "Pass dilatancy_cone(dimension, angle), the angle no larger than that of friction; 0 keeps "
                "the volume.");
        require(cohesion >= 0 && is_finite(cohesion), "the cohesion is not a finite number, 0 or above", name,
                "Pass Pa, e.g. 1e3 for moist sand, 0 for dry sand.");
        require(tension_cutoff >= 0 && is_finite(tension_cutoff),
                "the cut-off of tension is not a finite number, 0 or above", name,
                "Pass Pa, e.g. 0 for no tension; left out, the tip of the cone limits it.");
        if (!(cohesion > 0)) return;
        require(sine_of_friction() < 1,
                "a cone so steep is that of no angle of friction, to which cohesion belongs", name,
                "Pass friction_cone(dimension, angle), or no cohesion.");
        // beyond a stretch of e Hencky's law is unstable, and strains carry rounding of the size of this one
        require(edge_tension() <= Number(Space::dimension) * elasticity.lambda + 2 * elasticity.mu,
                "the tension that the cohesion bears would stretch by more than e", name,
                "Pass less cohesion, a tension_cutoff [Pa], or stiffer moduli.");
    }

    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const& moduli,
                                               Particle& state, Real) const
    {
        Real& loose = state[LooseVolume{}];
        Real const two_mu = Real(2) * moduli.mu, expansion = Real(Number(d)) * moduli.lambda + two_mu;
        Real pulled(0), held(0); // the edge: t_0 / d and e_0
        if (cohesion > 0) {
            Number const tension = edge_tension();
            pulled = Real(tension) / expansion;
            held = Real(max(intercept() - Number(d) * cone * tension, Number(0))) / two_mu;
        }
        Real const shift = loose * Real(Number(1.0 / d)) - pulled;
        Vector<Real, d> strains;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) strains[i] = trial[i] + shift;
        Deviator<Real, d> const deviator(strains);
        Real const excess = deviator.norm - held;
        Real multiplier = excess + expansion / two_mu * deviator.trace * Real(cone), opening(0);
        if (dilatancy > 0) {
            Real const swelling{Number(Space::dimension) * dilatancy};
            multiplier = multiplier / (Real(1) + swelling * Real(cone) * (expansion / two_mu));
            opening = swelling * max(excess, Real(0));
        }
        Mask<Real> const parted = !(deviator.trace < opening); // beyond the edge or the tip
        Mask<Real> const slides = (!parted) & (multiplier > Real(0));
        Real const sheared = select(slides, multiplier, Real(0)), growth = sheared * Real(dilatancy),
                   shrink = sheared / select(slides, deviator.norm, Real(1));
        Real share(0); // of the deviator that parted grains bear
        if (cohesion > 0)
            share = min(held / select(deviator.norm > Real(0), deviator.norm, Real(1)), Real(1));

        PlasticFlow<Real, d> plastic;
        plastic.flowed = parted | slides | (loose > Real(0));
        Real closed = loose;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            Real const touching = strains[i] - deviator.part[i] * shrink - growth;
            Real const left =
                select(parted, cohesion > 0 ? deviator.part[i] * share : Real(0), touching) + pulled;
            plastic.strains[i] = select(plastic.flowed, left, trial[i]);
            closed += trial[i] - plastic.strains[i];
        }
        loose = max(closed - growth * Real(Number(d)), Real(0));
        plastic.hardening = Real(1);
        plastic.capped = no_lanes<Real>();
        return plastic;
    }

private:
    /// sin phi of the standing angle that has this cone.
    FIRN_HOST_DEVICE Number sine_of_friction() const
    {
        if constexpr (Space::dimension == 2)
            return Number(1.41421356237309504880) * cone;
        else
            return 3 * cone / (Number(1.63299316185545206546) + cone); // sqrt(8/3)
    }
    /// k [Pa]: |dev tau| at no pressure.
    FIRN_HOST_DEVICE Number intercept() const
    {
        Number const s = sine_of_friction(), cosine = sqrt(max(1 - s * s, Number(0)));
        constexpr auto root = Number(Space::dimension == 2 ? 1.41421356237309504880 : 4.89897948556635619639);
        return root * cohesion * (Space::dimension == 2 ? cosine : cosine / (3 - s)); // sqrt(2), 6 sqrt(2/3)
    }
    /// The most mean tension [Pa]: of the cone's tip, or of the cut-off.
    FIRN_HOST_DEVICE Number edge_tension() const
    {
        Number const k = intercept(), slope = Number(Space::dimension) * cone;
        return slope * tension_cutoff < k ? tension_cutoff : k / slope;
    }
};

/// Sand, dry unless it has cohesion: Hencky's law and Drucker and Prager's cone.
template <class Space>
using Sand = Elastoplastic<HenckyLaw, DruckerPragerFlow<Space>>;

} // namespace firn
