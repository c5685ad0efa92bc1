// SPDX-License-Identifier: MIT
#pragma once

#include <firn/firn.hpp>

template <class SpaceType>
struct SoftFoam // a neo-Hookean solid without a volume term, for example
{
    using Space = SpaceType;
    using Number = typename Space::Scalar;
    using State = firn::Fields<firn::DisplacementGradient>; // H = F - I
    static constexpr int d = Space::dimension;
    Number density = 60, stiffness = 2e4; // [kg/m^3], [Pa]

    void validate() const
    {
        firn::require_density(density, "SoftFoam");
        firn::require(stiffness > 0 && stiffness < 1e15, "the stiffness is outside (0, 1e15)", "SoftFoam",
                      "Pass Pa.");
    }

    template <firn::Lane Real, class Particle>
    FIRN_HOST_DEVICE firn::Response<Real, d> respond(Particle& state, firn::Matrix<Real, d> const& L,
                                                     Real dt) const
    {
        auto& H = state[firn::DisplacementGradient{}];
        H = firn::deformed<Real, d>(H, L, dt);
        firn::Matrix<Real, d> const strain = H + H.transpose() + H * H.transpose(); // F F^T - I
        return {strain * Real(stiffness), Real(stiffness) * (Real(2) + strain.squaredNorm()),
                firn::no_lanes<Real>(), firn::no_lanes<Real>()}; // never inverted, never capped
    }
};
