// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/fields.hpp>

#include <cstddef>
#include <string_view>
#include <type_traits>

namespace firn
{

/// A set of fields.
template <class... Tags>
struct Fields
{
    /// The number of components in `d` dimensions.
    static constexpr int components([[maybe_unused]] int d) { return (0 + ... + component_count<Tags>(d)); }

    template <class Tag>
    static constexpr bool contains = (std::is_same_v<Tag, Tags> || ...);

    /// Where the components of `Tag` begin among all components.
    template <class Tag>
    static constexpr int first_component(int d)
    {
        static_assert(contains<Tag>, "this table has no such field: none of its policies declares it");
        int first = 0;
        bool found = false;
        ((found = found || std::is_same_v<Tag, Tags>, first += found ? 0 : component_count<Tags>(d)), ...);
        return first;
    }
};

/// Calls `use(tag)` for every field of a set.
template <class... Tags, class Use>
void for_each_tag(Fields<Tags...>, Use const& use)
{
    (use(Tags{}), ...);
}

namespace detail
{
/// Whether each field of a set has another name.
template <class... Tags>
constexpr bool have_own_names(Fields<Tags...>)
{
    std::string_view const names[]{Tags::name..., ""};
    for (std::size_t i = 0; i < sizeof...(Tags); ++i)
        for (std::size_t j = 0; j < i; ++j)
            if (names[i] == names[j]) return false;
    return true;
}

template <class Left, class Right>
struct JoinTwo;

template <class... Left>
struct JoinTwo<Fields<Left...>, Fields<>>
{
    using Type = Fields<Left...>;
};

template <class... Left, class First, class... Rest>
struct JoinTwo<Fields<Left...>, Fields<First, Rest...>>
{
    using Next = std::conditional_t<Fields<Left...>::template contains<First>, Fields<Left...>,
                                    Fields<Left..., First>>;
    using Type = typename JoinTwo<Next, Fields<Rest...>>::Type;
};

template <class... Sets>
struct JoinAll
{
    using Type = Fields<>;
};

template <class First, class... Rest>
struct JoinAll<First, Rest...>
{
    using Type = typename JoinTwo<First, typename JoinAll<Rest...>::Type>::Type;
};

template <class Tag, class Real, int d>
struct Slot
{
    FieldValue<Tag, Real, d> value;
    FIRN_HOST_DEVICE auto& operator[](Tag) { return value; }
    FIRN_HOST_DEVICE auto const& operator[](Tag) const { return value; }
};
} // namespace detail

/// The union of sets of fields, each field once.
template <class... Sets>
using Join = typename detail::JoinAll<Sets...>::Type;

namespace detail
{
template <class Others, class... Tags>
auto without(Fields<Tags...>)
    -> Join<std::conditional_t<Others::template contains<Tags>, Fields<>, Fields<Tags>>...>;
}

/// The fields of a set that are not in another.
template <class Set, class Others>
using Without = decltype(detail::without<Others>(Set{}));

/// The fields that two sets have in common.
template <class Set, class Other>
using Common = Without<Set, Without<Set, Other>>;

/// The fields that all of some sets have in common.
template <class First, class... Rest>
struct CommonToAll
{
    using Type = First;
};
template <class First, class Second, class... Rest>
struct CommonToAll<First, Second, Rest...> : CommonToAll<Common<First, Second>, Rest...>
{};

namespace detail
{
/// The components of one field of a record, counted within a set.
template <class Tag, class Set, int d, class Record, class Use>
FIRN_HOST_DEVICE inline void for_each_component_in(Record& record, Use const& use)
{
    constexpr int first = Set::template first_component<Tag>(d);
    for_each_component<Tag, d>(record[Tag{}], [&](int c, auto& value) { use(first + c, value); });
}

template <class Set, int d, class Record, class Use, class... Tags>
FIRN_HOST_DEVICE inline void for_each_component_of(Record& record, Use const& use, Fields<Tags...>)
{
    (for_each_component_in<Tags, Set, d>(record, use), ...);
}
} // namespace detail

/// Calls `use(component, reference)` for every component of the set's fields in a record that has them, and
/// perhaps others; components are counted within the set.
template <class Set, int d, class Record, class Use>
FIRN_HOST_DEVICE inline void for_each_component_of(Record& record, Use const& use)
{
    detail::for_each_component_of<Set, d>(record, use, Set{});
}

/// The values of a set of fields of one particle (or one lane of particles):
/// `record[DisplacementGradient{}]`.
template <class Real, int d, class Set>
struct Record;

/// The values of at least one field.
template <class Real, int d, class... Tags>
struct Record<Real, d, Fields<Tags...>> : detail::Slot<Tags, Real, d>...
{
    using detail::Slot<Tags, Real, d>::operator[]...;

    /// The record of a body at rest.
    FIRN_HOST_DEVICE static Record at_rest()
    {
        Record record;
        ((record[Tags{}] = value_at_rest<Tags, Real, d>()), ...);
        return record;
    }

    /// Calls `use(component, reference)` for every component of every field.
    template <class Use>
    FIRN_HOST_DEVICE void for_each(Use const& use)
    {
        for_each_component_of<Fields<Tags...>, d>(*this, use);
    }
};

/// No values.
template <class Real, int d>
struct Record<Real, d, Fields<>>
{
    FIRN_HOST_DEVICE static Record at_rest() { return {}; }
    template <class Use>
    FIRN_HOST_DEVICE void for_each(Use const&)
    {}
};

} // namespace firn
