// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>

#include <array>
#include <cstddef>

namespace firn
{

/// The depths [m] that obstacles may leave to lanes of particles in this step, by the numbers of obstacles.
///
/// The first `obstacles` of them have a place each. Those behind them are of groups, whose number is known at
/// run time: there is room for some in which particles are deep. Where more are, those for which there was
/// no room wait for the next step once they have pushed in the first pass.
template <Lane Real, int obstacles, bool has_groups>
class SparedDepths
{
    using Number = ScalarOf<Real>;
    static constexpr int room = has_groups ? 16 : 0;

public:
    FIRN_HOST_DEVICE SparedDepths()
    {
        for (Real& depth : depths_) depth = Real(0);
    }

    FIRN_HOST_DEVICE void set(int i, Real const& depth)
    {
        if constexpr (has_groups)
            if (i >= obstacles) {
                if (!any(depth > Real(0))) return;
                is_short_ = is_short_ || count_ == room;
                if (is_short_) return;
                numbers_[std::size_t(count_)] = i;
                of_groups_[std::size_t(count_++)] = depth;
                return;
            }
        depths_[std::size_t(i)] = depth;
    }

    /// What an obstacle may leave of a depth [m]; `at_once` is the most by which it pushes in a step.
    FIRN_HOST_DEVICE Real of(int i, [[maybe_unused]] Real const& depth, [[maybe_unused]] Number at_once) const
    {
        if constexpr (has_groups)
            if (i >= obstacles) {
                for (int k = 0; k < count_; ++k)
                    if (numbers_[std::size_t(k)] == i) return of_groups_[std::size_t(k)];
                return is_short_ ? select(depth > Real(at_once), depth, Real(0)) : Real(0);
            }
        return depths_[std::size_t(i)];
    }

private:
    std::array<Real, std::size_t(obstacles)> depths_;
    std::array<int, std::size_t(room)> numbers_;
    std::array<Real, std::size_t(room)> of_groups_;
    int count_ = 0;
    bool is_short_ = false;
};

} // namespace firn
