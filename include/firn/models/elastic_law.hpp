// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/models/response.hpp>

// What elastic laws in principal axes answer, and what several of them share: see elastoplastic.hpp.
namespace firn
{

/// The stress of an elastic law for principal strains.
template <class Real, int d>
struct PrincipalStress
{
    Vector<Real, d> kirchhoff; ///< [Pa]
    Real wave_modulus;         ///< a bound on rho_0 c^2 of waves in every direction [Pa]
};

/// Members of the laws whose measure is the extension itself.
struct MeasuredByExtension
{
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Mask<Real> capped(Vector<Real, d> const&)
    {
        return no_lanes<Real>();
    }
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Vector<Real, d> strains(Vector<Real, d> const& extension)
    {
        return extension;
    }
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Vector<Real, d> extensions(Vector<Real, d> const& strains)
    {
        return strains;
    }
};

/// Member of the laws that have no stress for det F <= 0.
struct RefusesInversion
{
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Mask<Real> inverted(Vector<Real, d> const& extension)
    {
        Real least = extension[0];
        FIRN_UNROLL
        for (int i = 1; i < d; ++i) least = min(least, extension[i]);
        return !(least > Real(-1));
    }
};

} // namespace firn
