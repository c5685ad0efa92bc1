// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>

namespace firn
{

/// Accelerates what is inside a shape, and leaves what is outside: a body force in a region. On nodes within
/// half a cell of the surface it rises from none to all, so that the force on a body changes gradually where
/// the body moves into the region.
template <class ShapeType>
struct Force
{
    /// The region's surface, in its frame.
    ShapeType shape{};
    Eigen::Vector3d acceleration{0, 0, 0}; ///< in world axes [m/s^2]
    /// Where the region is and how it moves.
    Motion motion{};

    void validate() const
    {
        if constexpr (requires { shape.validate(); }) shape.validate();
        require(all_finite(acceleration), "the acceleration of a force is not finite", "Force",
                "Pass it in m/s^2: the force per mass.");
        motion.validate("Force");
        static_assert(!is_two_sided<ShapeType>, "a region is a solid: a shell has no inside");
        static_assert(!is_deforming<ShapeType>,
                      "a shape that changes its form is an obstacle, and makes no region");
    }
    void validate_in_plane() const
    {
        require(exactly_equal(acceleration.z(), 0), "a force in a scene in two dimensions leaves the plane",
                "Force", "Keep z out of its acceleration.");
        motion.validate_in_plane("Force");
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
    }
    /// Throws an Error if it makes no sense in a scene that is periodic along some axes: see
    /// detail::require_fits_periods.
    void validate_in(Lattice const& lattice, int dimension) const
    {
        detail::require_fits_periods(shape, motion, lattice, dimension, "Force");
    }

    /// A bound for the time step [m/s^2]: see stable_time_step.
    double largest_acceleration() const { return norm(acceleration); }

    /// Where its values lie: see SignedDistanceGrid::on.
    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };

    /// The same as a plain value, for a call that begins at `begin` [s].
    auto plain(double begin) const
    {
        return Force<detail::Plain<ShapeType>>{detail::plain(shape), acceleration, motion.from(begin)};
    }

    /// Of one step: the acceleration of what is inside.
    template <class Number, int d>
    struct Action
    {
        detail::Plain<ShapeType> shape;
        Vector<Number, d> inside; ///< acceleration [m/s^2]
        Eigen::Vector3d position;
        Matrix<Number, d> rotation; ///< region to world

        template <Lane Real>
        FIRN_HOST_DEVICE Vector<Real, d> acceleration(LanePosition<Real, d> const& place) const
        {
            Vector<Real, d> const local =
                transpose_product<Real, d>(matrix_of<Real, d>(rotation), place.relative_to(position));
            Real const depth = -surface_of<Real, d>(shape, local).distance;
            Real const share =
                min(max(depth * Real(static_cast<Number>(1 / place.lattice.cell_size)) + Real(Number(0.5)),
                        Real(0)),
                    Real(1));
            Vector<Real, d> here;
            for (int a = 0; a < d; ++a) here[a] = share * Real(inside[a]);
            return here;
        }
    };

    /// The region where it is in the middle of the step. Called on a plain value.
    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number, d> over(Interval const& interval) const
    {
        Motion const now = motion.at(0.5 * (interval.begin + interval.end));
        return {shape, vector_of<Number, d>(acceleration), now.position,
                matrix_of<Number, d>(now.rotation())};
    }
};

} // namespace firn
