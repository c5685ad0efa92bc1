// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/damping.hpp>
#include <firn/effects/local_damping.hpp>
#include <firn/time_stepping/report.hpp>

#include <algorithm>
#include <type_traits>

namespace firn
{

/// How a scene is brought to rest.
struct Settling
{
    /// Of Damping [1/s]: about twice the lowest angular frequency of the scene [rad/s]. With less the scene
    /// swings, and with more it creeps: both take longer. Where a LocalDamping damps instead, this is the
    /// scene's scale of time alone.
    double rate = 0;
    double share = 1e-6; ///< of the largest kinetic energy so far, below which the scene counts as at rest
    double longest = 0;  ///< the most time that may pass in the scene [s]; rest takes 5 / rate at least
    double between = 0;  ///< the time between two looks at the energy [s]; 0: a tenth of 1 / rate
    /// A kinetic energy below which the scene counts as at rest, whatever the share [J; in two dimensions J
    /// per metre of depth]: for a scene that may be at rest already.
    double least = 0;

    /// Throws an Error if a number is out of its range.
    void validate() const
    {
        auto const keep = [](bool good, char const* what, char const* remedy) {
            require(good, what, "Settling", remedy);
        };
        keep(is_finite(rate) && rate > 0, "the rate of damping is not a finite number above 0",
             "Pass 1/s, e.g. twice the lowest frequency in rad/s: for a column of height H on its base, pi c "
             "/ H. With a LocalDamping any guess of it will do.");
        keep(is_finite(share) && share > 0 && share < 1, "the share of the kinetic energy is outside (0, 1)",
             "Pass e.g. 1e-6.");
        keep(is_finite(longest) && longest > 0, "the longest time is not a finite number above 0",
             "Pass seconds, e.g. 50 / rate.");
        keep(is_finite(between) && between >= 0,
             "the time between two looks is not a finite number, 0 or above",
             "Pass seconds, or 0 for a tenth of 1 / rate.");
        keep(is_finite(least) && least >= 0, "the least kinetic energy is not a finite number, 0 or above",
             "Pass J, or 0.");
    }
};

/// What settle() did.
struct SettleReport
{
    bool is_at_rest = false; ///< it stayed below the share in time
    double kinetic = 0; ///< the largest while it stayed below [J; in two dimensions J per metre of depth]
    double largest_kinetic = 0; ///< the largest of all looks, in the same unit
    AdvanceReport steps{};      ///< of all calls of advance()
};

/// Brings a scene to rest under its loads by damped explicit steps, from which it goes on undamped: the state
/// in which a slope, a column or a dam stands before something happens to it. The solver's time passes
/// meanwhile.
///
/// The scene is at rest when its kinetic energy stayed below `share` of the largest one that a look found, or
/// below `least`, for 5 / rate: one look alone may fall on a turning point of a swing. Velocities are not set
/// to 0 at the end. Damping acts before obstacles, so what they prescribe holds. If a LocalDamping is among
/// the effects, that is what damps.
template <class Solver, class... Effects>
SettleReport settle(Solver& solver, Settling const& how, Effects const&... effects)
{
    how.validate();
    double const piece = how.between > 0 ? how.between : 0.1 / how.rate, end = solver.time() + how.longest;
    require(end > solver.time() && solver.time() + piece > solver.time(),
            "the times are lost to rounding beside the solver's own", "settle", "Pass longer ones.");
    auto const damped = [&](double duration) {
        if constexpr ((false || ... || std::is_same_v<Effects, LocalDamping>))
            return solver.advance(duration, effects...);
        else
            return solver.advance(duration, Damping{how.rate}, effects...);
    };
    SettleReport report;
    double calm_since = solver.time(), calm = 0; // the largest energy since then
    while (!report.is_at_rest && solver.time() < end) {
        double const left = end - solver.time();
        // no sliver at the end, which would be a step of its own
        report.steps.merge(damped(left < 1.5 * piece ? left : piece));
        double const kinetic = solver.totals().kinetic_energy;
        report.largest_kinetic = std::max(report.largest_kinetic, kinetic);
        if (kinetic > std::max(how.share * report.largest_kinetic, how.least)) {
            calm_since = solver.time();
            calm = 0;
            report.kinetic = kinetic;
        }
        else
            report.kinetic = calm = std::max(calm, kinetic);
        report.is_at_rest = solver.time() - calm_since >= 5 / how.rate || !(report.largest_kinetic > 0);
    }
    return report;
}

} // namespace firn
