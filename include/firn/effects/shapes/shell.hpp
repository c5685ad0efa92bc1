// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>

namespace firn
{

/// The surface of a shape as a thin shell, open to both sides: a bowl, a hollow box, a sheet of terrain.
///
/// `thickness` may be far less than a cell. As the shape of an Obstacle it keeps every particle on the side
/// of the surface where it began the step, however the shell moves and however thin it is, in single
/// precision, too. That holds in corners with other shells if they move alike or form an angle of 30 degrees
/// or more; the tip of a narrower corner that closes outruns the step (see ParticleContact). A shell of
/// several cells that is laid over particles pushes them out over several steps.
///
/// Where it is thinner than a cell, the bodies on its two sides still share nodes. It separates them, but
/// transmits a little of an impact, and slightly holds back material that leaves the layer of nodes around
/// it.
template <class ShapeType>
struct Shell
{
    static constexpr bool is_two_sided = true;
    static_assert(!is_deforming<ShapeType>, "a shape that changes its form is a solid: it makes no Shell");

    ShapeType shape{};    ///< its surface is the middle of the shell
    double thickness = 0; ///< [m]

    void validate() const
    {
        if constexpr (requires { shape.validate(); }) shape.validate();
        require(is_finite(thickness) && thickness > 0,
                "the thickness of a shell is not a finite number above 0", "Shell",
                "Pass metres, e.g. a tenth of a cell.");
        require(thickness <= largest_length, "the thickness of a shell is out of range", "Shell",
                "Pass metres, e.g. a tenth of a cell.");
        if constexpr (requires { shape.reach(); }) // 0: an AnyShape is unbounded
            require(!(shape.reach() > 0) || thickness / 2 <= shape.reach(),
                    "a shell is thicker than its shape", "Shell",
                    "Pass metres, e.g. a tenth of a cell, or make it a solid.");
    }

    void validate_in_plane() const
    {
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
    }

    /// Distance of its farthest point from the reference point [m]; an unbounded shape has none, or 0.
    double reach(int dimension = 3) const requires requires(ShapeType const s) { s.reach(); }
    {
        double const middle = detail::reach_of(shape, dimension);
        return middle > 0 ? middle + thickness / 2 : 0;
    }

    /// Whether images at a period do not part it: see detail::fits_period.
    bool fits_period(Eigen::Vector3d const& axis, double half, double offset) const
    {
        return detail::fits_period(shape, axis, half - thickness / 2, offset);
    }

    /// Where its values lie: see SignedDistanceGrid::on.
    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };
    auto view() const { return Shell<detail::Plain<ShapeType>>{detail::plain(shape), thickness}; }

    /// The distance |phi| - thickness / 2, and the normal towards the side that x is on.
    template <class Real, int d>
        requires Shape<ShapeType, Real, d> FIRN_HOST_DEVICE SurfaceSample<Real, d>
        surface(Vector<Real, d> const& x)
    const
    {
        SurfaceSample<Real, d> sample = shape.surface(x);
        Real const side = select(sample.distance < Real(0), Real(-1), Real(1));
        sample.distance = sample.distance * side - Real(static_cast<ScalarOf<Real>>(thickness / 2));
        sample.normal = sample.normal * side;
        return sample;
    }
};

} // namespace firn
