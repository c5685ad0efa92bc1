// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

namespace firn
{

/// Principal values split into their trace and the rest of each, which changes shape.
template <class Real, int d>
struct Deviator
{
    Real trace;
    Vector<Real, d> part; ///< value_i - trace / d
    Real norm;            ///< |part|

    FIRN_HOST_DEVICE explicit Deviator(Vector<Real, d> const& values)
    {
        trace = values[0];
        FIRN_UNROLL
        for (int i = 1; i < d; ++i) trace += values[i];
        Real const mean = trace * Real(ScalarOf<Real>(1.0 / d));
        Real square(0);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            part[i] = values[i] - mean;
            square += part[i] * part[i];
        }
        norm = sqrt(square);
    }
};

} // namespace firn
