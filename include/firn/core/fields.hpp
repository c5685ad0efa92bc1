// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <type_traits>

// Policies declare what a particle stores: each names the fields that it needs, and the table of particles is
// their union. A field is a tag type with a name and a shape. A scalar field may also have a value `at_rest`,
// 0 by default, and the `range` of what may be uploaded and restored; an integer a value `at_rest`.
namespace firn
{

/// The values that a scalar field may have.
struct FieldRange
{
    double above = -std::numeric_limits<double>::infinity();    ///< this one excluded
    double at_least = -std::numeric_limits<double>::infinity(); ///< this one included
    double at_most = std::numeric_limits<double>::infinity();
};

/// How many components a field has in `d` dimensions.
enum class FieldShape
{
    scalar,
    vector,
    matrix,
    integer ///< from 0 to 2^32 - 1, stored as two numbers of 16 bits each, which a float holds exactly
};

/// Velocity [m/s].
struct Velocity
{
    static constexpr auto name = "velocity";
    static constexpr auto shape = FieldShape::vector;
};

/// The affine matrix C of APIC [1/s].
struct AffineVelocity
{
    static constexpr auto name = "affine_velocity";
    static constexpr auto shape = FieldShape::matrix;
};

/// H = F - I, the displacement gradient, F being the deformation gradient, or F_E where there is plasticity
/// [-].
///
/// Stored instead of F, which in single precision sees no change below 6e-8 per step and lets a body at rest
/// creep.
struct DisplacementGradient
{
    static constexpr auto name = "displacement_gradient";
    static constexpr auto shape = FieldShape::matrix;
};

/// J_P = det F_P, the volume ratio of the plastic part of the deformation [-].
struct PlasticVolumeRatio
{
    static constexpr auto name = "plastic_volume_ratio";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr double at_rest = 1;
    static constexpr FieldRange range{.above = 0};
};

/// ln J, J being the volume ratio of a fluid [-].
struct LogVolumeRatio
{
    static constexpr auto name = "log_volume_ratio";
    static constexpr auto shape = FieldShape::scalar;
};

/// alpha of Cam-Clay less its value at the start: the sum of the logarithms of the volume ratios by which
/// plastic flow opened or compacted the material [-].
struct LogPlasticVolumeRatio
{
    static constexpr auto name = "log_plastic_volume_ratio";
    static constexpr auto shape = FieldShape::scalar;
};

/// The equivalent plastic strain: the sum of sqrt(2/3) |d eps_p| [-].
struct EquivalentPlasticStrain
{
    static constexpr auto name = "equivalent_plastic_strain";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr FieldRange range{.at_least = 0};
};

/// v_c: the logarithmic volume that loose grains have gained, and lose again before they bear load [-].
struct LooseVolume
{
    static constexpr auto name = "loose_volume";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr FieldRange range{.at_least = 0};
};

/// The factor of a particle's own moduli in a heterogeneous material [-].
struct Stiffness
{
    static constexpr auto name = "stiffness";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr double at_rest = 1;
    static constexpr FieldRange range{.above = 0};
};

/// The number of components of a field in `d` dimensions.
template <class Tag>
constexpr int component_count(int d)
{
    switch (Tag::shape) {
    case FieldShape::scalar:
        return 1;
    case FieldShape::vector:
        return d;
    case FieldShape::matrix:
        return d * d;
    case FieldShape::integer:
        return 2;
    }
    return 0;
}

namespace detail
{
template <FieldShape shape, class Real, int d>
struct ValueOfShape
{
    using Type = Matrix<Real, d>;
};
template <class Real, int d>
struct ValueOfShape<FieldShape::scalar, Real, d>
{
    using Type = Real;
};
template <class Real, int d>
struct ValueOfShape<FieldShape::vector, Real, d>
{
    using Type = Vector<Real, d>;
};
template <class Real, int d>
struct ValueOfShape<FieldShape::integer, Real, d>
{
    using Type = Vector<Real, 2>;
};
} // namespace detail

/// The value of a field: a number, a Vector or a Matrix of lanes; of an integer its halves, the lower first.
template <class Tag, class Real, int d>
using FieldValue = typename detail::ValueOfShape<Tag::shape, Real, d>::Type;

/// A field of integers.
template <class Tag>
concept IntegerField = Tag::shape == FieldShape::integer;

/// The integer of a particle's field, for one number and not a pack: `integer_of(particle[Handle{}]) == 7`.
template <class Number>
FIRN_HOST_DEVICE inline std::uint32_t integer_of(Vector<Number, 2> const& halves)
{
    return static_cast<std::uint32_t>(halves[0]) + (static_cast<std::uint32_t>(halves[1]) << 16);
}

/// The halves in which an integer is stored.
template <class Real>
FIRN_HOST_DEVICE inline Vector<Real, 2> halves_of(std::uint32_t integer)
{
    using Number = ScalarOf<Real>;
    return {Real(static_cast<Number>(integer & 0xffffu)), Real(static_cast<Number>(integer >> 16))};
}

/// Calls `use(component, reference)` for each component of a field's value, row by row.
template <class Tag, int d, class Value, class Use>
FIRN_HOST_DEVICE inline void for_each_component(Value& value, Use const& use)
{
    if constexpr (Tag::shape == FieldShape::scalar) {
        use(0, value);
    }
    else if constexpr (Tag::shape == FieldShape::vector) {
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) use(i, value[i]);
    }
    else if constexpr (Tag::shape == FieldShape::integer) {
        use(0, value[0]);
        use(1, value[1]);
    }
    else {
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) FIRN_UNROLL
        for (int j = 0; j < d; ++j) use(i * d + j, value(i, j));
    }
}

/// One component of a field's value, by its number there.
template <class Tag, int d, class Value>
auto& component_of(Value& value, int c)
{
    if constexpr (Tag::shape == FieldShape::scalar)
        return value;
    else if constexpr (Tag::shape == FieldShape::vector || Tag::shape == FieldShape::integer)
        return value[c];
    else
        return value(c / d, c % d);
}

/// The value of a field of a body at rest: its `at_rest`, or zero.
template <class Tag, class Real, int d>
FIRN_HOST_DEVICE inline FieldValue<Tag, Real, d> value_at_rest()
{
    if constexpr (IntegerField<Tag> && requires { Tag::at_rest; })
        return halves_of<Real>(Tag::at_rest);
    else if constexpr (Tag::shape != FieldShape::scalar)
        return zeros<FieldValue<Tag, Real, d>>();
    else if constexpr (requires { Tag::at_rest; })
        return Real(static_cast<ScalarOf<Real>>(Tag::at_rest));
    else
        return Real(0);
}

/// Throws an Error unless a component of a field is finite and in the field's range; `where()` is called only
/// then.
template <class Tag, class Where>
void require_valid(double value, Where const& where, char const* remedy)
{
    constexpr FieldRange range = [] {
        if constexpr (requires { Tag::range; })
            return Tag::range;
        else
            return FieldRange{};
    }();
    static_assert(
        Tag::shape == FieldShape::scalar || !requires { Tag::range; }, "only a scalar has a range");
    auto const require_that = [&](bool condition, char const* what, double bound) {
        if (condition) return;
        std::ostringstream text;
        text << "a value of '" << Tag::name << "' is " << what;
        if (is_finite(bound)) text << ' ' << bound;
        throw Error{text.str(), where(), remedy};
    };
    require_that(is_finite(value), "not finite", value);
    require_that(value > range.above, "not above", range.above);
    require_that(value >= range.at_least, "below", range.at_least);
    require_that(value <= range.at_most, "above", range.at_most);
    if constexpr (IntegerField<Tag>)
        require_that(value >= 0 && value <= 0xffff && std::floor(value) >= value,
                     "not half of an integer from 0 to", 0xffffffff);
}

} // namespace firn
