// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/prescribed_velocity.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>

#include <array>
#include <optional>

namespace firn
{

/// Prescribes the velocity of all nodes inside a region, those on its surface included: a clamp, a grip that
/// pulls, a roller, an inflow. What it takes to do so is its reaction, as of an obstacle.
///
/// What is inside moves with the region unless `velocity` says otherwise: then the region may stand still
/// while material is driven through it. Along the world's axes that are left out of `axes` material is free.
/// Nodes take the prescribed velocity whatever the material does, so it neither slides nor lets go.
template <class ShapeType>
struct Held
{
    /// The region's surface, in its frame.
    ShapeType shape{};
    /// Where the region is and how it moves.
    Motion motion{};
    /// The velocity of what is inside in world axes, if that is not the region's own [m/s].
    std::optional<Eigen::Vector3d> velocity{};
    /// Along which of the world's axes velocity is prescribed.
    std::array<bool, 3> axes{true, true, true};

    /// Throws an Error unless shape, motion and velocity make sense.
    void validate() const
    {
        static_assert(!is_two_sided<ShapeType>, "a region is a solid: a shell has no inside");
        static_assert(!is_deforming<ShapeType>,
                      "a shape that changes its form is an obstacle, and makes no region");
        if constexpr (requires { shape.validate(); }) shape.validate();
        detail::validate_prescribed(motion, velocity, axes, "Held");
    }
    /// Throws an Error if it leaves the plane, in a scene of two dimensions.
    void validate_in_plane() const
    {
        detail::validate_prescribed_in_plane(motion, velocity, axes, "Held");
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
    }

    /// Throws an Error if it makes no sense in a scene that is periodic along some axes: see
    /// detail::require_fits_periods.
    void validate_in(Lattice const& lattice, int dimension) const
    {
        detail::require_fits_periods(shape, motion, lattice, dimension, "Held");
    }

    /// A bound on the speed of the region and of what is inside [m/s] in a scene of `dimension` dimensions.
    double largest_speed(int dimension) const
    {
        double const of_region =
            norm(motion.velocity) + norm(motion.angular_velocity) * detail::reach_of(shape, dimension);
        double const inside = velocity ? norm(*velocity) : 0;
        return of_region > inside ? of_region : inside;
    }

    /// Where its values lie: see SignedDistanceGrid::on.
    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };

    /// The same as a plain value, for a call that begins at `begin` [s].
    auto plain(double begin) const
    {
        return Held<detail::Plain<ShapeType>>{detail::plain(shape), motion.from(begin), velocity, axes};
    }

    /// Of one step: the velocity of what is inside.
    template <class Number, int d>
    struct Action
    {
        static constexpr bool looks_up = is_sampled<detail::Plain<ShapeType>>;

        detail::Plain<ShapeType> shape;
        Contact contact;
        Matrix<Number, d> rotation; ///< region to world
        detail::PrescribedVelocity<Number, d> prescribed;

        /// The prescribed velocity inside, and v outside, whatever the rule is.
        template <Lane Real>
        FIRN_HOST_DEVICE ContactResult<Real, d> touch(LanePosition<Real, d> const& place,
                                                      Vector<Real, d> const& v, Contact const&) const
        {
            ContactResult<Real, d> held;
            held.arm = place.relative_to(prescribed.position);
            Matrix<Real, d> const R = matrix_of<Real, d>(rotation);
            auto const sample = surface_of<Real, d>(shape, transpose_product<Real, d>(R, held.arm));
            held.inside = !(sample.distance > Real(Number(0)));
            held.velocity = v;
            held.depth = held.surface_speed2 = Real(Number(0));
            held.normal = held.surface = zeros<Vector<Real, d>>(); // or compilers warn
            if (!any(held.inside)) return held;
            held.normal = product<Real, d>(R, sample.normal);
            held.depth = select(held.inside, -sample.distance, Real(Number(0)));
            prescribed.template hold<Real>(v, held);
            return held;
        }
    };

    /// The region at the end of the step, as its velocities are. Called on a plain value.
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const& interval) const
    {
        Motion const now = motion.at(interval.end);
        return {shape,
                {},
                matrix_of<Number, d>(now.rotation()),
                detail::PrescribedVelocity<Number, d>::of(now, velocity, axes)};
    }
};

} // namespace firn
