// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <cstddef>
#include <limits>
#include <sstream>
#include <string>
#include <type_traits>

// Policies declare what a particle stores: each names the fields that it needs, and the table of particles is
// their union. A field is a tag type with a name and a shape. A scalar field may also have a value `at_rest`,
// 0 by default, and the `range` of what may be uploaded and restored.
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
    matrix
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
    }
    return 0;
}

/// The value of a field: a number, a Vector or a Matrix of lanes.
template <class Tag, class Real, int d>
using FieldValue = std::conditional_t<
    Tag::shape == FieldShape::scalar, Real,
    std::conditional_t<Tag::shape == FieldShape::vector, Vector<Real, d>, Matrix<Real, d>>>;

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
    else if constexpr (Tag::shape == FieldShape::vector)
        return value[c];
    else
        return value(c / d, c % d);
}

/// The value of a field of a body at rest: its `at_rest`, or zero.
template <class Tag, class Real, int d>
FIRN_HOST_DEVICE inline FieldValue<Tag, Real, d> value_at_rest()
{
    if constexpr (Tag::shape != FieldShape::scalar)
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
}

} // namespace firn
