// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/effect.hpp>
#include <firn/math/product.hpp>

namespace firn
{

/// Accelerates the particles that are marked by `Tag`, each by the share that its mark says: a body force on
/// one material, one body, or some ids. The transfer carries the marks, such as `Carrying<Mls, Marks<Mark>>`;
/// others are refused at compile time. A call is refused while no particle is marked.
///
/// What a body gets is its marked mass times the acceleration, to rounding. Nodes that it shares with others
/// pass a part of it on to them, as they do with any force.
template <class Tag>
struct MarkedForce
{
    static constexpr auto name = "MarkedForce"; ///< in messages

    Eigen::Vector3d acceleration{0, 0, 0}; ///< in world axes [m/s^2]

    void validate() const
    {
        require(all_finite(acceleration), "the acceleration of a force is not finite", "MarkedForce",
                "Pass it in m/s^2: the force per mass.");
    }
    void validate_in_plane() const
    {
        require(exactly_equal(acceleration.z(), 0), "a force in a scene in two dimensions leaves the plane",
                "MarkedForce", "Keep z out of its acceleration.");
    }
    /// A bound for the time step [m/s^2]: see stable_time_step.
    double largest_acceleration() const { return norm(acceleration); }

    /// Of one step: the acceleration of what is marked in full.
    template <class Number, int d>
    struct Action
    {
        using Marked = Tag;
        Vector<Number, d> full; ///< [m/s^2]

        template <Lane Real>
        FIRN_HOST_DEVICE Vector<Real, d> marked_acceleration(LanePosition<Real, d> const&) const
        {
            return make_vector<Real, d>([&](int a) { return Real(full[a]); });
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const&) const
    {
        return {vector_of<Number, d>(acceleration)};
    }
};

} // namespace firn
