// SPDX-License-Identifier: MIT
#pragma once

#include <firn/time_stepping/failures.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace firn::detail
{

/// A step that failed, or one that advances no time.
struct FailedStep
{
    StepLog log{};                        ///< a copy: later work overwrites the log
    double time = 0;                      ///< at which it began [s]
    double dt = 0;                        ///< its length [s]
    bool last = false;                    ///< it is not to be retried
    std::optional<StepFailure> failure{}; ///< of the particle known to cause it
};

/// The particles that were removed from a scene because steps failed, and how many may be in all. See
/// Solver::quarantine.
class Quarantine
{
public:
    void allow(std::size_t most) { most_ = most; }
    std::size_t most() const { return most_; }
    std::vector<StepFailure> const& isolated() const { return isolated_; }
    /// Takes particles off the list, which came back to the scene, or will not.
    void release(std::vector<std::uint32_t> const& ids)
    {
        std::erase_if(isolated_, [&](StepFailure const& lost) {
            return std::find(ids.begin(), ids.end(), lost.particle) != ids.end();
        });
    }
    /// Goes on from another list of removed particles.
    void go_on_from(std::vector<StepFailure> isolated) { isolated_ = std::move(isolated); }

    /// After a failed step, removes from the scene the particles whose own state has no stress; if there are
    /// none and the step is not to be retried, removes `step.failure` or, by default, the culprit. Adds them
    /// to `isolated`, too. Returns false and changes nothing if no particle qualifies, or if they would be
    /// too many.
    template <class Scene>
    bool isolate(Scene& scene, FailedStep const& step, std::vector<StepFailure>& isolated)
    {
        if (!has_room_for(1)) return false;
        std::vector<StepFailure> culprits;
        if (step.log.cause != FailureCause::rejected || step.last)
            culprits =
                without_stress(scene.sets, most_, step.time, step.dt); // stops at one more than allowed
        if (culprits.empty() && step.last)
            culprits.push_back(step.failure ? *step.failure
                                            : furthest_in(scene.sets, step.log, scene.values(scene.sets),
                                                          scene.lattice.cell_size, step.time, step.dt));
        if (culprits.empty() || !has_room_for(culprits.size())) return false;
        isolated_.reserve(isolated_.size() + culprits.size()); // first, so that no removal goes unreported
        isolated.reserve(isolated.size() + culprits.size());
        scene.change([&] { scene.sets.remove(culprits); });
        isolated_.insert(isolated_.end(), culprits.begin(), culprits.end());
        isolated.insert(isolated.end(), culprits.begin(), culprits.end());
        scene.grid_state.forget();
        return true;
    }

private:
    bool has_room_for(std::size_t count) const { return isolated_.size() + count <= most_; }

    std::size_t most_ = 0;
    std::vector<StepFailure> isolated_;
};

} // namespace firn::detail
