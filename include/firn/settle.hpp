// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/damping.hpp>
#include <firn/time_stepping/report.hpp>

#include <algorithm>

namespace firn
{

/// How a scene is brought to rest.
struct Settling
{
    double rate = 0;     ///< of Damping [1/s]: about twice the lowest frequency of the scene [rad/s]
    double share = 1e-6; ///< of the largest kinetic energy so far, at which the scene counts as at rest
    double longest = 0;  ///< the most time that may pass in the scene [s]
    double between = 0;  ///< the time between two looks at the energy [s]; 0: a tenth of 1 / rate

    /// Throws an Error if a number is out of its range.
    void validate() const
    {
        auto const keep = [](bool good, char const* what, char const* remedy) {
            require(good, what, "Settling", remedy);
        };
        keep(is_finite(rate) && rate > 0, "the rate of damping is not a finite number above 0",
             "Pass 1/s, e.g. twice the lowest frequency in rad/s: for a column of height H on its base, pi c "
             "/ H.");
        keep(is_finite(share) && share > 0 && share < 1, "the share of the kinetic energy is outside (0, 1)",
             "Pass e.g. 1e-6.");
        keep(is_finite(longest) && longest > 0, "the longest time is not a finite number above 0",
             "Pass seconds, e.g. 50 / rate.");
        keep(is_finite(between) && between >= 0,
             "the time between two looks is not a finite number, 0 or above",
             "Pass seconds, or 0 for a tenth of 1 / rate.");
    }
};

/// What settle() did.
struct SettleReport
{
    bool is_at_rest = false;    ///< the share was reached in time
    double kinetic = 0;         ///< the energy at the end [J; in two dimensions J per metre of depth]
    double largest_kinetic = 0; ///< the largest at a look [J]
    AdvanceReport steps{};      ///< of all calls of advance()
};

/// Brings a scene to rest under its loads by damped explicit steps, from which it goes on undamped: the state
/// in which a slope, a column or a dam stands before something happens to it. The solver's time passes
/// meanwhile.
///
/// The scene is at rest when its kinetic energy is `share` of the largest one that a look found. Then, and
/// when `longest` is over, the velocities are what is left of them.
template <class Solver, class... Effects>
SettleReport settle(Solver& solver, Settling const& how, Effects const&... effects)
{
    how.validate();
    double const piece = how.between > 0 ? how.between : 0.1 / how.rate, end = solver.time() + how.longest;
    SettleReport report;
    while (!report.is_at_rest && solver.time() < end) {
        double const left = end - solver.time();
        // no sliver at the end, which would be a step of its own
        report.steps.merge(solver.advance(left < 1.5 * piece ? left : piece, effects..., Damping{how.rate}));
        report.kinetic = solver.energy().kinetic;
        report.largest_kinetic = std::max(report.largest_kinetic, report.kinetic);
        report.is_at_rest = report.kinetic <= how.share * report.largest_kinetic;
    }
    return report;
}

} // namespace firn
