// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/math/product.hpp>

#include <array>
#include <optional>

// Velocities that nodes are given whatever the material does: what Held and HeldMarked have in common.
namespace firn::detail
{

/// The rigid motion that is prescribed in a step, along some of the world's axes.
template <class Number, int d>
struct PrescribedVelocity
{
    Eigen::Vector3d position; ///< of the reference point [m]
    Vector<Number, d> velocity;
    Vector<Number, 3> angular_velocity;
    std::array<bool, 3> axes;

    /// That of a motion at the end of the step, since velocities are prescribed for that time, or another
    /// velocity of its own.
    FIRN_HOST_DEVICE static PrescribedVelocity
    of(Motion const& now, std::optional<Eigen::Vector3d> const& own, std::array<bool, 3> const& axes)
    {
        return {now.position, vector_of<Number, d>(own ? *own : now.velocity),
                vector_of<Number, 3>(own ? zeros<Eigen::Vector3d>() : now.angular_velocity), axes};
    }

    /// Sets what contact with nodes of velocity v is, whose `arm` and `inside` are known.
    template <Lane Real>
    FIRN_HOST_DEVICE void hold(Vector<Real, d> const& v, ContactResult<Real, d>& held) const
    {
        held.surface = rigid_velocity<Real, d>(velocity, angular_velocity, held.arm);
        for (int a = 0; a < d; ++a)
            if (axes[std::size_t(a)]) // the same for all nodes
                held.velocity[a] = select(held.inside, held.surface[a], v[a]);
        held.surface_speed2 = select(held.inside, dot<Real, d>(held.surface, held.surface), Real(Number(0)));
    }
};

/// Throws an Error unless a prescribed motion makes sense.
inline void validate_prescribed(Motion const& motion, std::optional<Eigen::Vector3d> const& velocity,
                                std::array<bool, 3> const& axes, char const* where)
{
    motion.validate(where);
    // its square is finite in single precision, too
    require(!velocity || (all_finite(*velocity) && norm(*velocity) <= 1e15),
            "the prescribed velocity is not finite, or beyond 1e15 m/s", where, "Pass it in m/s.");
    require(axes[0] || axes[1] || axes[2], "no axis is held", where,
            "Leave axes out to hold all, or name one at least.");
}

/// Throws an Error if it leaves the plane, in a scene of two dimensions.
inline void validate_prescribed_in_plane(Motion const& motion, std::optional<Eigen::Vector3d> const& velocity,
                                         std::array<bool, 3> const& axes, char const* where)
{
    require(!velocity || exactly_equal(velocity->z(), 0),
            "a prescribed velocity in a scene in two dimensions leaves the plane", where,
            "Keep z out of the velocity.");
    require(axes[0] || axes[1], "neither of the plane's axes is held", where, "Hold x, y or both.");
    motion.validate_in_plane(where);
}

} // namespace firn::detail
