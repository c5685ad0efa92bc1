// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/math/product.hpp>

#include <Eigen/Geometry>

#include <cmath>
#include <optional>

namespace firn
{

/// Where a rigid body is and how it moves: a pose and a twist at one time, constant twist from there on.
///
/// A plain value: a host engine passes a new one with every call, and within a call it is evaluated at every
/// step. Without a time it holds at the beginning of the call, so successive poses need no time of their own.
/// With a time the same value may be passed to call after call, and the body moves on through all of them. In
/// two dimensions positions and velocities have z = 0 and rotations are about z.
struct Motion
{
    Eigen::Vector3d position{0, 0, 0};          ///< of the reference point [m]
    Eigen::Quaterniond orientation{1, 0, 0, 0}; ///< w, x, y, z: from the body's frame to the world's
    Eigen::Vector3d velocity{0, 0, 0};          ///< of the reference point [m/s]
    Eigen::Vector3d angular_velocity{0, 0, 0};  ///< omega, about the reference point [rad/s]
    std::optional<double> time{}; ///< when all this holds [s]; if left out, at the beginning of the call

    /// The motion that brings a body from the pose of `before` to that of `after` within `dt` [s], at
    /// constant velocity and by the shortest rotation. It begins at the time of `before`, if that has one.
    ///
    /// Only positions and orientations are read: hosts that animate by poses pass those of now and of the end
    /// of the frame. Throws an Error if dt is not a finite number above 0, if an obstacle may not have one of
    /// the poses, or if the velocity would be beyond 1e15 m/s or rad/s.
    static Motion between(Motion const& before, Motion const& after, double dt)
    {
        char const* const where = "Motion::between";
        require(is_finite(dt) && dt > 0, "the time between two poses is not a finite number above 0", where,
                "Pass seconds, e.g. 1.0 / 24.");
        Motion motion{.position = before.position, .orientation = before.orientation, .time = before.time};
        motion.validate(where);
        Motion{.position = after.position, .orientation = after.orientation}.validate(where);
        Eigen::Quaterniond const from = before.unit_orientation();
        Eigen::Quaterniond const turn =
            after.unit_orientation() * Eigen::Quaterniond(from.w(), -from.x(), -from.y(), -from.z());
        // twice the logarithm of the rotation; q and -q are the same rotation
        double const sine = std::sqrt(turn.x() * turn.x() + turn.y() * turn.y() + turn.z() * turn.z());
        double const angle = 2 * std::atan2(sine, std::abs(turn.w()));
        double const per_sine = (sine > 0 ? angle / sine : 0) * (turn.w() < 0 ? -1 : 1);
        double const axis[]{turn.x(), turn.y(), turn.z()};
        for (int i = 0; i < 3; ++i) {
            motion.velocity[i] = (after.position[i] - before.position[i]) / dt;
            motion.angular_velocity[i] = axis[i] * per_sine / dt;
        }
        motion.validate(where);
        return motion;
    }

    /// The rotation from the body's frame to the world's.
    FIRN_HOST_DEVICE Eigen::Matrix3d rotation() const { return unit_orientation().toRotationMatrix(); }

    /// The same motion at another time [s]; a motion without a time is taken to hold then. Like the private
    /// functions it works by components: see core/components.hpp.
    FIRN_HOST_DEVICE Motion at(double when) const { return moved(time.has_value() ? when - *time : 0, when); }

    /// The same motion `elapsed` [s] later; its time, if it has one, advances too.
    FIRN_HOST_DEVICE Motion later_by(double elapsed) const
    {
        return time.has_value() ? at(*time + elapsed) : moved(elapsed, {});
    }

    /// The same motion in a call that begins at `begin` [s], which becomes its time unless it has one.
    Motion from(double begin) const
    {
        Motion motion = *this;
        if (!time.has_value()) motion.time = begin;
        return motion;
    }

    /// Whether every member is finite, and small enough for its square to be finite in single precision, too.
    bool is_in_range() const
    {
        constexpr double furthest = 1e15; // its square is finite in single precision
        auto const is_near = [furthest](double x) { return is_between(-furthest, x, furthest); };
        auto const within = [&](Eigen::Vector3d const& v) {
            return is_near(v.x()) && is_near(v.y()) && is_near(v.z());
        };
        double const length = length_of_orientation();
        return within(position) && within(velocity) && within(angular_velocity) &&
               is_near(time.value_or(0)) && is_finite(length) && length > 1e-6 && length < 1e6;
    }

    void validate(char const* where) const
    {
        require(is_in_range(),
                "the motion of an obstacle is not finite or from beyond 1e15 m, s, m/s or rad/s, or its "
                "orientation is no rotation",
                where, "Pass finite positions [m], velocities [m/s, rad/s] and a unit quaternion.");
    }

    /// Throws an Error unless it stays in the plane of a scene in two dimensions: velocity without z,
    /// rotation about z alone.
    void validate_in_plane(char const* where) const
    {
        bool const in_plane = exactly_equal(velocity.z(), 0) && std::abs(angular_velocity.x()) <= 1e-6 &&
                              std::abs(angular_velocity.y()) <= 1e-6 && std::abs(rotation()(2, 2)) > 1 - 1e-9;
        require(in_plane, "a body leaves the plane of a scene in two dimensions", where,
                "Keep z out of its velocity, and let it turn about z alone.");
    }

private:
    FIRN_HOST_DEVICE Motion moved(double elapsed, std::optional<double> when) const
    {
        Motion later = *this;
        for (int i = 0; i < 3; ++i) later.position[i] += velocity[i] * elapsed;
        double const speed = norm(angular_velocity);
        if (speed > 0) {
            double const half_angle = 0.5 * speed * elapsed, sine = std::sin(half_angle);
            auto const axis = [&](int i) { return angular_velocity[i] / speed; };
            Eigen::Quaterniond const turn(std::cos(half_angle), sine * axis(0), sine * axis(1),
                                          sine * axis(2));
            later.orientation = turn * unit_orientation();
        }
        later.time = when;
        return later;
    }

    FIRN_HOST_DEVICE double length_of_orientation() const
    {
        Eigen::Quaterniond const& q = orientation;
        return std::sqrt(q.w() * q.w() + q.x() * q.x() + q.y() * q.y() + q.z() * q.z());
    }
    FIRN_HOST_DEVICE Eigen::Quaterniond unit_orientation() const
    {
        Eigen::Quaterniond const& q = orientation;
        double const length = length_of_orientation();
        return {q.w() / length, q.x() / length, q.y() / length, q.z() / length};
    }
};

} // namespace firn
