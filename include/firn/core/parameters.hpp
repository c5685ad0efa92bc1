// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#include <algorithm>
#include <string>
#include <type_traits>
#include <vector>

// The parameters of a policy by name, so that no scene goes on with other ones unnoticed: see Snapshot.
//
// A material names its parameters except the density, a plastic flow and a transfer scheme all of theirs, by
// one member:
//
//     void for_each_parameter(auto const& use) const { use("yield_stress", yield_stress); }
//
// A parameter is a number (an integer no larger than 2^53), or has this member itself (Lame). A policy
// without it names none: then only a material's density and its wave modulus at rest are compared. A policy
// that is derived from one with parameters names those of its base first, then its own:
//
//     void for_each_parameter(auto const& use) const { Sand::for_each_parameter(use); use("own", own); }
namespace firn
{

/// A named value of a policy.
struct Parameter
{
    std::string name; ///< of the member, with what it is a member of: "elasticity.mu"
    double value = 0; ///< in its SI unit
    /// An integer or an enumeration: nothing is rounded. Known of a solver's parameters, not of a snapshot's.
    bool is_whole = false;
};

/// Whether a policy names its parameters. Checked for a policy that is not const: a missing `const` is then
/// an error where parameters are read, and does not hide them.
template <class Policy>
concept SaysParameters = requires(Policy policy, void (*use)(char const*, double))
{
    policy.for_each_parameter(use);
};

namespace detail
{

/// A policy's name.
template <class Policy>
std::string name_of_policy()
{
    if constexpr (requires { std::string(Policy::name); })
        return Policy::name;
    else
        return "unnamed";
}

/// Adds the parameters of a policy, if it names some.
template <class Policy>
void add_parameters(std::vector<Parameter>& to, Policy const& policy, std::string const& within = {})
{
    if constexpr (SaysParameters<Policy>)
        policy.for_each_parameter([&]<class Value>(char const* name, Value const& value) {
            if constexpr (std::is_arithmetic_v<Value> || std::is_enum_v<Value>)
                to.push_back({within + name, static_cast<double>(value), !std::is_floating_point_v<Value>});
            else {
                static_assert(SaysParameters<Value>,
                              "a parameter is a number, or has a member for_each_parameter itself");
                add_parameters(to, value, within + name + '.');
            }
        });
}

/// The parameters of a policy; throws an Error if two have the same name.
template <class Policy>
std::vector<Parameter> parameters_of(Policy const& policy)
{
    std::vector<Parameter> all;
    add_parameters(all, policy);
    for (auto at = all.begin(); at != all.end(); ++at)
        if (std::ranges::find(all.begin(), at, at->name, &Parameter::name) != at)
            throw Error{"two parameters are called " + at->name, "for_each_parameter",
                        "Say each by a name of its own."};
    return all;
}

} // namespace detail

} // namespace firn
