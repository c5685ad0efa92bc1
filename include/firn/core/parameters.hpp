// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>

#include <algorithm>
#include <string>
#include <type_traits>
#include <vector>

// The parameters of a policy by name, so that no scene goes on with others unnoticed: see Snapshot.
//
// A material says those beside its density, a plastic flow and a transfer scheme all of theirs, by one
// member:
//
//     void for_each_parameter(auto const& use) const { use("yield_stress", yield_stress); }
//
// A parameter is a number (an integer no larger than 2^53), or something that says its own (Lame). Who has no
// such member says none: then they are not compared, but for a material's density and its wave modulus at
// rest. A policy that is derived from one that has it says both, those of its base first:
//
//     void for_each_parameter(auto const& use) const { Sand::for_each_parameter(use); use("own", own); }
namespace firn
{

/// One of them.
struct Parameter
{
    std::string name; ///< of the member, behind that in which it is: "elasticity.mu"
    double value = 0; ///< in its SI unit
    /// Of an integer or an enumeration: nothing is rounded. (A snapshot does not say so, a solver does.)
    bool is_whole = false;
};

/// Whether a policy says its parameters. (Asked of one that may change: to have forgotten `const` is an error
/// where they are said, not a policy without parameters.)
template <class Policy>
concept SaysParameters = requires(Policy policy, void (*use)(char const*, double))
{
    policy.for_each_parameter(use);
};

namespace detail
{

/// Adds those of a policy, if it says some.
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

/// Those of a policy, by names that differ.
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
