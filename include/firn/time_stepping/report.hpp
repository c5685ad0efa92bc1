// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/step_error.hpp>
#include <firn/effects/effect.hpp>
#include <firn/time_stepping/stable_time_step.hpp>

#include <algorithm>
#include <cstdint>
#include <limits>
#include <vector>

namespace firn
{

/// What one step did.
struct StepReport
{
    double dt = 0;              ///< [s]
    double time_of_forces = 0;  ///< for how long stresses and gravity acted [s]: see TimeStepController
    double stable_dt = 0;       ///< the bound before the step [s]
    bool beyond_stable = false; ///< a warning: dt was larger than stable_dt
    std::uint64_t capped = 0;   ///< particles whose model is at a cap
    std::vector<std::uint64_t> capped_of; ///< the same of each material, in their order
    std::vector<Reaction> reactions;      ///< one per obstacle, in the order of the arguments
    std::vector<StepFailure> isolated;    ///< particles removed from the scene, and why: Solver::quarantine
};

/// What ended a call of Solver::advance before its duration was over.
enum class StoppedBy
{
    nothing, ///< the duration is over, but for what is shorter than a step where steps are not cut
    seconds, ///< Budget::seconds
    steps,   ///< Budget::steps
    cancel,  ///< Budget::cancelled
};

/// What a call of Solver::advance did.
struct AdvanceReport
{
    /// How many steps were taken.
    std::uint64_t substeps = 0;
    std::uint64_t rejected = 0; ///< failed attempts that were repeated with half the step
    double smallest_dt = std::numeric_limits<double>::infinity(); ///< [s]
    double largest_dt = 0;                                        ///< [s]
    double time_of_forces = 0; ///< for how long stresses and gravity acted [s]: see TimeStepController
    double left = 0; ///< of the duration, what was not simulated [s]: 0 unless there was a budget or an error
    StoppedBy stopped_by = StoppedBy::nothing;                ///< why
    std::array<std::uint64_t, step_limit_count> limited_by{}; ///< substeps by what bounded them: a StepLimit
    std::uint64_t capped = 0;             ///< the most particles at a cap of their model in any substep
    std::vector<std::uint64_t> capped_of; ///< the same of each material, in their order
    std::uint64_t lost = 0;            ///< particles that vanished: always 0, as a lost particle is an Error
    std::vector<Reaction> reactions;   ///< one per obstacle, summed over the substeps
    std::vector<StepFailure> isolated; ///< particles removed from the scene, and why: Solver::quarantine

    /// What bounded most substeps.
    StepLimit usual_limit() const
    {
        int most = 0;
        for (int i = 1; i < step_limit_count; ++i)
            if (limited_by[std::size_t(i)] > limited_by[std::size_t(most)]) most = i;
        return static_cast<StepLimit>(most);
    }

    /// Adds the report of a step that was bounded by `limit`.
    void add(StepReport const& step, StepLimit limit)
    {
        ++substeps;
        ++limited_by[std::size_t(static_cast<int>(limit))];
        smallest_dt = std::min(smallest_dt, step.dt);
        largest_dt = std::max(largest_dt, step.dt);
        time_of_forces += step.time_of_forces;
        capped = std::max(capped, step.capped);
        add_capped(step.capped_of);
        add_reactions(step.reactions);
        add_isolated(step.isolated);
    }

    /// Adds the report of the call after it, whose `left` and `stopped_by` are those of both.
    void merge(AdvanceReport const& other)
    {
        substeps += other.substeps;
        rejected += other.rejected;
        for (int i = 0; i < step_limit_count; ++i)
            limited_by[std::size_t(i)] += other.limited_by[std::size_t(i)];
        smallest_dt = std::min(smallest_dt, other.smallest_dt);
        largest_dt = std::max(largest_dt, other.largest_dt);
        time_of_forces += other.time_of_forces;
        left = other.left;
        stopped_by = other.stopped_by;
        capped = std::max(capped, other.capped);
        lost += other.lost;
        add_capped(other.capped_of);
        add_reactions(other.reactions);
        add_isolated(other.isolated);
    }

private:
    void add_capped(std::vector<std::uint64_t> const& more)
    {
        if (capped_of.size() < more.size()) capped_of.resize(more.size());
        for (std::size_t i = 0; i < more.size(); ++i) capped_of[i] = std::max(capped_of[i], more[i]);
    }
    void add_reactions(std::vector<Reaction> const& more)
    {
        if (reactions.size() < more.size()) reactions.resize(more.size());
        for (std::size_t i = 0; i < more.size(); ++i) reactions[i] += more[i];
    }
    void add_isolated(std::vector<StepFailure> const& more)
    {
        isolated.reserve(isolated.size() + more.size());
        for (StepFailure const& one : more) isolated.push_back(one);
    }
};

} // namespace firn
