// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/failure_cause.hpp>
#include <firn/core/host_device.hpp>
#include <firn/effects/actions.hpp>
#include <firn/time_stepping/step_controller.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

namespace firn
{

/// The state of a batch of steps after a step, or where one failed.
struct StepLog
{
    TimeState time_state;
    std::uint64_t failed = 0;                ///< failed particles in the step; if any, it changed nothing
    FailureCause cause = FailureCause::none; ///< of the first of them
    int material = 0;                        ///< the material of that particle
    std::uint32_t particle = 0;              ///< its row in the material's table
};

/// What one step of a batch did.
template <int obstacles, int materials>
struct StepRecord
{
    double dt = 0;     ///< [s]
    double forces = 0; ///< for how long forces acted [s]
    double stable = 0; ///< the bound before it [s]
    StepLimit limit{}; ///< what bounded dt
    std::array<std::uint64_t, std::size_t(materials)>
        capped{};                   ///< particles whose model is at a cap, of each material
    Reactions<obstacles> reactions; ///< impulses per mass unit
};

/// One entry of the log of a batch of steps. The log is written where steps run, and the host reads it when
/// they are done. Entry 0 is the state before the first step, entry i belongs to the i-th step, and one more
/// entry without failures follows. Every step writes its own entry, so that a repeated step simply overwrites
/// it.
template <int obstacles, int materials>
struct StepEntry
{
    StepLog after;                           ///< the state after the step
    StepRecord<obstacles, materials> record; ///< what it did, if it was taken
    std::uint32_t taken = 0;                 ///< 1 if the step was taken, 0 if it failed or was not reached

    /// How many entries a log of so many steps has.
    static std::size_t count(std::size_t steps) { return steps + 2; }
};

} // namespace firn
