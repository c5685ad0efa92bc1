// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/math/product.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>

// Shapes in scenes that are periodic along some axes. An effect knows the image of a shape whose reference
// point is nearest. That is enough for a shape that reaches no further along the axis than half a period, and
// for one that is mirrored across it, since of two of its images the nearer one is that of the nearer point.
namespace firn::detail
{

/// Whether a shape says how it lies along an axis.
template <class ShapeType>
inline constexpr bool tells_along = requires(ShapeType const& shape, Eigen::Vector3d const& axis)
{
    shape.along(axis);
}
|| requires(ShapeType const& shape, Eigen::Vector3d const& axis) { shape.view().along(axis); }
|| requires(ShapeType const& shape, Eigen::Vector3d const& axis) { shape.fits_period(axis, 0.0, 0.0); };

/// Whether the nearest image of a shape's reference point tells all that is inside its images along `axis`, a
/// unit vector in the shape's frame. They are two `half` [m] apart. The reference point is `offset` [m] along
/// the axis from the one whose nearest image is taken: that of the body. Samples, such as those of a mesh,
/// are not looked at, since they may go on from image to image, nor is a shape of a program's own that says
/// neither how it lies along an axis nor how far it reaches.
template <class ShapeType>
bool fits_period(ShapeType const& shape, Eigen::Vector3d const& axis, double half, double offset)
{
    if constexpr (requires { shape.fits_period(axis, half, offset); })
        return shape.fits_period(axis, half, offset);
    else {
        double const own_reach = reach_of(shape, 3);
        AlongAxis along{own_reach, !(own_reach > 0) || is_sampled<Plain<ShapeType>>};
        if constexpr (requires { shape.along(axis); })
            along = shape.along(axis);
        else if constexpr (requires { shape.view().along(axis); })
            along = shape.view().along(axis);
        bool const is_centred = std::abs(offset) <= 1e-9 * half;
        return along.reach + std::abs(offset) <= (1 + 1e-9) * half || (along.is_mirrored && is_centred);
    }
}

/// The same for a shape in a pose, along an axis of the world.
template <class ShapeType>
bool fits_period(ShapeType const& shape, Motion const& pose, Lattice const& lattice, int axis)
{
    Eigen::Matrix3d const rotation = pose.rotation();
    Eigen::Vector3d const in_frame(rotation(axis, 0), rotation(axis, 1), rotation(axis, 2));
    return fits_period(shape, in_frame, 0.5 * lattice.period(axis), 0.0);
}

[[noreturn, gnu::cold]] inline void refuse_period(bool is_bounded, int axis, char const* where)
{
    std::string const name(1, "xyz"[axis]);
    if (is_bounded)
        throw Error{
            "it reaches further than half a period along " + name +
                ", and its nearest image does not tell all of it",
            where,
            "Make it of shorter ones, put its reference point into its middle, or let it lie along or "
            "across that axis. A shape of your own that fits says so by a member along()."};
    throw Error{"it is unbounded, and not the same all along " + name + ", where the lattice is periodic",
                where,
                "Let its surface be parallel to that axis, or pass a shape that has an end, such as a Box."};
}

/// Throws an Error unless a shape that moves makes sense in a scene that is periodic along some axes: where
/// it turns, at every angle.
template <class ShapeType>
void require_fits_periods(ShapeType const& shape, Motion const& motion, Lattice const& lattice, int dimension,
                          char const* where)
{
    for (int a = 0; a < dimension; ++a) {
        if (lattice.periods[std::size_t(a)] == 0) continue;
        double const reach = reach_of(shape, dimension), speed = norm(motion.angular_velocity);
        bool fits = reach > 0 && reach <= 0.5 * lattice.period(a);
        if (!fits) fits = fits_period(shape, motion, lattice, a);
        if (fits && speed > 0 && !(reach > 0 && reach <= 0.5 * lattice.period(a)))
            fits = fits_period(shape, motion.later_by(0.7 / speed), lattice, a); // any angle would do
        if (!fits) refuse_period(reach > 0, a, where);
    }
}

/// The images of a region that a point has to be compared with; none but itself by default.
struct Images
{
    std::array<double, 3> period{}; ///< along each axis [m]; 0: there is none
    std::array<int, 3> beside{};    ///< how many images count on each side of the nearest one

    /// Those of a shape in a pose. Throws an Error if it is unbounded and not the same all along a periodic
    /// axis, or reaches over more periods than can be looked at.
    template <class ShapeType>
    static Images of(ShapeType const& shape, Motion const& pose, Lattice const& lattice, int dimension,
                     char const* where)
    {
        constexpr double most = 32;
        Images images;
        double const reach = reach_of(shape, dimension);
        for (int a = 0; a < dimension; ++a) {
            if (lattice.periods[std::size_t(a)] == 0) continue;
            images.period[std::size_t(a)] = lattice.period(a);
            bool const is_told = tells_along<ShapeType> || !(reach > 0);
            if (is_told && fits_period(shape, pose, lattice, a)) continue;
            double const beside = std::floor(reach / lattice.period(a) + 0.5);
            if (!(reach > 0) || beside > most) refuse_period(reach > 0, a, where);
            images.beside[std::size_t(a)] = static_cast<int>(beside);
        }
        return images;
    }

    /// Whether a test is true for a vector from the reference point [m], or from that of an image.
    template <int d, class Test>
    FIRN_HOST_DEVICE bool any(Vector<double, d> const& away, Test const& test) const
    {
        Vector<double, d> nearest = away;
        for (int a = 0; a < d; ++a)
            if (double const p = period[std::size_t(a)]; p > 0)
                nearest[a] -= p * std::floor(nearest[a] / p + 0.5);
        int const behind = d == 3 ? beside[2] : 0;
        for (int i = -beside[0]; i <= beside[0]; ++i)
            for (int j = -beside[1]; j <= beside[1]; ++j)
                for (int k = -behind; k <= behind; ++k) {
                    int const at[]{i, j, k};
                    Vector<double, d> image = nearest;
                    for (int a = 0; a < d; ++a) image[a] += at[a] * period[std::size_t(a)];
                    if (test(image)) return true;
                }
        return false;
    }
};

/// A predicate of positions that knows the images of its region in a scene, if it is one that can.
template <int d, class Predicate>
auto with_images(Predicate const& predicate, [[maybe_unused]] Lattice const& lattice)
{
    if constexpr (requires { predicate.with_images(lattice, d); })
        return predicate.with_images(lattice, d);
    else
        return predicate;
}

} // namespace firn::detail
