// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/shapes/all.hpp>
#include <firn/effects/shapes/images.hpp>
#include <firn/effects/shapes/shape.hpp>

#include <concepts>
#include <tuple>
#include <type_traits>
#include <utility>
#include <variant>

namespace firn
{

namespace detail
{
/// One of several shapes, as a plain value: `which` says which of them counts.
template <class... Shapes>
struct PlainAnyShape;

template <class First>
struct PlainAnyShape<First>
{
    static constexpr bool is_sampled = firn::is_sampled<First>;
    static_assert(std::is_default_constructible_v<First>,
                  "a shape of an AnyShape, as loops know it, has a value by default: it lacks a constructor "
                  "without arguments");
    First first{};

    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> of(int, Vector<Real, d> const& x) const
    {
        return surface_of<Real, d>(first, x);
    }
};

template <class First, class Second, class... Rest>
struct PlainAnyShape<First, Second, Rest...>
{
    static constexpr bool is_sampled = firn::is_sampled<First> || PlainAnyShape<Second, Rest...>::is_sampled;
    PlainAnyShape<First> head{};
    PlainAnyShape<Second, Rest...> tail{};

    template <Lane Real, int d>
    FIRN_HOST_DEVICE SurfaceSample<Real, d> of(int which, Vector<Real, d> const& x) const
    {
        return which == 0 ? head.template of<Real, d>(0, x) : tail.template of<Real, d>(which - 1, x);
    }
};

/// The same with the number of the shape that counts.
template <class... Shapes>
struct ChosenShape
{
    static constexpr bool is_sampled = PlainAnyShape<Shapes...>::is_sampled;
    PlainAnyShape<Shapes...> all{};
    int which = 0;

    template <Lane Real, int d>
        requires(HasSurface<Shapes, Real, d>&&...)
    FIRN_HOST_DEVICE SurfaceSample<Real, d> surface(Vector<Real, d> const& x)
    const { return all.template of<Real, d>(which, x); }
};
template <class... Types>
inline constexpr bool are_different = true;
template <class First, class... Rest>
inline constexpr bool are_different<First, Rest...> =
    !(false || ... || std::same_as<First, Rest>)&&are_different<Rest...>;

/// The library's plain shapes and others.
template <class Library, class... Own>
struct ShapesToChoose;
template <class... Library, class... Own>
struct ShapesToChoose<std::tuple<Library...>, Own...>
{
    using Variant = std::variant<Library..., Own...>;
    /// Whether no two of them are the same as loops know them.
    static constexpr bool differ = are_different<Library..., Plain<Own>...>;
    using Chosen = ChosenShape<Library..., Plain<Own>...>;
};
} // namespace detail

/// A solid whose kind is chosen when the program runs: one of the library's plain shapes (HalfSpace, Sphere,
/// Capsule, Box) or of `Own`, such as a SignedDistanceGrid or a shape of your program.
///
///     firn::AnyShape<firn::SignedDistanceGrid<float, 3>> shape = firn::Sphere{0.2};
///
/// It costs a branch where a shape of one type costs none. A two-sided one is Shell<AnyShape<Own...>>.
template <class... Own>
class AnyShape
{
    using Shapes = detail::ShapesToChoose<AllPlainShapes, Own...>;
    using Variant = typename Shapes::Variant;
    static_assert(!(false || ... || is_two_sided<Own>),
                  "a shell of any shape is Shell<AnyShape<...>>: AnyShape has solids alone");
    static_assert(
        !(false || ... || is_deforming<Own>),
        "a shape that changes its form is an obstacle of its own, or Obstacles<DeformingGrid<...>>");

public:
    static constexpr bool in_host_memory = (false || ... || lies_on_host<Own>);

    static_assert(Shapes::differ,
                  "two shapes of an AnyShape are the same type, or the same as plain values: name one "
                  "of them, or wrap it into a shape of its own");

    AnyShape() = default;
    /// A shape of one of its types.
    template <class ShapeType>
        requires(!std::same_as<std::remove_cvref_t<ShapeType>, AnyShape> &&
                 std::constructible_from<Variant, ShapeType>)
    AnyShape(ShapeType&& shape) : shape_(std::forward<ShapeType>(shape)) {}

    /// The shape as its own type, or nullptr if it is of another one.
    template <class ShapeType>
    ShapeType* as()
    {
        return std::get_if<ShapeType>(&shape_);
    }
    template <class ShapeType>
    ShapeType const* as() const
    {
        return std::get_if<ShapeType>(&shape_);
    }

    void validate() const
    {
        std::visit(
            [](auto const& shape) {
                if constexpr (requires { shape.validate(); }) shape.validate();
            },
            shape_);
    }
    void validate_in_plane() const
    {
        std::visit(
            [](auto const& shape) {
                if constexpr (requires { shape.validate_in_plane(); }) shape.validate_in_plane();
            },
            shape_);
    }
    /// Distance of its farthest point from the reference point [m]; 0 if it is unbounded.
    double reach(int dimension = 3) const
    {
        return std::visit([&](auto const& shape) { return detail::reach_of(shape, dimension); }, shape_);
    }

    /// The normal of a plane that it lies below: see detail::upper_side_of.
    Eigen::Vector3d upper_side() const
    {
        return std::visit([](auto const& shape) { return detail::upper_side_of(shape); }, shape_);
    }

    /// Whether images at a period do not part it: see detail::fits_period.
    bool fits_period(Eigen::Vector3d const& axis, double half, double offset) const
    {
        return std::visit([&](auto const& shape) { return detail::fits_period(shape, axis, half, offset); },
                          shape_);
    }

    /// The same as a plain value.
    auto view() const
    {
        typename Shapes::Chosen plain;
        plain.which = static_cast<int>(shape_.index());
        std::visit([&](auto const& shape) { set(plain.all, detail::plain(shape)); }, shape_);
        return plain;
    }

private:
    template <class First, class... Rest, class ShapeType>
    static void set(detail::PlainAnyShape<First, Rest...>& all, ShapeType const& shape)
    {
        if constexpr (sizeof...(Rest) == 0) {
            if constexpr (std::same_as<First, ShapeType>) all.first = shape;
        }
        else if constexpr (std::same_as<First, ShapeType>)
            all.head.first = shape;
        else
            set(all.tail, shape);
    }

    Variant shape_{};
};

} // namespace firn
