// SPDX-License-Identifier: MIT
#pragma once

#include <tuple>
#include <type_traits>

// Loops over the library's lists of policies, so that what is added to a list is measured.
namespace firn::bench
{

/// Calls `use<Type>()` for each type of a list.
template <class List, class Use>
void for_each_type(Use const& use)
{
    [&]<class... Listed>(std::type_identity<std::tuple<Listed...>>) {
        (use.template operator()<Listed>(), ...);
    }(std::type_identity<List>{});
}

/// Whether a type is one of these.
template <class Type, class... Others>
inline constexpr bool is_one_of = (std::is_same_v<Type, Others> || ...);

} // namespace firn::bench
