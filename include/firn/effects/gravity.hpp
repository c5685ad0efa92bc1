// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/effect.hpp>
#include <firn/math/product.hpp>

namespace firn
{

/// The same acceleration everywhere.
struct Gravity
{
    Eigen::Vector3d acceleration{0, -9.81, 0}; ///< [m/s^2]

    void validate() const
    {
        require(all_finite(acceleration), "the acceleration of gravity is not finite", "Gravity",
                "Pass it in m/s^2.");
    }

    void validate_in_plane() const
    {
        require(exactly_equal(acceleration.z(), 0), "gravity in a scene in two dimensions leaves the plane",
                "Gravity", "Keep z out of its acceleration: down is -y, unless told otherwise.");
    }

    /// Adds m g dt to every momentum, dt being the time for which forces act. Adding g dt to every velocity
    /// would round bodies of one velocity all the same way, step after step. `acceleration(place)` is for
    /// what differs from place to place; here g dt is rounded once, and each momentum once in a step.
    template <class Number, int d>
    struct Action
    {
        static constexpr bool takes_any_unit_of_mass = true;
        Vector<Number, d> change; ///< [m/s]

        template <Lane Real>
        FIRN_HOST_DEVICE void on_momentum(Vector<Real, d>& momentum, Real mass) const
        {
            for (int a = 0; a < d; ++a) momentum[a] += mass * Real(change[a]);
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const& interval) const
    {
        return {make_vector<Number, d>(
            [&](int i) { return static_cast<Number>(acceleration[i] * interval.forces); })};
    }

    /// The bound that gravity sets to the time step, see stable_time_step.
    double largest_acceleration() const { return norm(acceleration); }
};

} // namespace firn
