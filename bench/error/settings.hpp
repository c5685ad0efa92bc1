// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>
#include <map>
#include <string>
#include <vector>

// What speed_against_error measures: each problem, solved with a setting, is a row.
namespace firn::bench
{

/// One combination of all that can be chosen.
struct Setting
{
    std::string problem, kernel, transfer, precision;
    double cfl_fraction = 0.9; ///< share of the limit of an isolated particle: StepControl::wave
    int cells = 0;             ///< per length of the problem
    int per_cell = 2;          ///< particles per cell and axis
    /// What acts, where a problem is solved in two ways: obstacles on nodes or at their surface; or settle,
    /// an implicit solve in place of damped explicit steps.
    std::string acts_on = "";
};

/// What it cost, and how far off it was.
struct Row
{
    std::string model;
    int dimensions = 2;
    double error = std::numeric_limits<double>::quiet_NaN();
    double seconds = 0;     ///< of the time loop: the median of all runs
    double spread = 0;      ///< half the range of the middle half of them, over the median
    double cpu_seconds = 0; ///< the least processor time of a run, all threads together
    int runs = 0;
    std::uint64_t steps = 0, rejected = 0;
    double particle_steps = 0; ///< rejected ones included
    std::size_t bytes_per_particle = 0;
    std::string status; ///< ok, or the failure
    /// The energy lost, relative to the energy at the start, where a problem measures it.
    double energy_lost = std::numeric_limits<double>::quiet_NaN();
};

/// How long a setting is measured.
struct Patience
{
    int runs = 6;         ///< the first of which only warms up, if there are others
    double least = 0.02;  ///< there are more runs until all of them together took so long [s]
    double seconds = 0.5; ///< of all runs together, at which there is no further one
    int threads = 1;

    /// Whether there is one more run after so many, which took so long together [s].
    bool asks_for_more(int so_many, double so_long) const
    {
        return so_long < seconds && (so_many < runs || so_long < least);
    }
};

using Measure = std::function<Row(Setting const&, Patience const&)>;
/// What can be measured, by problem/kernel/transfer/precision, and behind these Setting::acts_on if it says
/// something.
using Offer = std::map<std::string, Measure>;

inline std::string name_of(Setting const& setting)
{
    return setting.problem + "/" + setting.kernel + "/" + setting.transfer + "/" + setting.precision +
           (setting.acts_on.empty() ? "" : "/" + setting.acts_on);
}

/// Offers all problems with a kernel and a transfer, in both precisions; one translation unit each.
template <class Kernel, class Transfer>
void offer(Offer& offers);

/// The machine, in a sentence.
std::string hardware(int threads);

/// What the backend is called in a row.
std::string backend_name();

} // namespace firn::bench
