// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <stdexcept>
#include <string>
#include <utility>

namespace firn
{

/// Everything the library refuses: what is wrong, where, and what the caller can do about it.
///
/// Thrown before anything has changed: the object that was called is as it was. That is impossible if memory
/// runs out or a device fails in the middle of a step; then all later calls say so.
class Error : public std::runtime_error
{
public:
    // Functions that only errors reach are `cold` here and elsewhere: they are compiled for size, which takes
    // less time.
    [[gnu::cold]] Error(std::string what_is_wrong, std::string where, std::string remedy)
        : std::runtime_error(what_is_wrong + " [" + where + "]. " + remedy), wrong_(std::move(what_is_wrong)),
          where_(std::move(where)), remedy_(std::move(remedy))
    {}

    std::string const& what_is_wrong() const noexcept { return wrong_; }
    std::string const& where() const noexcept { return where_; }
    std::string const& remedy() const noexcept { return remedy_; }

private:
    std::string wrong_, where_, remedy_;
};

namespace detail
{
[[noreturn, gnu::cold, gnu::noinline]] inline void refuse(char const* what_is_wrong, char const* where,
                                                          char const* remedy)
{
    throw Error{what_is_wrong, where, remedy};
}
} // namespace detail

/// Throws an Error unless `condition` holds; for checks that are not on a hot path.
inline void require(bool condition, char const* what_is_wrong, char const* where, char const* remedy)
{
    if (!condition) detail::refuse(what_is_wrong, where, remedy);
}

} // namespace firn
