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
/// Thrown before anything has changed: the object that was called is as it was. (Where memory runs short or a
/// device fails in the middle of a step it cannot be: then all later calls say so.)
class Error : public std::runtime_error
{
public:
    // What only errors reach is `cold` here and elsewhere: compiled for its size, which is sooner done.
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

/// Throws an Error unless `condition` holds; for checks that are not on a hot path.
inline void require(bool condition, char const* what_is_wrong, char const* where, char const* remedy)
{
    if (!condition) throw Error{what_is_wrong, where, remedy};
}

} // namespace firn
