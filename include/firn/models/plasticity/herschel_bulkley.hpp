// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/models/elasticity/split_neo_hookean.hpp>
#include <firn/models/plasticity/isochoric.hpp>

namespace firn
{

/// The yield-stress fluid of Herschel and Bulkley (Yue et al. 2015, section 3): foam, cream, mud. Beyond the
/// yield stress it flows at a rate d_p with |dev tau| = sqrt(2/3) yield_stress + consistency |d_p|^power, and
/// keeps its volume; elastic shear relaxes into flow, which needs no short steps.
///
/// For a fluid whose shear stress is tau_Y + K (shear rate)^power pass yield_stress = sqrt(3) tau_Y and
/// consistency = 2^((1 + power) / 2) K.
template <class SpaceType>
struct HerschelBulkleyFlow
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<>;
    static constexpr auto name = "herschel_bulkley";
    static constexpr Number default_density = 1000;
    static Lame<Number> usual_elasticity() { return lame<Number>(1e4, 0.45); }
    template <class Law>
    static constexpr bool supports = std::is_same_v<Law, SplitNeoHookeanLaw>;

    Number yield_stress = 30; ///< in uniaxial tension, slowly [Pa]
    Number consistency = 30;  ///< eta [Pa s^power]
    Number power = 1;         ///< h: below 1 the faster, the thinner

    void for_each_parameter(auto const& use) const
    {
        use("yield_stress", yield_stress);
        use("consistency", consistency);
        use("power", power);
    }

    void validate() const
    {
        require(yield_stress >= 0 && is_finite(yield_stress),
                "the yield stress is not a finite number, 0 or above", name, "Pass Pa.");
        require(consistency > 0 && is_finite(consistency), "the consistency is not a finite number above 0",
                name, "Pass Pa s^power; what flows at once is VonMises.");
        require(is_number(power) && power > 0.05 && power <= 1, "the power is outside (0.05, 1]", name,
                "Pass 1 for a Bingham fluid, less for one that thins; this model has none that thickens.");
    }

    template <Lane Real, int d, class Particle>
    FIRN_HOST_DEVICE PlasticFlow<Real, d> flow(Vector<Real, d> const& trial, Lame<Real> const& moduli,
                                               Particle&, Real dt) const
    {
        Deviator<Real, d> const b(squares_less_one<Real, d>(trial));
        Mask<Real> const upright = !SplitNeoHookeanLaw::inverted<Real, d>(trial);
        Real const J = Real(1) + select(upright, volume_change<Real, d>(trial), Real(0));
        Real const root = root_of_volume<d>(J);
        Real const shear = moduli.mu / (root * root);
        Real const stress = shear * b.norm;
        constexpr double of_uniaxial = 0.81649658092772603273; // sqrt(2/3)
        Real const excess = stress - Real(Number(of_uniaxial) * yield_stress);

        PlasticFlow<Real, d> plastic;
        plastic.flowed = upright & (dt > Real(0)) & (excess > Real(0));
        // 2 mu tr b / d, the stress that relaxes per strain that flows (Simo & Hughes 1998, box 9.1), over
        // the step
        Real const relaxation = (Real(2) + Real(Number(2.0 / d)) * b.trace) * shear * dt;
        Real const left =
            overstress(select(plastic.flowed, excess, Real(1)), select(plastic.flowed, relaxation, Real(1)));
        Real const share = select(
            plastic.flowed, (stress - excess + left) / select(plastic.flowed, stress, Real(1)), Real(1));
        Vector<Real, d> const relaxed = relaxed_extensions<Real, d>(b, share, J);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) plastic.strains[i] = select(plastic.flowed, relaxed[i], trial[i]);
        plastic.hardening = Real(1);
        plastic.capped = no_lanes<Real>();
        return plastic;
    }

private:
    /// The stress x [Pa] beyond yield that is left after a step: x + relaxation (x / eta)^(1/h) = excess.
    ///
    /// The left side is convex. The root is at most `excess`, at most the root of the power alone, and at
    /// least half of the smaller one: Newton's iteration descends to it from there.
    template <Lane Real>
    FIRN_HOST_DEVICE Real overstress(Real excess, Real relaxation) const
    {
        Real const eta(consistency), inverse_power(Number(1) / power);
        if (exactly_equal(power, Number(1)))
            return excess / (Real(1) + relaxation / eta); // the same in all lanes
        Real const enough(Number(1e-3) *
                          std::sqrt(std::numeric_limits<Number>::epsilon())); // of the last step
        Real x = min(excess, eta * exp(Real(power) * log(excess / relaxation)));
        Mask<Real> far = x > Real(0);
        for (int i = 0; i < 8; ++i) {
            Real const flows = relaxation * exp(inverse_power * log(x / eta));
            Real const step = (x + flows - excess) / (Real(1) + inverse_power * flows / x);
            x = select(far & (step > Real(0)), x - step, x);
            far = far & (step > enough * x);
            if (!any(far)) break;
        }
        return x;
    }
};

/// Foam, cream and mud: split neo-Hookean elasticity that flows by Herschel and Bulkley.
template <class Space>
using HerschelBulkley = Elastoplastic<SplitNeoHookeanLaw, HerschelBulkleyFlow<Space>>;

} // namespace firn
