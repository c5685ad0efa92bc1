// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/transfer/carrying.hpp>
#include <firn/transfer/node_fields.hpp>

namespace firn
{

/// How much of a particle belongs to those that an effect is about: 0, unless told otherwise, to 1. A scene
/// with several such groups derives a mark of its own name for each:
///
///     struct Grip : Mark
///     {
///         static constexpr auto name = "grip";
///     };
struct Mark
{
    static constexpr auto name = "mark";
    static constexpr auto shape = FieldShape::scalar;
    static constexpr FieldRange range{.at_least = 0, .at_most = 1};
};

/// Lets effects act on marked particles alone: nodes know how much of their mass is marked.
/// `Carrying<Mls, Marks<Mark>>` is a transfer with it; several marks, as `Marks<Grip, Charged>`, do not know
/// of each other.
///
///   M_i = sum_p w_ip m_p mark_p
///
/// A mark costs a number of each particle and one of each node.
template <class... Tags>
struct Marks
{
    static_assert(sizeof...(Tags) > 0, "Marks<Tag...> names the marks: firn::Mark, or your own");
    static_assert(
        ((Tags::shape == FieldShape::scalar && Tags::range.at_least >= 0 && Tags::range.at_most <= 1) && ...),
        "a mark is a scalar from 0 to 1: derive yours from firn::Mark");

    static constexpr auto name = "marks";
    using State = Fields<Tags...>;
    using Stored = Fields<Tags...>;
    using ScatteredTerms = Fields<NodeMark<Tags>...>;
    using NodeFields = Fields<>;
    using GatheredTerms = Fields<>;

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter(Particle const& particle, Real mass, Real, Terms& terms) const
    {
        ((terms[NodeMark<Tags>{}] = particle[Tags{}] * mass), ...);
    }

    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update(Sums const&, Real, Real, Values&) const
    {}

    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather(Particle&, Terms const&, Real) const
    {}
};

} // namespace firn
