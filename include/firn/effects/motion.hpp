// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/host_device.hpp>

#include <Eigen/Geometry>

#include <cmath>

namespace firn
{

/// Where a rigid body is and how it moves: a pose and a twist at one time, constant twist from there on.
///
/// A plain value: a host engine passes a new one with every call, and within a call it is evaluated at every
/// step. In two dimensions positions and velocities have z = 0 and rotations are about z.
struct Motion
{
    Eigen::Vector3d position = Eigen::Vector3d::Zero();              ///< of the reference point [m]
    Eigen::Quaterniond orientation = Eigen::Quaterniond::Identity(); ///< from the body's frame to the world's
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();              ///< of the reference point [m/s]
    Eigen::Vector3d angular_velocity = Eigen::Vector3d::Zero(); ///< omega, about the reference point [rad/s]
    double time = 0;                                            ///< when all this holds [s]

    /// The same motion, seen at another time [s].
    FIRN_HOST_DEVICE Motion at(double when) const
    {
        Motion later = *this;
        double const elapsed = when - time;
        later.position += velocity * elapsed;
        double const speed = angular_velocity.norm();
        if (speed > 0)
            later.orientation =
                Eigen::Quaterniond(Eigen::AngleAxisd(speed * elapsed, angular_velocity / speed)) *
                orientation.normalized();
        later.time = when;
        return later;
    }

    /// Whether all of it is finite, and of a size whose squares are, too, in single precision's scenes.
    bool is_in_range() const
    {
        constexpr double furthest = 1e15; // what is beyond is none of single precision's
        auto const within = [furthest](Eigen::Vector3d const& v) {
            return std::abs(v.x()) <= furthest && std::abs(v.y()) <= furthest && std::abs(v.z()) <= furthest;
        }; // no NaN
        return within(position) && within(velocity) && within(angular_velocity) &&
               std::abs(time) <= furthest && orientation.norm() > 1e-6 && orientation.norm() < 1e6;
    }

    void validate(char const* where) const
    {
        require(is_in_range(),
                "the motion of an obstacle is not finite or from beyond 1e15 m, s, m/s or rad/s, or its "
                "orientation is no rotation",
                where, "Pass finite positions [m], velocities [m/s, rad/s] and a unit quaternion.");
    }

    /// In two dimensions there is nothing along z: motion stays in the plane and rotation is about z.
    void validate_in_plane(char const* where) const
    {
        Eigen::Matrix3d const turned = orientation.normalized().toRotationMatrix();
        bool const in_plane = velocity.z() == 0 && std::abs(angular_velocity.x()) <= 1e-12 &&
                              std::abs(angular_velocity.y()) <= 1e-12 && std::abs(turned(2, 2)) > 1 - 1e-9;
        require(in_plane, "a body leaves the plane of a scene in two dimensions", where,
                "Keep z out of its velocity, and let it turn about z alone.");
    }
};

} // namespace firn
