// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>

#include <Eigen/LU>

namespace firn
{

/// A free rigid body that the material moves: its reference point is its centre of mass.
///
/// Pass `motion` to an Obstacle, advance the solver by a short time, and hand the reaction to `advance`:
///
///     Obstacle<Sphere> const obstacle{.shape = {radius}, .motion = ball.motion};
///     auto const report = solver.advance(dt, gravity, obstacle);
///     ball.advance(report.reactions[0], dt, gravity.acceleration);
///
/// Its momentum and that of the particles then add up to what gravity gave them, to rounding. The body takes
/// what it received at the end of `dt`: stable while its mass is above that of the material it would sweep
/// within `dt`. In two dimensions masses are per metre of thickness.
struct RigidBody
{
    double mass = 1;                                       ///< [kg]
    Eigen::Matrix3d inertia = Eigen::Matrix3d::Identity(); ///< in the body's frame [kg m^2]
    Motion motion{};

    /// A solid ball of even density (Landau & Lifshitz, *Mechanics*, section 32).
    static RigidBody ball(double radius, double mass, Motion const& motion = {})
    {
        return {mass, Eigen::Matrix3d::Identity() * (0.4 * mass * radius * radius), motion};
    }

    void validate() const
    {
        bool const symmetric =
            inertia.allFinite() && (inertia - inertia.transpose()).isZero(1e-12 * inertia.norm());
        bool const definite = symmetric && inertia(0, 0) > 0 &&
                              inertia.topLeftCorner<2, 2>().determinant() > 0 && inertia.determinant() > 0;
        require(std::isfinite(mass) && mass > 0 && definite,
                "the mass is not above 0, or the inertia is not that of a body", "RigidBody",
                "Pass kg, and a symmetric positive definite matrix in kg m^2.");
        motion.validate("RigidBody");
    }

    Eigen::Vector3d momentum() const { return mass * motion.velocity; } ///< [kg m/s]

    /// About its centre of mass [kg m^2/s].
    Eigen::Vector3d angular_momentum() const { return world_inertia() * motion.angular_velocity; }

    /// Moves it by `dt` [s] as the obstacle was moved, and then gives it what it received meanwhile and what
    /// gravity [m/s^2] did. Throws an Error, and does not move it, unless all are finite.
    void advance(Reaction const& received, double dt, Eigen::Vector3d const& gravity)
    {
        validate();
        require(std::isfinite(dt) && dt >= 0 && gravity.allFinite() && received.impulse.allFinite() &&
                    received.angular_impulse.allFinite(),
                "what a body received is not finite, or the time it took is below 0", "RigidBody::advance",
                "Pass a reaction, seconds and m/s^2.");
        Eigen::Vector3d const spin = angular_momentum() + received.angular_impulse;
        motion = motion.at(motion.time + dt);
        motion.velocity += received.impulse / mass + gravity * dt;
        motion.angular_velocity = world_inertia().inverse() * spin;
    }

private:
    Eigen::Matrix3d world_inertia() const
    {
        Eigen::Matrix3d const R = motion.orientation.normalized().toRotationMatrix();
        return R * inertia * R.transpose();
    }
};

} // namespace firn
