// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/math/inverse.hpp>
#include <firn/models/elasticity/fixed_corotated.hpp>

#include <cmath>
#include <limits>
#include <string>

namespace firn
{

/// The plasticity of snow (Stomakhin et al. 2013, sections 5 to 7): stretches yield outside [1 -
/// critical_compression, 1 + critical_stretch], and moduli harden by e^(xi (1 - J_P)). Stores J_P = det F_P,
/// since the stress depends on F_P through its determinant alone.
template <class SpaceType>
struct SnowFlow
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<PlasticVolumeRatio>;
    static constexpr auto name = "snow";
    static constexpr Number default_density = 400;
    static Lame<Number> usual_elasticity() { return lame<Number>(1.4e5, 0.2); }
    template <class Law>
    static constexpr bool supports = std::is_base_of_v<MeasuredByExtension, Law>; // stretches yield

    Number critical_compression = Number(2.5e-2); ///< theta_c
    Number critical_stretch = Number(7.5e-3);     ///< theta_s
    Number hardening = 10;                        ///< xi
    /// The range in which J_P hardens or softens. Outside it the moduli stay as they are and the particle
    /// counts as capped, since e^(xi (1 - J_P)) would otherwise stop the time step (54.6 at 0.6 and xi = 10).
    Number smallest_plastic_ratio = Number(0.6);
    Number largest_plastic_ratio = 20;

    void for_each_parameter(auto const& use) const
    {
        use("critical_compression", critical_compression);
        use("critical_stretch", critical_stretch);
        use("hardening", hardening);
        use("smallest_plastic_ratio", smallest_plastic_ratio);
        use("largest_plastic_ratio", largest_plastic_ratio);
    }

    void validate() const
    {
        require(is_number(critical_compression) && critical_compression >= 0 && critical_compression < 1,
                "the critical compression is outside [0, 1)", name, "Pass theta_c, e.g. 2.5e-2.");
        require(critical_stretch >= 0 && is_finite(critical_stretch),
                "the critical stretch is not a finite number, 0 or above", name,
                "Pass theta_s, e.g. 7.5e-3.");
        require(hardening >= 0 && is_finite(hardening),
                "the hardening coefficient is not a finite number, 0 or above", name, "Pass xi, e.g. 10.");
        // flow() keeps J_P between a hundredth of the one and a hundred times the other, which are still
        // numbers
        require(is_between(Number(1e-6), smallest_plastic_ratio, 1) &&
                    is_between(1, largest_plastic_ratio, Number(1e6)),
                "the caps of J_P do not enclose 1, or are outside [1e-6, 1e6]", name,
                "Pass 1e-6 <= smallest <= 1 <= largest <= 1e6, e.g. 0.6 and 20.");
        // half of the range of exponents is left to the moduli
        require(double(hardening) * (1 - double(smallest_plastic_ratio)) <=
                    0.5 * std::log(double(std::numeric_limits<Number>::max())),
                "moduli that have hardened up to the cap of J_P are beyond all numbers", name,
                "Pass a smaller xi, or a larger smallest J_P, e.g. 10 and 0.6: moduli grow to 54.6 times.");
    }

    /// What is wrong with an uploaded or restored state: an inverted one would be clamped to one that is not,
    /// and J_P would take its sign; and stretches may be too far apart.
    template <class Particle>
    std::string objection(Particle const& state) const
    {
        constexpr int d = Space::dimension;
        double const J = 1 + double(volume_change<Number, d>(state[DisplacementGradient{}]));
        if (!is_number(J) || J <= 0)
            return "an elastic volume ratio of " + std::to_string(J) + " is not above 0";
        // flow is subtracted from F: of stretches too far apart only rounding would be left
        Matrix<double, d> const F =
            Matrix<double, d>::Identity() + state[DisplacementGradient{}].template cast<double>();
        double const apart = F.norm() * inverse<double, d>(F).norm();
        bool const borne =
            is_finite(apart) && apart * 64 * double(std::numeric_limits<Number>::epsilon()) <= 1;
        return borne ? std::string() : "elastic stretches are further apart than the scene's numbers bear";
    }

    /// Clamps the stretches (eqs. 8 and 9 with the clamp of section 7).
    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const&,
                                               Particle& state, Real) const
    {
        PlasticFlow<Real, d> plastic;
        plastic.flowed = no_lanes<Real>();
        Real trial_volume(1), elastic_volume(1);
        Real const low(-critical_compression), high(critical_stretch);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            plastic.strains[i] = min(max(trial[i], low), high);
            trial_volume = trial_volume * (Real(1) + trial[i]);
            elastic_volume = elastic_volume * (Real(1) + plastic.strains[i]);
            plastic.flowed = plastic.flowed | !exactly_equal(plastic.strains[i], trial[i]);
        }
        // J_P = det F / det F_E is tracked to a hundred times beyond the caps, so that it may come back, but
        // not without bound.
        Real& J_P = state[PlasticVolumeRatio{}];
        Real const far(Number(100));
        J_P = min(max(J_P * (trial_volume / elastic_volume), Real(smallest_plastic_ratio) / far),
                  Real(largest_plastic_ratio) * far);
        plastic.hardening = hardening_of<Real>(state);
        plastic.capped = !exactly_equal(within<Real>(J_P), J_P);
        return plastic;
    }

    /// e^(xi (1 - J_P)), by which the moduli have hardened.
    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Real hardening_of(Particle const& state) const
    {
        return exp(Real(hardening) * (Real(1) - within<Real>(state[PlasticVolumeRatio{}])));
    }

private:
    /// J_P between its caps.
    template <Lane Real>
    FIRN_HOST_DEVICE Real within(Real const& J_P) const
    {
        return min(max(J_P, Real(smallest_plastic_ratio)), Real(largest_plastic_ratio));
    }
};

/// Snow of Stomakhin et al. 2013: fixed corotated elasticity with stretches that yield and moduli that
/// harden.
template <class Space>
using Snow = Elastoplastic<FixedCorotatedLaw, SnowFlow<Space>>;

} // namespace firn
