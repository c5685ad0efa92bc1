// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/parameters.hpp>
#include <firn/models/response.hpp>
#include <firn/state/snapshot.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

// Checks whether a scene can go on from a state that was set from outside. `sets` are its MaterialSets.
namespace firn::detail
{

/// Writes the name, density, stiffness and parameters of a material's model into a snapshot.
template <std::size_t k, class Sets>
void name_material(Sets const& sets, MaterialSnapshot<typename Sets::Number, Sets::d>& material)
{
    material.name = name_of_policy<typename Sets::template MaterialTraits<k>::Model>();
    material.density = double(sets.template model<k>().density);
    material.wave_modulus = double(sets.template response_at_rest<k>().wave_modulus);
    material.parameters = parameters_of(sets.template model<k>());
    if constexpr (Sets::are_bodies && k == 0) add_parameters(material.parameters, sets.contact(), "contact.");
}

/// Refuses a snapshot for a value that differs from this solver's.
template <class Value>
[[noreturn]] void refuse_snapshot(std::string const& what, Value const& theirs, Value const& ours,
                                  char const* remedy, char const* call = "Solver::restore")
{
    int digits = 6; // more if needed to tell the values apart
    auto const text = [&](Value const& value) {
        std::ostringstream out;
        out.precision(digits);
        out << value;
        return out.str();
    };
    while (digits < 17 && text(theirs) == text(ours)) ++digits;
    throw Error{"the snapshot has " + what + " " + text(theirs) + ", this solver has " + text(ours), call,
                remedy};
}

inline constexpr auto remedy_of_parameters =
    "Make the solver with the snapshot's parameters; or, if it is to go on with its own, restore a snapshot "
    "whose forget_parameters() was called (read_snapshot has that of a file).";

/// Refuses parameters of a snapshot that differ from those of a policy; `owner` says whose they are in the
/// error. Returns whether the snapshot names all of them. Values may differ by a few roundings of the scene's
/// `Number`s, as compilers do not all compute them alike to the last bit.
template <class Number>
bool compare_parameters(std::string const& owner, std::vector<Parameter> const& theirs,
                        std::vector<Parameter> const& ours, char const* remedy = remedy_of_parameters,
                        char const* call = "Solver::restore")
{
    auto const alike = [](double a, double b, bool whole) {
        double const rounding = whole ? 0 : 8 * double(std::numeric_limits<Number>::epsilon());
        if (!is_number(a) || !is_number(b)) return is_number(a) == is_number(b);
        return exactly_equal(a, b) || (is_finite(a - b) && std::abs(a - b) <= rounding * std::abs(b));
    };
    auto const find = [](auto const& list, std::string const& name) {
        return std::ranges::find(list, name, &Parameter::name);
    };
    for (Parameter const& their : theirs) {
        auto const own = find(ours, their.name);
        if (own == ours.end())
            refuse_snapshot<std::string>(owner + " a parameter", their.name, "none of this name", remedy,
                                         call);
        if (!alike(their.value, own->value, own->is_whole))
            refuse_snapshot(owner + ' ' + their.name + " =", their.value, own->value, remedy, call);
    }
    return std::ranges::all_of(ours,
                               [&](Parameter const& own) { return find(theirs, own.name) != theirs.end(); });
}

/// Refuses the snapshot of another kind of solver. Returns whether it was made with all parameters equal to
/// this solver's, so that its bounds of the next step hold here.
template <class Kernel, class Transfer, class Sets, class Number, int d>
bool require_fits(Snapshot<Number, d> const& from, Sets const& sets, Lattice const& lattice,
                  Transfer const& transfer)
{
    auto const compare = [&]<class Value>(std::string const& what, Value const& theirs, Value const& ours) {
        bool same = exactly_equal(theirs, ours);
        if constexpr (std::is_floating_point_v<Value>)
            same = same && is_number(theirs);
        else if constexpr (requires { all_finite(theirs); })
            same = same && all_finite(theirs);
        if (!same)
            refuse_snapshot(
                what, theirs, ours,
                "Restore into a solver that was made with the same lattice, policies and parameters.");
    };
    compare("the kernel", from.kernel, name_of_policy<Kernel>());
    compare("a kernel of degree", from.kernel_degree, Kernel::degree + 0);
    compare("the transfer", from.transfer, name_of_policy<Transfer>());
    bool all_known = compare_parameters<Number>("for the transfer (" + from.transfer + ")",
                                                from.transfer_parameters, parameters_of(transfer));
    compare("a cell size [m] of", from.lattice.cell_size, lattice.cell_size);
    compare("the origin [m]", from.lattice.origin.transpose().eval(), lattice.origin.transpose().eval());
    char const* const axes[]{"x", "y", "z"};
    for (std::size_t a = 0; a < 3; ++a)
        compare(std::string("a period in cells along ") + axes[a] + " of", from.lattice.periods[a],
                lattice.periods[a]);
    compare("this many materials:", from.materials.size(), Sets::count + 0);
    Sets::for_each([&](auto k) {
        MaterialSnapshot<Number, d> ours;
        name_material<k>(sets, ours);
        auto const& theirs = from.materials[k];
        std::string const place = "material " + std::to_string(k);
        compare("for " + place, theirs.name, ours.name);
        std::string const named = place + " (" + ours.name + ")", owner = "for " + named;
        compare(owner + " the density [kg/m^3]", theirs.density, ours.density);
        if constexpr (Sets::are_bodies && k == 0)
            if (!theirs.parameters.empty() && std::ranges::find(theirs.parameters, "contact.touching",
                                                                &Parameter::name) == theirs.parameters.end())
                refuse_snapshot<std::string>("the contact between bodies",
                                             "none: its materials stick together", "some",
                                             remedy_of_parameters);
        bool const names_all = compare_parameters<Number>(owner, theirs.parameters, ours.parameters);
        bool const any_modulus =
            exactly_equal(theirs.wave_modulus, 0) && !exactly_equal(ours.wave_modulus, 0);
        // some processors' exponentials differ in the last bit
        double const difference = std::abs(theirs.wave_modulus - ours.wave_modulus);
        if (!any_modulus && !(is_finite(difference) && difference <= 1e-5 * ours.wave_modulus))
            refuse_snapshot(owner + " the wave modulus at rest [Pa]", theirs.wave_modulus, ours.wave_modulus,
                            remedy_of_parameters);
        require_same_fields<typename Sets::template MaterialTraits<k>::Table>(theirs, named);
        all_known = all_known && names_all && !any_modulus;
    });
    return all_known;
}

} // namespace firn::detail
