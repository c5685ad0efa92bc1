// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/host_device.hpp>

#include <functional>
#include <type_traits>

namespace firn
{

/// Whether two numbers are equal, as `a == b` says; a mask for packs. It marks comparisons that are meant to
/// be exact, so that a host may be compiled with -Wfloat-equal.
template <class Real>
FIRN_HOST_DEVICE constexpr auto exactly_equal(Real const& a, std::type_identity_t<Real> const& b)
{
    return std::equal_to<>{}(a, b);
}

} // namespace firn
