// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/effect.hpp>

namespace firn
{

/// The same acceleration everywhere.
struct Gravity
{
    Eigen::Vector3d acceleration{0, -9.81, 0}; ///< [m/s^2]

    void validate() const
    {
        require(acceleration.allFinite(), "the acceleration of gravity is not finite", "Gravity",
                "Pass it in m/s^2.");
    }

    /// Adds g dt to every velocity.
    template <class Number, int d>
    struct Action
    {
        static constexpr bool is_obstacle = false;
        Vector<Number, d> change; ///< [m/s]

        template <Lane Real>
        FIRN_HOST_DEVICE Vector<Real, d> on_node(Vector<Real, d> const& velocity) const
        {
            Vector<Real, d> after;
            for (int a = 0; a < d; ++a) after[a] = velocity[a] + Real(change[a]);
            return after;
        }
    };

    template <class Number, int d>
    Action<Number, d> during(Interval const& interval) const
    {
        return {(acceleration.head<d>() * interval.length()).template cast<Number>()};
    }

    /// The bound that gravity sets to the time step, see stable_time_step.
    double largest_acceleration() const { return acceleration.norm(); }
};

} // namespace firn
