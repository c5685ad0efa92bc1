// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>

namespace firn
{

/// Tells whether a point [m] is inside a solid: `solver.remove_if(Inside<Box>{.shape = {...}})` is a drain.
///
/// It takes any shape that an obstacle takes but one that changes its form, a Union or an AnyShape, too.
/// `pose` says where the solid is: its position and orientation. On a device the shape must be a plain value,
/// as an obstacle's must. In a scene that is periodic along some axes a solver's calls, assign() and
/// mark_face() take what is inside the solid or any of its images: a solid that lies across an end of a
/// period has particles of both ends in it. An unbounded one has to be the same all along such an axis.
template <class ShapeType>
struct Inside
{
    static_assert(!is_deforming<ShapeType>,
                  "a shape that changes its form is an obstacle, and makes no region");

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
    requires detail::is_plain<ShapeType> FIRN_HOST_DEVICE bool
    operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        Eigen::Matrix3d const rotation = pose.rotation();
        return images.any<d>(x - pose.position.template head<d>(), [&](Vector<double, d> const& away) {
            Vector<double, d> const local = rotation.template topLeftCorner<d, d>().transpose() * away;
            return detail::distance_from<d>(shape, local) < 0;
        });
    }
    /// Of a shape that loops know by its view, such as a Union.
    template <int d>
    bool operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        return Inside<detail::Plain<ShapeType>>{detail::plain(shape), pose, images}(x);
    }

    /// The same in a scene on a lattice, with the images of the solid along its periodic axes, as a plain
    /// value, which is valid while the shape lives. A solver's calls do this themselves.
    auto with_images(Lattice const& lattice, int dimension) const
    {
        return Inside<detail::Plain<ShapeType>>{
            detail::plain(shape), pose, detail::Images::of(shape, pose, lattice, dimension, "Inside")};
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
    requires detail::is_plain<ShapeType> FIRN_HOST_DEVICE bool
    operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        return !Inside<ShapeType>{shape, pose, images}(x);
    }
    /// Of a shape that loops know by its view, such as a Union.
    template <int d>
    bool operator()(Eigen::Matrix<double, d, 1> const& x) const
    {
        return !Inside<ShapeType>{shape, pose, images}(x);
    }

    /// The same in a scene on a lattice, as a plain value: outside of the solid and of all its images.
    auto with_images(Lattice const& lattice, int dimension) const
    {
        return Outside<detail::Plain<ShapeType>>{
            detail::plain(shape), pose, detail::Images::of(shape, pose, lattice, dimension, "Outside")};
    }
};

} // namespace firn
