// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"

#include <firn/core/error.hpp>

namespace firn::test
{

/// Runs what must be refused; returns the error, which must have its three parts.
template <class Call>
Error refused(Call const& call)
{
    try {
        call();
    }
    catch (Error const& error) {
        CHECK(!error.what_is_wrong().empty());
        CHECK(!error.where().empty());
        CHECK(!error.remedy().empty());
        return error;
    }
    FAIL("nothing was refused");
    return {"", "", ""};
}

} // namespace firn::test
