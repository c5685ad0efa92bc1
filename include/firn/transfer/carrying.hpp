// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/parameters.hpp>

#include <array>
#include <cstddef>
#include <limits>
#include <string_view>
#include <type_traits>

// Fields that particles carry through the grid beside mass and motion, such as a temperature. Each is a
// policy, as Conduction is; `Carrying<Mls, Conduction>` is the transfer scheme that carries it. The policy
// says in lists of fields what a particle scatters, what a node holds, and what a particle gathers, and has a
// function for each of the three. Phases, grid memory and mirrored nodes go over the lists.
namespace firn
{

/// In a list of what is scattered or gathered: the term of a node field that goes with the gradient of w_i
/// [per cell]. The field itself stands for the term that goes with w_i.
///
/// Scattered, the vector g of a scalar's term adds g . dw_i to the field. Gathered, it is the gradient of the
/// field: the sum of s_i dw_i. Each component of a vector has such a vector as its row of a matrix.
template <class Tag>
struct GradientTerm
{
    static_assert(Tag::shape == FieldShape::scalar || Tag::shape == FieldShape::vector,
                  "a field of nodes is a scalar or a vector");
    static constexpr auto shape = Tag::shape == FieldShape::scalar ? FieldShape::vector : FieldShape::matrix;
};

namespace detail
{
template <class Term>
struct TermTraits
{
    using Field = Term;
    static constexpr bool has_gradient = false;
};
template <class Tag>
struct TermTraits<GradientTerm<Tag>>
{
    using Field = Tag;
    static constexpr bool has_gradient = true;
};

template <class... Terms>
auto fields_of_terms(Fields<Terms...>) -> Join<Fields<typename TermTraits<Terms>::Field>...>;
template <class... Terms>
auto gradients_of_terms(Fields<Terms...>)
    -> Join<std::conditional_t<TermTraits<Terms>::has_gradient, Fields<typename TermTraits<Terms>::Field>,
                               Fields<>>...>;
} // namespace detail

/// The node field that a term belongs to.
template <class Term>
using FieldOfTerm = typename detail::TermTraits<Term>::Field;

/// The node fields that some terms belong to, each once.
template <class Terms>
using FieldsOfTerms = decltype(detail::fields_of_terms(Terms{}));

/// Those of them that have a GradientTerm.
template <class Terms>
using FieldsOfGradients = decltype(detail::gradients_of_terms(Terms{}));

/// Calls `use(tag)` for every field of a set, on devices, too.
template <class... Tags, class Use>
FIRN_HOST_DEVICE inline void for_each_field(Fields<Tags...>, [[maybe_unused]] Use const& use)
{
    (use(Tags{}), ...);
}

/// The axis of component c of a set, if that is one of a vector; else -1.
template <class... Tags>
FIRN_HOST_DEVICE constexpr int axis_of_component(Fields<Tags...>, [[maybe_unused]] int d,
                                                 [[maybe_unused]] int c)
{
    int axis = -1;
    [[maybe_unused]] int first = 0;
    [[maybe_unused]] auto const look = [&](FieldShape shape, int count) {
        if (shape == FieldShape::vector && c >= first && c < first + count) axis = c - first;
        first += count;
    };
    (look(Tags::shape, component_count<Tags>(d)), ...);
    return axis;
}

namespace detail
{
template <class Policy>
struct CarriedSlot
{
    Policy carried_policy;
};
} // namespace detail

/// Some policies of carried fields, as phases call them: their lists joined, and each of their functions
/// called in turn.
template <class... Policies>
struct CarriedFields : detail::CarriedSlot<Policies>...
{
    using ScatteredTerms = Join<typename Policies::ScatteredTerms...>;
    using NodeFields = Join<typename Policies::NodeFields...>;
    using GatheredTerms = Join<typename Policies::GatheredTerms...>;
    static constexpr bool any = sizeof...(Policies) > 0;

    template <class Policy>
    FIRN_HOST_DEVICE Policy const& get() const
    {
        return static_cast<detail::CarriedSlot<Policy> const&>(*this).carried_policy;
    }

    /// Sets the terms that particles scatter.
    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void scatter([[maybe_unused]] Particle const& particle, [[maybe_unused]] Real mass,
                                  [[maybe_unused]] Real cell_size, [[maybe_unused]] Terms& terms) const
    {
        (get<Policies>().template scatter<Real, d>(particle, mass, cell_size, terms), ...);
    }

    /// Sets what nodes hold, by their sums.
    template <Lane Real, int d, class Sums, class Values>
    FIRN_HOST_DEVICE void update([[maybe_unused]] Sums const& sums, [[maybe_unused]] Real inverse_mass,
                                 [[maybe_unused]] Real dt, [[maybe_unused]] Values& values) const
    {
        (get<Policies>().template update<Real, d>(sums, inverse_mass, dt, values), ...);
    }

    /// Sets the fields of particles by the terms that they gathered.
    template <Lane Real, int d, class Particle, class Terms>
    FIRN_HOST_DEVICE void gather([[maybe_unused]] Particle& particle, [[maybe_unused]] Terms const& terms,
                                 [[maybe_unused]] Real inverse_cell_size) const
    {
        (get<Policies>().template gather<Real, d>(particle, terms, inverse_cell_size), ...);
    }

    /// The largest step [s] at which all fields are stable in cells of this size [m].
    template <class Kernel>
    double largest_step([[maybe_unused]] double cell_size) const
    {
        double largest = std::numeric_limits<double>::infinity();
        [[maybe_unused]] auto const bound = [&](auto const& policy) {
            if constexpr (requires { policy.template largest_step<Kernel>(cell_size); })
                if (double const own = policy.template largest_step<Kernel>(cell_size); own < largest)
                    largest = own;
        };
        (bound(get<Policies>()), ...);
        return largest;
    }
};

namespace detail
{
template <class Policy>
constexpr std::string_view name_in_lists()
{
    if constexpr (requires { std::string_view(Policy::name); })
        return Policy::name;
    else
        return "unnamed";
}

/// Names of policies with commas in between, as a text that ends with 0.
template <class First, class... Rest>
constexpr auto joined_names()
{
    constexpr std::size_t size = (name_in_lists<First>().size() + ... + (2 + name_in_lists<Rest>().size()));
    std::array<char, size + 1> text{};
    std::size_t at = 0;
    auto const add = [&](std::string_view part) {
        for (char const letter : part) text[at++] = letter;
    };
    add(name_in_lists<First>());
    ((add(", "), add(name_in_lists<Rest>())), ...);
    return text;
}
} // namespace detail

/// A transfer scheme that carries fields through the grid beside mass and motion:
///
///     Solver<OpenMP, NeoHookean<Space>, QuadraticBSpline, Carrying<Mls, Conduction>> solver(
///         lattice(h), material, {Mls{}, Conduction{.diffusivity = 1e-4}});
template <class Base, class... Policies>
struct Carrying : Base
{
    static_assert(sizeof...(Policies) > 0, "Carrying<Transfer, Policy...> names what it carries");
    static_assert(
        !requires { typename Base::Carried; }, "list all carried fields in one Carrying");

    using Carried = CarriedFields<Policies...>;
    using State = Join<typename Base::State, typename Policies::State...>;
    using Stored = Join<typename Base::Stored, typename Policies::Stored...>;

    Carried carried;

private:
    static constexpr auto names_ = detail::joined_names<Base, Policies...>();

public:
    static constexpr char const* name = names_.data();

    Carrying() = default;
    Carrying(Base const& base, Policies const&... policies) : Base(base), carried{{policies}...} {}

    /// The scheme's own parameters, and those of each policy behind its name.
    void for_each_parameter(auto const& use) const
    {
        if constexpr (SaysParameters<Base>) Base::for_each_parameter(use);
        auto const add = [&]<class Policy>(Policy const& policy) {
            if constexpr (SaysParameters<Policy>) use(Policy::name, policy);
        };
        (add(carried.template get<Policies>()), ...);
    }

    void validate() const
    {
        auto const ask = [](auto const& policy) {
            if constexpr (requires { policy.validate(); }) policy.validate();
        };
        ask(static_cast<Base const&>(*this));
        (ask(carried.template get<Policies>()), ...);
    }
};

/// `Carrying{Mls{}, Conduction{}}` is a Carrying<Mls, Conduction>.
template <class Base, class... Policies>
Carrying(Base, Policies...) -> Carrying<Base, Policies...>;

namespace detail
{
template <class Transfer>
struct CarriedByTransfer
{
    using Type = CarriedFields<>;
};
template <class Transfer>
    requires requires { typename Transfer::Carried; }
struct CarriedByTransfer<Transfer>
{
    using Type = typename Transfer::Carried;
};
} // namespace detail

/// The CarriedFields of a transfer scheme: of most there are none.
template <class Transfer>
using CarriedBy = typename detail::CarriedByTransfer<Transfer>::Type;

/// The same with its parameters.
template <class Transfer>
FIRN_HOST_DEVICE inline CarriedBy<Transfer> carried_by([[maybe_unused]] Transfer const& transfer)
{
    if constexpr (CarriedBy<Transfer>::any)
        return transfer.carried;
    else
        return {};
}

} // namespace firn
