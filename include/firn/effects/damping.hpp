// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/effect.hpp>

#include <cmath>

namespace firn
{

/// Damps all velocities by e^(-rate t), so that a scene comes to rest: a force of -rate times the momentum,
/// for loading a scene and not for its physics. An oscillation of w [rad/s] is damped critically at a rate of
/// 2 w. See settle() in firn/settle.hpp.
struct Damping
{
    double rate = 0; ///< [1/s]

    void validate() const
    {
        require(is_finite(rate) && rate >= 0, "the rate of damping is not a finite number, 0 or above",
                "Damping", "Pass 1/s, e.g. twice the lowest frequency in rad/s.");
    }

    /// Of one step: the factor of every velocity.
    template <class Number>
    struct Action
    {
        Number factor;

        template <Lane Real, int d>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(LaneNode<Real, d> const&,
                                                 Vector<Real, d> const& velocity) const
        {
            return velocity * Real(factor);
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number> over(Interval const& interval) const
    {
        return {static_cast<Number>(std::exp(-rate * interval.length()))};
    }
};

} // namespace firn
