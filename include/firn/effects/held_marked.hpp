// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/prescribed_velocity.hpp>
#include <firn/math/product.hpp>

#include <array>
#include <optional>

namespace firn
{

/// Prescribes the velocity of the particles that are marked by `Tag`, wherever they are: held fast, pulled,
/// or turned. What it takes to do so is its reaction, as of an obstacle. The transfer carries the marks, such
/// as `Carrying<Mls, Marks<Mark>>`; others are refused at compile time. A call is refused while no particle
/// is marked.
///
/// All nodes that a marked particle reaches take the velocity, so marked particles move by it to rounding,
/// with transfers in which particles move with the grid. What lies within the kernel's reach of them goes
/// along. With a threshold `beyond` nodes are held where more than that share of their mass is marked: at 0.5
/// the edge of what is held lies between the marked particles and the others, and the marked ones at the
/// edge follow in part only.
template <class Tag>
struct HeldMarked
{
    static constexpr auto name = "HeldMarked"; ///< in messages

    /// The motion of the particles: they go and turn as a rigid body does that has it.
    Motion motion{};
    /// Their velocity in world axes, if that is not the motion's own [m/s].
    std::optional<Eigen::Vector3d> velocity{};
    /// Along which of the world's axes velocity is prescribed.
    std::array<bool, 3> axes{true, true, true};
    double beyond = 0; ///< the share of a node's mass, from 0 on and below 1

    /// Throws an Error unless motion, velocity and share make sense.
    void validate() const
    {
        detail::validate_prescribed(motion, velocity, axes, "HeldMarked");
        require(is_number(beyond) && beyond >= 0 && beyond < 1, "the share of marked mass is outside [0, 1)",
                "HeldMarked", "Pass 0 for all nodes that marked particles reach, or e.g. 0.5.");
    }
    /// Throws an Error if it leaves the plane, in a scene of two dimensions.
    void validate_in_plane() const
    {
        detail::validate_prescribed_in_plane(motion, velocity, axes, "HeldMarked");
    }

    /// A bound on the speed of the reference point [m/s]. How far from it particles are is known only where
    /// the first step has held them.
    double largest_speed() const { return norm(velocity ? *velocity : motion.velocity); }

    /// The same for a call that begins at `begin` [s].
    HeldMarked plain(double begin) const { return {motion.from(begin), velocity, axes, beyond}; }

    /// Of one step: the velocity of nodes of which enough is marked.
    template <class Number, int d>
    struct Action
    {
        using Marked = Tag;
        detail::PrescribedVelocity<Number, d> prescribed;
        Number least; ///< share of a node's mass, which is not enough itself

        /// The prescribed velocity on lanes of nodes of which more than the least share is marked.
        template <Lane Real>
        FIRN_HOST_DEVICE ContactResult<Real, d> touch_marked(LanePosition<Real, d> const& place,
                                                             Vector<Real, d> const& v, Real share) const
        {
            ContactResult<Real, d> held;
            held.inside = share > Real(least);
            held.velocity = v;
            held.depth = held.surface_speed2 = Real(Number(0));
            held.arm = held.normal = held.surface = zeros<Vector<Real, d>>(); // or compilers warn
            if (!any(held.inside)) return held;
            held.arm = place.relative_to(prescribed.position);
            prescribed.template hold<Real>(v, held);
            return held;
        }
    };

    /// The motion at the end of the step. Called on a plain value.
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const& interval) const
    {
        return {detail::PrescribedVelocity<Number, d>::of(motion.at(interval.end), velocity, axes),
                static_cast<Number>(beyond)};
    }
};

} // namespace firn
