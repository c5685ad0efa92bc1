// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

namespace firn::test
{

/// Particles without stress: nothing holds them back but obstacles.
template <class SpaceType>
struct Dust
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = Fields<>;
    static constexpr int d = Space::dimension;
    Number density = 100; // [kg/m^3]

    void validate() const {}

    template <Lane Real, class Particle>
    FIRN_HOST_DEVICE Response<Real, d> respond(Particle&, Matrix<Real, d> const&, Real) const
    {
        return {Matrix<Real, d>::Zero(), Real(1e-6f), no_lanes<Real>(), no_lanes<Real>()};
    }
};

} // namespace firn::test
