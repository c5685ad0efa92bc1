// SPDX-License-Identifier: MIT
#pragma once

#include <firn/time_stepping/report.hpp>

#include <cstddef>
#include <limits>

namespace firn
{

/// What a call of Solver::advance may spend; `Pace` keeps to it (see FullPace). The library's is Budget.
template <class T>
concept StepBudget = requires(T const budget)
{
    typename T::Pace;
    budget.validate();
};

/// The pace of a call without a budget: all steps, the last one cut to end with the duration.
struct FullPace
{
    static constexpr bool cuts_last_step() { return true; }
    static constexpr StoppedBy stopped_by() { return StoppedBy::nothing; }
    /// How many steps may come next; 0: the call ends.
    static std::size_t steps_allowed(AdvanceReport const&) { return std::numeric_limits<std::size_t>::max(); }
    /// After some steps.
    static void tell(double /*time*/, double /*end*/, AdvanceReport const&) {}
};

} // namespace firn
