// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/math/inverse.hpp>
#include <firn/math/product.hpp>

#include <cmath>

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
/// Its motion needs no time: without one it holds when each call begins.
///
/// The momenta of the body and of the particles then add up to what gravity added, to rounding. The body
/// receives the reaction at the end of `dt`, which is stable while its mass is above that of the material
/// that it would sweep within `dt`. In two dimensions masses are per metre of thickness.
struct RigidBody
{
    double mass = 1;                       ///< [kg]
    Eigen::Matrix3d inertia = diagonal(1); ///< in the body's frame [kg m^2]
    Motion motion{};

    /// A solid ball of even density (Landau & Lifshitz, *Mechanics*, section 32).
    static RigidBody ball(double radius, double mass, Motion const& motion = {})
    {
        require(is_number(radius) && radius > 0, "the radius is not above 0", "RigidBody::ball",
                "Pass metres.");
        RigidBody const ball{
            .mass = mass, .inertia = diagonal(0.4 * mass * radius * radius), .motion = motion};
        ball.validate();
        return ball;
    }

    void validate() const
    {
        auto const is_definite = [](Eigen::Matrix3d const& m) { // by its leading minors
            Eigen::Matrix3d const C = cofactors(m);
            return m(0, 0) > 0 && C(2, 2) > 0 &&
                   sum_of<double, 3>([&](int k) { return m(k, 0) * C(k, 0); }) > 0;
        };
        // in shares of the trace, since squares of a heavy body's moments would overflow, and a light one's
        // underflow
        double const total = trace();
        Eigen::Matrix3d const shares = inertia_over(total);
        auto const agree = [&](int a, int b) { return std::abs(shares(a, b) - shares(b, a)) <= 1e-12; };
        bool const symmetric = all_finite(shares) && agree(0, 1) && agree(0, 2) && agree(1, 2);
        require(is_finite(mass) && mass > 0 && symmetric && total > 0 && is_definite(shares),
                "the mass is not a finite number above 0, or the inertia is not that of a body", "RigidBody",
                "Pass kg, and a symmetric positive definite matrix in kg m^2.");
        // The sum of m x x^T, with half the trace of the inertia, is not negative along any axis. Along the
        // normal of a flat body it is 0 up to rounding, hence the margin.
        Eigen::Matrix3d const spread =
            make_matrix<double, 3>([&](int i, int j) { return (i == j ? 0.5 + 1e-6 : 0.0) - shares(i, j); });
        require(is_definite(spread), "a principal moment of inertia is more than the other two together",
                "RigidBody", "Pass the inertia of a body: a flat one in the plane has Ixx + Iyy = Izz.");
        motion.validate("RigidBody");
    }

    Eigen::Vector3d momentum() const ///< [kg m/s]
    {
        return make_vector<double, 3>([&](int i) { return motion.velocity[i] * mass; });
    }

    /// About its centre of mass [kg m^2/s].
    Eigen::Vector3d angular_momentum() const
    {
        Eigen::Matrix3d const R = motion.rotation();
        Eigen::Vector3d const own_spin =
            product<double, 3>(inertia, transpose_product<double, 3>(R, motion.angular_velocity));
        return product<double, 3>(R, own_spin);
    }

    /// Moves the body by `dt` [s] as the obstacle was moved, then adds what it received meanwhile and the
    /// effect of gravity [m/s^2]. Throws an Error, and leaves the body as it was, unless the arguments and
    /// the result are finite.
    void advance(Reaction const& received, double dt, Eigen::Vector3d const& gravity)
    {
        validate();
        require(is_finite(dt) && dt >= 0 && all_finite(gravity) && all_finite(received.impulse) &&
                    all_finite(received.angular_impulse),
                "what a body received is not finite, or the time it took is below 0", "RigidBody::advance",
                "Pass a reaction, seconds and m/s^2.");
        Motion after = motion.later_by(dt);
        for (int i = 0; i < 3; ++i) after.velocity[i] += received.impulse[i] / mass + gravity[i] * dt;
        // in the body's frame, since rounding of a rotated inertia would hide a moment far below the others;
        // over the trace, see validate()
        double const total = trace();
        Eigen::Vector3d const before = angular_momentum();
        Eigen::Vector3d const spin =
            make_vector<double, 3>([&](int i) { return (before[i] + received.angular_impulse[i]) / total; });
        Eigen::Matrix3d const R = after.rotation();
        Eigen::Vector3d const own_spin = transpose_product<double, 3>(R, spin);
        Eigen::Vector3d const turning = product<double, 3>(inverse<double, 3>(inertia_over(total)), own_spin);
        after.angular_velocity = product<double, 3>(R, turning);
        require(after.is_in_range(), "what a body received sets it off beyond all numbers",
                "RigidBody::advance",
                "Check its mass [kg] and inertia [kg m^2] against impulses [N s] and the time [s].");
        motion = after;
    }

private:
    // Like Motion it works by components: see core/components.hpp.
    static Eigen::Matrix3d diagonal(double value)
    {
        return make_matrix<double, 3>([&](int i, int j) { return i == j ? value : 0.0; });
    }
    double trace() const { return inertia(0, 0) + inertia(1, 1) + inertia(2, 2); }
    Eigen::Matrix3d inertia_over(double divisor) const
    {
        return make_matrix<double, 3>([&](int i, int j) { return inertia(i, j) / divisor; });
    }
};

} // namespace firn
