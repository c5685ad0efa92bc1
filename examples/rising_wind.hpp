// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

struct RisingWind // along x; its drag grows with height, and is exact for steps of any length
{
    double speed = 10, rate = 0.5; // of the wind [m/s]; of the drag one metre above y = 0 [1/s]

    void validate() const
    {
        firn::require(firn::is_finite(speed) && rate >= 0 && rate < 1e15,
                      "the speed is not finite, or the rate is outside [0, 1e15)", "RisingWind",
                      "Pass m/s and 1/s.");
    }

    struct Action
    {
        double speed, rate;

        template <firn::Lane Real, int d>
        FIRN_HOST_DEVICE firn::Vector<Real, d> on_node(firn::LaneNode<Real, d> const& node,
                                                       firn::Vector<Real, d> const& velocity) const
        {
            using firn::exp, firn::max; // for numbers; those of packs are found by their arguments
            using Number = firn::ScalarOf<Real>;
            Real const height = max(node.position.relative_to({0, 0, 0})[1], Real(0));
            Real const wind(static_cast<Number>(speed)), slowness(static_cast<Number>(-rate));
            Real const keeps = exp(slowness * height * node.dt);
            firn::Vector<Real, d> after = velocity * keeps;
            after[0] = wind + (velocity[0] - wind) * keeps;
            return after;
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action over(firn::Interval const&) const
    {
        return {speed, rate};
    }
};
