// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/effects/motion.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>
#include <firn/math/product.hpp>

#include <Eigen/Geometry>

#include <algorithm>
#include <tuple>
#include <type_traits>
#include <utility>

namespace firn
{

/// A shape at a place in the frame of a body.
template <class ShapeType>
struct Placed
{
    ShapeType shape{};
    Eigen::Vector3d position{0, 0, 0};          ///< of the shape's reference point [m]
    Eigen::Quaterniond orientation{1, 0, 0, 0}; ///< from the shape's frame to the body's

    void validate() const
    {
        if constexpr (requires { shape.validate(); }) shape.validate();
        pose().validate("Placed");
    }
    void validate_in_plane() const
    {
        if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
        pose().validate_in_plane("Placed");
    }
    /// Distance of its farthest point from the body's reference point [m]; 0 if it is unbounded.
    double reach(int dimension = 3) const
    {
        double const own = detail::reach_of(shape, dimension);
        return own > 0 ? own + norm(position) : 0;
    }

    /// Whether images at a period do not part it: see detail::fits_period.
    bool fits_period(Eigen::Vector3d const& axis, double half, double offset) const
    {
        return detail::fits_period(shape, pose().rotation().transpose() * axis, half,
                                   offset + axis.dot(position));
    }

    Motion pose() const { return {.position = position, .orientation = orientation}; }
};

namespace detail
{
/// A placed shape as a plain value.
template <class ShapeType>
struct PlainPlaced
{
    ShapeType shape{};
    Eigen::Vector3d position{0, 0, 0};
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity(); ///< from the shape's frame to the body's

    template <Lane Real, int d>
        requires HasSurface<ShapeType, Real, d> FIRN_HOST_DEVICE SurfaceSample<Real, d>
        surface(Vector<Real, d> const& x)
    const
    {
        Matrix<Real, d> R;
        Vector<Real, d> away;
        for (int a = 0; a < d; ++a) {
            away[a] = x[a] - Real(static_cast<ScalarOf<Real>>(position[a]));
            for (int b = 0; b < d; ++b) R(a, b) = Real(static_cast<ScalarOf<Real>>(rotation(a, b)));
        }
        SurfaceSample<Real, d> sample = surface_of<Real, d>(shape, transpose_product<Real, d>(R, away));
        sample.normal = product<Real, d>(R, sample.normal);
        return sample;
    }
};

/// Several of them: where they overlap the surface is that of the deepest.
template <class... Shapes>
struct PlainUnion;

template <class First>
struct PlainUnion<First>
{
    static constexpr bool is_sampled = firn::is_sampled<First>;
    PlainPlaced<First> first;

    template <Lane Real, int d>
        requires HasSurface<First, Real, d> FIRN_HOST_DEVICE SurfaceSample<Real, d>
        surface(Vector<Real, d> const& x)
    const { return first.template surface<Real, d>(x); }
};

template <class First, class Second, class... Rest>
struct PlainUnion<First, Second, Rest...>
{
    static constexpr bool is_sampled = firn::is_sampled<First> || PlainUnion<Second, Rest...>::is_sampled;
    PlainPlaced<First> first;
    PlainUnion<Second, Rest...> rest;

    template <Lane Real, int d>
        requires HasSurface<First, Real, d> && HasSurface<PlainUnion<Second, Rest...>, Real, d>
            FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x)
    const
    {
        auto sample = first.template surface<Real, d>(x);
        auto const other = rest.template surface<Real, d>(x);
        Mask<Real> const is_nearer = other.distance < sample.distance;
        sample.distance = select(is_nearer, other.distance, sample.distance);
        for (int a = 0; a < d; ++a) sample.normal[a] = select(is_nearer, other.normal[a], sample.normal[a]);
        return sample;
    }
};
} // namespace detail

/// A solid of several, which may overlap, each at its place in the body's frame. Outside, the distance is the
/// exact one. Inside it is the depth in the deepest of them, which is less than the depth in the union where
/// they overlap.
///
///     firn::Union<firn::Sphere, firn::Capsule> hammer{{{.shape = {0.1}},
///                                                      {.shape = {0.02, 0.2}, .position = {0, -0.3, 0}}}};
template <class... Shapes>
struct Union
{
    static_assert(sizeof...(Shapes) > 0, "a union has at least one shape");
    static_assert(!(false || ... || is_two_sided<Shapes>), "a union is of solids: it has no shells");
    static_assert(!(false || ... || is_deforming<Shapes>),
                  "a shape that changes its form is an obstacle of its own");

    std::tuple<Placed<Shapes>...> parts{};

    void validate() const
    {
        for_each([](auto const& part) { part.validate(); });
    }
    void validate_in_plane() const
    {
        for_each([](auto const& part) { part.validate_in_plane(); });
    }
    /// Distance of its farthest point from the body's reference point [m]; 0 if it is unbounded.
    double reach(int dimension = 3) const
    {
        double farthest = 0;
        bool is_bounded = true;
        for_each([&](auto const& part) {
            double const reach = part.reach(dimension);
            is_bounded = is_bounded && reach > 0;
            farthest = std::max(farthest, reach);
        });
        return is_bounded ? farthest : 0;
    }

    /// Whether images at a period part none of them: see detail::fits_period.
    bool fits_period(Eigen::Vector3d const& axis, double half, double offset) const
    {
        bool fits = true;
        for_each([&](auto const& part) { fits = fits && part.fits_period(axis, half, offset); });
        return fits;
    }

    /// Where its values lie: see SignedDistanceGrid::on.
    static constexpr bool in_host_memory = (false || ... || lies_on_host<Shapes>);

    /// The same as a plain value.
    auto view() const
    {
        return std::apply([](auto const&... part) { return plain(part...); }, parts);
    }

private:
    template <class Use>
    void for_each(Use const& use) const
    {
        std::apply([&](auto const&... part) { (use(part), ...); }, parts);
    }

    template <class First, class... Rest>
    static detail::PlainUnion<detail::Plain<First>, detail::Plain<Rest>...> plain(Placed<First> const& first,
                                                                                  Placed<Rest> const&... rest)
    {
        detail::PlainPlaced<detail::Plain<First>> const of_first{detail::plain(first.shape), first.position,
                                                                 first.pose().rotation()};
        if constexpr (sizeof...(Rest) == 0)
            return {of_first};
        else
            return {of_first, plain(rest...)};
    }
};

} // namespace firn
