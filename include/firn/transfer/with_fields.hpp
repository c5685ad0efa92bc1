// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/field_sets.hpp>

namespace firn
{

/// A transfer scheme whose particles have fields of a host program's own beside those of the scene, such as a
/// handle or an age. Steps carry them along and change nothing of them:
///
///     struct Handle
///     {
///         static constexpr auto name = "handle";
///         static constexpr auto shape = FieldShape::integer;
///         static constexpr std::uint32_t at_rest = 0xffffffff; // of particles that are added
///     };
///     Solver<OpenMP, Snow<Space>, QuadraticBSpline, WithFields<Mls, Handle>> solver(lattice(h), material);
///
/// They are fields as all others: remove_if() passes them, snapshots and checkpoints have them, and download,
/// upload, write and view take their tags. Each number costs its bytes in both buffers, and the time to read
/// and write them in each step.
template <class Base, class... Tags>
struct WithFields : Base
{
    static_assert(sizeof...(Tags) > 0, "WithFields<Transfer, Field...> names fields of its own");
    static_assert((!Base::State::template contains<Tags> && ...),
                  "the transfer scheme has such a field already, and would change it");

    using Own = Fields<Tags...>; ///< which no material may have, or it would change them
    using State = Join<typename Base::State, Fields<Tags...>>;
    using Stored = Join<typename Base::Stored, Fields<Tags...>>;

    WithFields() = default;
    WithFields(Base const& base) : Base(base) {}
};

} // namespace firn
