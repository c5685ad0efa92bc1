// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>
#include <firn/math/product.hpp>

#include <limits>

namespace firn
{

/// How a surface acts on what touches it: Coulomb friction on approach, and whether it lets go again.
///
/// Applied to the velocity relative to the surface, v = v_n n + v_t (Stomakhin et al. 2013, section 8, with
/// the stick condition the right way round: a tangential speed within friction * |v_n| sticks).
struct Contact
{
    double friction = 0;   ///< Coulomb's mu: 0 slips, infinity sticks on approach
    bool separates = true; ///< whether material may move away from the surface
    bool sticks = false;   ///< no relative velocity at all, approaching or not

    FIRN_HOST_DEVICE static Contact sticky()
    {
        return {.friction = std::numeric_limits<double>::infinity(), .separates = false, .sticks = true};
    }
    FIRN_HOST_DEVICE static Contact slip() { return {}; }
    /// Slips, and never lets go.
    FIRN_HOST_DEVICE static Contact bound_slip() { return {.separates = false}; }
    FIRN_HOST_DEVICE static Contact coulomb(double friction_coefficient)
    {
        return {.friction = friction_coefficient};
    }

    void validate(char const* where) const
    {
        require(is_number(friction) && friction >= 0, "the friction coefficient is below 0 or not a number",
                where, "Pass Coulomb's mu, e.g. 0.5.");
    }

    /// The relative velocity after contact with a surface of outward unit normal n; never faster than before.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE Vector<Real, d> after(Vector<Real, d> const& v, Vector<Real, d> const& n) const
    {
        if (sticks) return zeros<Vector<Real, d>>();
        Real const zero(0);
        Real const v_n = dot<Real, d>(v, n);
        Vector<Real, d> const v_t = v - n * v_n;
        Real keeps = Real(1); // the share of v_t that friction leaves
        if (friction > 0) {
            // mu = infinity becomes the largest number, whose product with an approach speed may overflow:
            // that sticks too.
            Real const mu(static_cast<ScalarOf<Real>>(
                min(friction, double(std::numeric_limits<ScalarOf<Real>>::max()))));
            Real const tangential = sqrt(dot<Real, d>(v_t, v_t)), limit = mu * max(-v_n, zero);
            Mask<Real> const slides = tangential > limit;
            keeps = select(slides, Real(1) - limit / select(slides, tangential, Real(1)),
                           select(v_n < zero, zero, Real(1)));
        }
        Real const leaving = separates ? max(v_n, zero) : zero;
        return v_t * keeps + n * leaving;
    }
};

namespace detail
{
/// The velocity [m/s] of a rigid body at `arm` [m] from its reference point: v + omega x arm.
template <Lane Real, int d, class Number>
FIRN_HOST_DEVICE Vector<Real, d> rigid_velocity(Vector<Number, d> const& velocity,
                                                Vector<Number, 3> const& angular_velocity,
                                                Vector<Real, d> const& arm)
{
    Vector<Real, d> u = vector_of<Real, d>(velocity);
    Real const omega_z(angular_velocity[2]);
    u[0] -= omega_z * arm[1];
    u[1] += omega_z * arm[0];
    if constexpr (d == 3) {
        Real const omega_x(angular_velocity[0]), omega_y(angular_velocity[1]);
        u[0] += omega_y * arm[2];
        u[1] -= omega_x * arm[2];
        u[2] += omega_x * arm[1] - omega_y * arm[0];
    }
    return u;
}
} // namespace detail

} // namespace firn
