// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/finite.hpp>
#include <firn/models/elasticity/split_neo_hookean.hpp>
#include <firn/models/plasticity/isochoric.hpp>

#include <algorithm>
#include <limits>
#include <string>

namespace firn
{

/// M of the ellipse for an angle of internal friction phi [rad] at the critical state, for material that
/// bears no tension. In space 6 sin phi / (3 - sin phi): triaxial compression flows as Mohr–Coulomb does
/// (Wood 1990, *Soil Behaviour and Critical State Soil Mechanics*, section 7.2). In the plane q is the
/// difference of two principal stresses and p their mean: 2 sin phi, which is Mohr–Coulomb itself. The angle
/// is that of the strength: flow in shear keeps the volume, so a shear band in the plane bears sin phi, see
/// friction_cone.
inline double critical_slope(int d, double friction_angle)
{
    require(is_number(friction_angle) && friction_angle > 0 && friction_angle < 1.5707,
            "the angle of friction is outside (0, pi/2)", "critical_slope",
            "Pass radians, e.g. 0.52 (30 degrees).");
    require(d == 2 || d == 3, "there are two or three dimensions", "critical_slope", "Pass 2 or 3.");
    double const s = std::sin(friction_angle);
    return d == 2 ? 2 * s : 6 * s / (3 - s);
}

/// Non-associated Cam-Clay (NACC; Gaume et al. 2018, Wolper et al. 2019, section 4.2): snow, clay, and what
/// crumbles. The stress stays within the ellipse y = (1 + 2 beta) q^2 + M^2 (p + beta p0)(p - p0) <= 0 of
/// pressure p and shear q, which grows where material is compacted and shrinks where it opens.
///
/// Stores the logarithm of the volume that flow has opened since the start: alpha = start + that, p0 = kappa
/// (1e-5 + sinh(xi max(-alpha, 0))). Flow in shear keeps the volume to rounding (see relaxed_extensions).
///
/// The elastic pressure is below kappa / 2 whatever the compression, so p0 stops there: alpha goes no lower
/// than -0.481 / xi, and a particle that would counts as capped. If no pressure reached the middle of the
/// ellipse, the first flow in shear would undo all of the compaction.
template <class SpaceType>
struct CamClayFlow
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<LogPlasticVolumeRatio>;
    static constexpr auto name = "cam_clay";
    static constexpr Number default_density = 250;
    static Lame<Number> usual_elasticity() { return lame<Number>(2e6, 0.3); }
    template <class Law>
    static constexpr bool supports = std::is_same_v<Law, SplitNeoHookeanLaw>;

    Number slope = Number(critical_slope(Space::dimension, 0.5235987755982988)); ///< M; here of 30 degrees
    Number cohesion = Number(0.5); ///< beta: the share of p0 that it bears in tension
    Number hardening = 3;          ///< xi
    Number start = Number(-0.01);  ///< alpha at the start, from -0.481 / xi on; the lower, the more compacted

    void for_each_parameter(auto const& use) const
    {
        use("slope", slope);
        use("cohesion", cohesion);
        use("hardening", hardening);
        use("start", start);
    }

    void validate() const
    {
        // M of any angle is at most 3; beyond some thousands rounding leaves nothing of the ellipse
        require(is_number(slope) && slope > 0 && slope <= 1000, "the slope M is outside (0, 1000]", name,
                "Pass critical_slope(dimension, angle).");
        // flow changes p0 by a difference of pressures of beta p0, which must be more than rounding
        require(is_between(0, cohesion, 1000), "the cohesion is outside [0, 1000]", name,
                "Pass beta, e.g. 0.5; 0 for what bears no tension.");
        require(hardening >= 0 && is_finite(hardening), "the hardening is not a finite number, 0 or above",
                name, "Pass xi, e.g. 3.");
        // e^100 times as loose as at the last contact; the stored logarithm is added to it
        require(start <= 100 && is_finite(start), "alpha at the start is not a finite number, 100 or below",
                name, "Pass alpha, e.g. -0.01.");
        require(lowest_opening() <= 0,
                "alpha at the start gives a p0 above kappa / 2, which no pressure reaches", name,
                "Pass alpha from -0.481 / xi on, e.g. -0.01.");
    }

    /// What is wrong with an uploaded or restored state: a p0 that no pressure reaches.
    template <class Particle>
    std::string objection(Particle const& state) const
    {
        Number const opened = state[LogPlasticVolumeRatio{}];
        if (opened >= lowest_opening()) return {};
        return "an alpha of " + std::to_string(double(start) + double(opened)) +
               " gives a p0 above kappa / 2, which no pressure reaches";
    }

    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const& moduli,
                                               Particle& state, Real dt) const
    {
        Real& opened = state[LogPlasticVolumeRatio{}];
        Real const one(1), half(Number(0.5)), beta(cohesion), M(slope);
        Real const kappa = moduli.lambda + moduli.mu * Real(Number(2.0 / d));
        Deviator<Real, d> const b(squares_less_one<Real, d>(trial));
        Mask<Real> const upright = !SplitNeoHookeanLaw::inverted<Real, d>(trial);
        Real const volume = select(upright, volume_change<Real, d>(trial), Real(0)), J = one + volume;
        Real const root = root_of_volume<d>(J);
        Real const p = -half * kappa * volume * (J + one);
        Real const q = Real(Number(d == 2 ? 1.41421356237309504880 : 1.22474487139158904910)) * moduli.mu /
                       (root * root) * b.norm; // sqrt((6 - d) / 2) |dev tau|
        Real const p0 = preconsolidation(kappa, opened);

        // Nothing flows where dt = 0, so evaluating the stress of a state again gives the same.
        Mask<Real> const time = (dt > Real(0)) & upright;
        Mask<Real> const crushed = time & (p > p0), torn = time & (p < -beta * p0);
        Real const range = (p + beta * p0) * (p - p0), shear = one + Real(2) * beta;
        Mask<Real> const sheared = time & (!crushed) & (!torn) & (shear * q * q + M * M * range > Real(0));

        // Beyond the ends of the ellipse: to its end, without shear.
        Real const end = select(crushed, p0, -beta * p0);
        Real const J_end = volume_at(end, kappa);
        // Beyond its side: to the same pressure on it. How the ellipse changes follows from the point where
        // it meets the line from the trial state to its centre.
        Real const share = M * sqrt(max(-range, Real(0)) / shear) / select(sheared, q, one);
        Real const centre = half * (one - beta) * p0, axis = half * (one + beta) * p0, away = p - centre;
        Real const met =
            centre + away * M * axis / sqrt(select(sheared, shear * q * q + M * M * away * away, one));
        Real const J_met = volume_at(met, kappa);

        Vector<Real, d> const slid = relaxed_extensions<Real, d>(b, select(sheared, share, one), J);
        Real const isotropic = root_of_volume<d>(J_end) - one;
        PlasticFlow<Real, d> plastic;
        plastic.flowed = crushed | torn | sheared;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i)
            plastic.strains[i] = select(sheared, slid[i], select(plastic.flowed, isotropic, trial[i]));
        opened += select(plastic.flowed, log(J / select(sheared, J_met, J_end)), Real(0));
        Real const lowest(lowest_opening());
        plastic.hardening = one;
        plastic.capped = opened < lowest;
        opened = max(opened, lowest);
        return plastic;
    }

    /// p0 [Pa]: the pressure up to which it has been compacted.
    template <Lane Real>
    FIRN_HOST_DEVICE Real preconsolidation(Real kappa, Real opened) const
    {
        Real const alpha = Real(start) + opened;
        Real const growth = exp_minus_one(Real(hardening) * max(-alpha, Real(0)));
        // sinh x from e^x - 1
        return kappa * (Real(Number(1e-5)) + Real(Number(0.5)) * (growth + growth / (growth + Real(1))));
    }

private:
    /// The smallest stored logarithm: there p0 is kappa / 2 less 3e-6 of kappa, since sinh(0.4812) = 0.5 -
    /// 1.3e-5.
    FIRN_HOST_DEVICE Number lowest_opening() const
    {
        constexpr Number without_end = std::numeric_limits<Number>::lowest();
        return hardening > 0 ? Number(-0.4812) / hardening - start : without_end;
    }

    /// The elastic volume ratio at a pressure [Pa]: p = kappa/2 (1 - J^2), always below kappa/2.
    template <Lane Real>
    FIRN_HOST_DEVICE static Real volume_at(Real pressure, Real kappa)
    {
        return sqrt(max(Real(1) - Real(2) * pressure / kappa, Real(Number(1e-6))));
    }
};

/// Clay and snow that is compacted, sheared and torn: split neo-Hookean elasticity and Cam-Clay.
template <class Space>
using CamClay = Elastoplastic<SplitNeoHookeanLaw, CamClayFlow<Space>>;

} // namespace firn
