// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>

namespace firn
{

/// Tells whether a point [m] is inside a solid: `solver.remove_if(Inside<Box>{.shape = {...}})` is a drain.
///
/// `pose` says where the solid is: its position and orientation. On a device the shape must be a plain value,
/// as an obstacle's must. In a scene that is periodic along some axes a solver's calls, assign() and
/// mark_face() take what is inside the solid or any of its images: a solid that lies across an end of a
/// period has particles of both ends in it. An unbounded one has to be the same all along such an axis.
template <class ShapeType>
struct Inside
{
    ShapeType shape{};
    Motion pose{};
    detail::Images images{}; ///< in a periodic scene: see with_images()

    static constexpr bool in_host_memory = requires { requires ShapeType::in_host_memory; };

    void validate() const
    {
        if constexpr (requires { shape.validate(); }) shape.validate();
        pose.validate("Inside");
    }

    void validate_in_plane() const
    {
        pose.validate_in_plane("Inside");
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
    }

    template <int d>
    FIRN_HOST_DEVICE bool operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        Eigen::Matrix3d const rotation = pose.rotation();
        return images.any<d>(x - pose.position.template head<d>(), [&](Vector<double, d> const& away) {
            Vector<double, d> const local = rotation.template topLeftCorner<d, d>().transpose() * away;
            if constexpr (Shape<ShapeType, double, d>)
                return shape.surface(local).distance < 0;
            else // samples in single precision
                return shape.surface(Vector<float, d>(local.template cast<float>())).distance < 0;
        });
    }

    /// The same in a scene on a lattice, with the images of the solid along its periodic axes. A solver's
    /// calls do this themselves.
    Inside with_images(Lattice const& lattice, int dimension) const
    {
        return {shape, pose, detail::Images::of(shape, pose, lattice, dimension, "Inside")};
    }
};

/// Tells whether a point [m] is outside a solid: what left a box, for example. In a periodic scene it is
/// outside of all its images, too: see Inside.
template <class ShapeType>
struct Outside
{
    ShapeType shape{};
    Motion pose{};
    detail::Images images{}; ///< in a periodic scene: see Inside

    static constexpr bool in_host_memory = Inside<ShapeType>::in_host_memory;

    void validate() const { Inside<ShapeType>{shape, pose}.validate(); }
    void validate_in_plane() const { Inside<ShapeType>{shape, pose}.validate_in_plane(); }

    template <int d>
    FIRN_HOST_DEVICE bool operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        return !Inside<ShapeType>{shape, pose, images}(x);
    }

    /// The same in a scene on a lattice: outside of the solid and of all its images.
    Outside with_images(Lattice const& lattice, int dimension) const
    {
        return {shape, pose, detail::Images::of(shape, pose, lattice, dimension, "Outside")};
    }
};

} // namespace firn
