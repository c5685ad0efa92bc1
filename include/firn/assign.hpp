// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/fields.hpp>
#include <firn/effects/shapes/images.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <vector>

// One value of a field for some particles, while the others keep theirs: for those of some ids, those at some
// places, or all of a material. In a scene of several materials a call is about one of them:
// `assign<Mark, Snow>(solver, 1)`. Each call costs as much as an upload.
namespace firn
{

namespace detail
{
template <class Tag, class... Which, class Solver>
void assign_at(Solver& solver, std::vector<std::size_t> const& places,
               FieldValue<Tag, double, Solver::d> const& value)
{
    static_assert(!IntegerField<Tag>, "integers are uploaded: see upload_from()");
    using Number = typename Solver::Number;
    constexpr int d = Solver::d;
    auto values =
        solver.template download<Tag, Which...>(); // in the scene's numbers: the others keep their bits
    for (std::size_t const place : places)
        for_each_component<Tag, d>(values[place], [&](int c, Number& number) {
            number = static_cast<Number>(component_of<Tag, d>(value, c));
        });
    solver.template upload<Tag, Which...>(values);
}
} // namespace detail

/// Sets a field of the particles with these ids, a range such as std::vector<std::uint32_t>. Throws an Error,
/// and changes nothing, if there is no id, no particle with one of them, or the field may not have the value.
template <class Tag, class... Which, class Solver, class Ids>
    requires requires(Ids const& ids) { std::uint32_t{*std::begin(ids)}; }
void assign(Solver& solver, Ids const& ids, FieldValue<Tag, double, Solver::d> const& value)
{
    auto const all = solver.template ids<Which...>();
    std::vector<std::size_t> places;
    for (std::uint32_t const id : ids) {
        auto const found = std::ranges::lower_bound(all, id);
        if (found == all.end() || *found != id)
            throw Error{"there is no particle with the id " + std::to_string(id),
                        "assign, id " + std::to_string(places.size()),
                        "Pass ids that add() or ids() has returned, of the material that the call is about."};
        places.push_back(static_cast<std::size_t>(found - all.begin()));
    }
    require(!places.empty(), "there is no id of a particle whose field is to be set", "assign",
            "Pass ids, or leave them out for all particles of a material.");
    detail::assign_at<Tag, Which...>(solver, places, value);
}

/// Sets a field of the particles whose positions [m] a predicate is true for, such as `Inside<Box>{...}`.
/// Returns how many there are. Throws an Error, and changes nothing, if there is none, the predicate is
/// invalid, or the field may not have the value.
template <class Tag, class... Which, class Solver, class Where>
    requires requires(Where const& where, Vector<double, Solver::d> const& x) { bool{where(x)}; }
std::size_t assign(Solver& solver, Where const& where, FieldValue<Tag, double, Solver::d> const& value)
{
    if constexpr (requires { where.validate(); }) where.validate();
    if constexpr (Solver::d == 2 && requires { where.validate_in_plane(); }) where.validate_in_plane();
    auto const is_there = [&] {
        if constexpr (requires { solver.lattice(); }) // of Worlds none is periodic
            return detail::with_images<Solver::d>(where, solver.lattice());
        else
            return where;
    }();
    auto const positions = solver.template positions<Which...>();
    std::vector<std::size_t> places;
    for (std::size_t i = 0; i < positions.size(); ++i)
        if (is_there(positions[i])) places.push_back(i);
    require(!places.empty(), "no particle lies where a field is to be set", "assign",
            "Let the region hold particles, in metres.");
    detail::assign_at<Tag, Which...>(solver, places, value);
    return places.size();
}

/// Sets a field of all particles of a material. Throws an Error, and changes nothing, if the field may not
/// have the value.
template <class Tag, class... Which, class Solver>
void assign(Solver& solver, FieldValue<Tag, double, Solver::d> const& value)
{
    std::vector<std::size_t> places(solver.template size<Which...>());
    for (std::size_t i = 0; i < places.size(); ++i) places[i] = i;
    detail::assign_at<Tag, Which...>(solver, places, value);
}

} // namespace firn
