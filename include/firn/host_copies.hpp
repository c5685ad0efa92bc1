// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/fields.hpp>
#include <firn/core/host_arrays.hpp>
#include <firn/models/several_materials.hpp>

#include <algorithm>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <string>
#include <type_traits>
#include <vector>

// What a host reads and writes in its own memory and its own types, whatever the backend: a pointer with a
// count and a stride, or an array of values that are floats or doubles and nothing else (HostValue). Where
// the solver's loops reach that memory, and the numbers are the solver's, nothing is copied in between.
namespace firn
{

namespace detail
{
/// Stands for the position of a particle in what goes over components.
struct PositionField
{
    static constexpr auto shape = FieldShape::vector;
};

/// Refuses an array of a host that has not one value for each particle.
inline void require_host_array(void const* array, std::size_t count, std::size_t particles,
                               std::size_t stride, int components, char const* where)
{
    if (count != particles)
        throw Error{"there is room for " + std::to_string(count) + " values, and there are " +
                        std::to_string(particles) + " particles",
                    where, "Pass an array of size() values, by rising id."};
    require(array != nullptr || count == 0, "there is no array", where,
            "Pass a pointer to the first number of the first value.");
    if (stride < std::size_t(components))
        throw Error{"the values of neighbours overlap", where,
                    "Pass a stride, in numbers, of " + std::to_string(components) + " or more."};
}

/// Writes values to an array of a host.
template <class Tag, int d, class Values, class Number>
void copy_to_host(Values const& values, Number* to, std::size_t stride)
{
    for (std::size_t i = 0; i < values.size(); ++i)
        for_each_component<Tag, d>(values[i], [&](int c, auto const& value) {
            to[i * stride + std::size_t(c)] = static_cast<Number>(value);
        });
}

/// Whether an array of a host can hold values of a field.
template <class Tag, int d, class Array>
inline constexpr bool holds_values = HostArray<Array, component_count<Tag>(d)>;
template <IntegerField Tag, int d, class Array>
inline constexpr bool holds_values<Tag, d, Array> = requires(Array& array)
{
    std::size(array);
    requires std::same_as<std::remove_cvref_t<decltype(*std::data(array))>, std::uint32_t>;
};

/// What the values of such an array consist of.
template <class Tag, class Value>
using NumberOfHost = typename std::conditional_t<IntegerField<Tag>, std::type_identity<std::uint32_t>,
                                                 std::type_identity<firn::NumberIn<Value>>>::type;

/// Whether Solver::write can write such numbers for these particles to memory of the host.
template <class Solver, class Which, class Number>
inline constexpr bool writes_to_host =
    std::remove_cvref_t<decltype(std::declval<Solver const&>().backend())>::reaches_host_memory&&
        std::is_same_v<Number, typename Solver::Number> &&
    (Solver::materials == 1 || !std::is_same_v<Which, EveryMaterial>);
} // namespace detail

/// Copies world positions [m], by rising id, to an array of a host: axis a of the i-th particle goes to
/// `to[i * stride + a]`. Throws an Error unless `count` is the number of particles.
template <class Which = EveryMaterial, class Solver, std::floating_point Number>
void download_positions(Solver const& solver, Number* to, std::size_t count, std::size_t stride = Solver::d)
{
    detail::require_host_array(to, count, solver.template size<Which>(), stride, Solver::d,
                               "download_positions");
    if constexpr (detail::writes_to_host<Solver, Which, Number>)
        solver.template write_positions<Which>(to, stride);
    else
        detail::copy_to_host<detail::PositionField, Solver::d>(solver.template positions<Which>(), to,
                                                               stride);
}

/// The same to an array of the host's own vectors, such as std::span<Vec3>.
template <class Which = EveryMaterial, class Solver, class Array>
void download_positions(Solver const& solver, Array&& to)
{
    static_assert(HostArray<Array, Solver::d>,
                  "an array of positions has a size, and vectors of as many floats or doubles as the scene "
                  "has dimensions, with no padding: see HostValue in firn/core/host_arrays.hpp");
    using Number = NumberIn<std::remove_cvref_t<decltype(*std::data(to))>>;
    download_positions<Which>(solver, reinterpret_cast<Number*>(std::data(to)), std::size(to));
}

/// Copies integers, by rising id, to an array of a host: that of the i-th particle goes to `to[i * stride]`.
template <IntegerField Tag, class Which = EveryMaterial, class Solver>
void download(Solver const& solver, std::uint32_t* to, std::size_t count, std::size_t stride = 1)
{
    detail::require_host_array(to, count, solver.template size<Which>(), stride, 1, "download");
    auto const values = solver.template download<Tag, Which>();
    for (std::size_t i = 0; i < count; ++i) to[i * stride] = integer_of(values[i]);
}

/// Copies what Solver::download returns to an array of a host: component c (of matrices row by row) of the
/// i-th particle goes to `to[i * stride + c]`. Throws an Error unless `count` is the number of particles.
template <class Tag, class Which = EveryMaterial, class Solver, std::floating_point Number>
void download(Solver const& solver, Number* to, std::size_t count,
              std::size_t stride = std::size_t(component_count<Tag>(Solver::d)))
{
    detail::require_host_array(to, count, solver.template size<Which>(), stride,
                               component_count<Tag>(Solver::d), "download");
    if constexpr (detail::writes_to_host<Solver, Which, Number>)
        solver.template write<Tag, Which>(to, stride);
    else
        detail::copy_to_host<Tag, Solver::d>(solver.template download<Tag, Which>(), to, stride);
}

/// The same to an array of the host's own values: std::span<Vec3>, or floats for a scalar field and
/// std::uint32_t for integers.
template <class Tag, class Which = EveryMaterial, class Solver, class Array>
void download(Solver const& solver, Array&& to)
{
    static_assert(detail::holds_values<Tag, Solver::d, Array>,
                  "an array of a field's values has a size, and values of as many floats or doubles as the "
                  "field has components, with no padding: see HostValue in firn/core/host_arrays.hpp; of "
                  "integers it has std::uint32_t");
    using Number = detail::NumberOfHost<Tag, std::remove_cvref_t<decltype(*std::data(to))>>;
    download<Tag, Which>(solver, reinterpret_cast<Number*>(std::data(to)), std::size(to));
}

/// Sets a field of all particles of a material, by rising id, from an array of a host: component c (of
/// matrices row by row) of the i-th particle is `from[i * stride + c]`. See Solver::upload.
template <class Tag, class Which = EveryMaterial, class Solver, std::floating_point Number>
void upload(Solver& solver, Number const* from, std::size_t count,
            std::size_t stride = std::size_t(component_count<Tag>(Solver::d)))
{
    constexpr int d = Solver::d;
    detail::require_host_array(from, count, solver.template size<Which>(), stride, component_count<Tag>(d),
                               "upload");
    std::vector<FieldValue<Tag, typename Solver::Number, d>> values(
        count, value_at_rest<Tag, typename Solver::Number, d>());
    for (std::size_t i = 0; i < count; ++i)
        for_each_component<Tag, d>(values[i], [&](int c, typename Solver::Number& value) {
            value = static_cast<typename Solver::Number>(from[i * stride + std::size_t(c)]);
        });
    solver.template upload<Tag, Which>(values);
}

/// Sets a field of integers of all particles of a material, by rising id: that of the i-th is
/// `from[i * stride]`.
template <IntegerField Tag, class Which = EveryMaterial, class Solver>
void upload(Solver& solver, std::uint32_t const* from, std::size_t count, std::size_t stride = 1)
{
    using Number = typename Solver::Number;
    detail::require_host_array(from, count, solver.template size<Which>(), stride, 1, "upload");
    std::vector<Vector<Number, 2>> values;
    values.reserve(count);
    for (std::size_t i = 0; i < count; ++i) values.push_back(halves_of<Number>(from[i * stride]));
    solver.template upload<Tag, Which>(values);
}

/// The same from an array of the host's own values; of integers, std::uint32_t.
template <class Tag, class Which = EveryMaterial, class Solver, class Array>
void upload(Solver& solver, Array const& from)
{
    static_assert(detail::holds_values<Tag, Solver::d, Array const>,
                  "an array of a field's values has a size, and values of as many floats or doubles as the "
                  "field has components, with no padding: see HostValue in firn/core/host_arrays.hpp; of "
                  "integers it has std::uint32_t");
    using Number = detail::NumberOfHost<Tag, std::remove_cvref_t<decltype(*std::data(from))>>;
    upload<Tag, Which>(solver, reinterpret_cast<Number const*>(std::data(from)), std::size(from));
}

/// Sets a field of the particles of a material from an id on, by rising id: of those that Solver::add has
/// just added and returned the first id of. All others keep theirs. Throws an Error, and changes nothing,
/// unless that particle is there and there is one value for each of them.
template <class Tag, class Which = EveryMaterial, class Solver, class Array>
void upload_from(Solver& solver, std::uint32_t first_id, Array const& from)
{
    static_assert(detail::holds_values<Tag, Solver::d, Array const>, "see upload()");
    using Host = detail::NumberOfHost<Tag, std::remove_cvref_t<decltype(*std::data(from))>>;
    using Number = typename Solver::Number;
    auto const ids = solver.template ids<Which>();
    auto const place = static_cast<std::size_t>(std::ranges::lower_bound(ids, first_id) - ids.begin());
    if (place < ids.size() && ids[place] != first_id)
        throw Error{"there is no particle with the id " + std::to_string(first_id), "upload_from",
                    "Pass the id that add() returned, before particles of that call are removed."};
    if (std::size(from) != ids.size() - place)
        throw Error{"there are " + std::to_string(std::size(from)) + " values for " +
                        std::to_string(ids.size() - place) + " particles from the id " +
                        std::to_string(first_id) + " on",
                    "upload_from", "Pass the id that add() returned, and one value for each new particle."};
    auto values =
        solver.template download<Tag, Which>(); // in the scene's numbers: the others keep their bits
    auto const* number = reinterpret_cast<Host const*>(std::data(from));
    for (std::size_t i = place; i < values.size(); ++i)
        if constexpr (IntegerField<Tag>)
            values[i] = halves_of<Number>(*number++);
        else
            for_each_component<Tag, Solver::d>(
                values[i], [&](int, Number& value) { value = static_cast<Number>(*number++); });
    solver.template upload<Tag, Which>(values);
}

} // namespace firn
