// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/rigid_body.hpp>
#include <firn/io/checkpoint_stream.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>

// The values of a host program that travel with a checkpoint.
namespace firn::detail
{

/// A value that travels with a checkpoint: numbers, Motion and RigidBody, and fixed matrices of numbers.
template <class T>
concept Companion = std::is_arithmetic_v<T> || std::is_same_v<T, Motion> || std::is_same_v<T, RigidBody> ||
    (requires { typename T::Scalar; } && std::is_arithmetic_v<typename T::Scalar> &&
     std::is_base_of_v<Eigen::PlainObjectBase<T>, T> && T::SizeAtCompileTime > 0);

/// What a companion is called in the file.
template <Companion T>
std::string kind_of_companion()
{
    if constexpr (std::is_same_v<T, Motion>)
        return "motion";
    else if constexpr (std::is_same_v<T, RigidBody>)
        return "rigid_body";
    else if constexpr (std::is_arithmetic_v<T>)
        return (std::is_floating_point_v<T> ? "f"
                : std::is_signed_v<T>       ? "i"
                                            : "u") +
               std::to_string(8 * sizeof(T));
    else
        return kind_of_companion<typename T::Scalar>() + " " + std::to_string(T::RowsAtCompileTime) + "x" +
               std::to_string(T::ColsAtCompileTime);
}

/// Calls `use(number)` for every number of a companion.
template <class T, class Use>
void for_each_number(T& companion, Use const& use)
{
    using Plain = std::remove_const_t<T>;
    if constexpr (std::is_same_v<Plain, Motion>) {
        for_each_number(companion.position, use);
        for_each_number(companion.orientation.coeffs(), use); // x, y, z, w
        for_each_number(companion.velocity, use);
        for_each_number(companion.angular_velocity, use);
        bool has_time = companion.time.has_value();
        double time = companion.time.value_or(0);
        use(has_time);
        use(time);
        if constexpr (!std::is_const_v<T>) companion.time = has_time ? std::optional(time) : std::nullopt;
    }
    else if constexpr (std::is_same_v<Plain, RigidBody>) {
        use(companion.mass);
        for_each_number(companion.inertia, use);
        for_each_number(companion.motion, use);
    }
    else if constexpr (std::is_arithmetic_v<Plain>)
        use(companion);
    else
        for (Eigen::Index i = 0; i < companion.size(); ++i) use(companion.coeffRef(i)); // column by column
}

template <Companion T>
void put_companion(CheckpointWriter& out, T companion)
{
    std::uint32_t size = 0;
    for_each_number(companion, [&](auto const& number) { size += sizeof(number); });
    out.text(kind_of_companion<T>());
    out.values(size);
    for_each_number(companion, [&](auto const& number) { out.values(number); });
}

template <Companion T>
T get_companion(CheckpointReader& in)
{
    T companion{};
    std::uint32_t size = 0, expected = 0;
    for_each_number(companion, [&](auto const& number) { expected += sizeof(number); });
    std::string const kind = in.text();
    in.values(size);
    if (kind != kind_of_companion<T>() || size != expected)
        throw Error{"the file has a companion of kind '" + kind + "' where '" + kind_of_companion<T>() +
                        "' is asked for",
                    "read_checkpoint", "Pass the same companions as to write_checkpoint, in the same order."};
    for_each_number(companion, [&]<class Number>(Number& number) {
        if constexpr (std::is_same_v<Number, bool>) {
            std::uint8_t truth = 0;
            in.values(truth);
            if (truth > 1)
                throw Error{
                    "the file has a companion of " + std::to_string(truth) + " where a bool is asked for",
                    "read_checkpoint", "Pass the same companions as to write_checkpoint, in the same order."};
            number = truth == 1;
        }
        else
            in.values(number);
    });
    return companion;
}

} // namespace firn::detail
