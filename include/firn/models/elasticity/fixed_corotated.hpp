// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elastoplastic.hpp>

namespace firn
{

/// The fixed corotated law, in principal stretches sigma: Psi = mu sum (sigma_i - 1)^2 + lambda/2 (J - 1)^2
/// (Stomakhin et al. 2012, section 3).
struct FixedCorotatedLaw
{
    static constexpr auto name = "fixed_corotated";

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Vector<Real, d> strains(Vector<Real, d> const& sigma)
    {
        return sigma;
    }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Vector<Real, d> stretches(Vector<Real, d> const& sigma)
    {
        return sigma;
    }

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Mask<Real> inverted(Vector<Real, d> const&)
    {
        return nowhere<Real>();
    }

    /// tau_i = 2 mu (sigma_i - 1) sigma_i + lambda (J - 1) J; the wave modulus max_i sigma_i^2 Psi_ii =
    /// 2 mu sigma_1^2 + lambda J^2, not below its value at rest.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalStress<Real, d> stress(Vector<Real, d> const& sigma, Real mu,
                                                            Real lambda)
    {
        Real J = sigma[0];
        for (int i = 1; i < d; ++i) J = J * sigma[i];
        PrincipalStress<Real, d> found;
        Real const pressure = lambda * (J - Real(1)) * J;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i)
            found.kirchhoff[i] = Real(2) * mu * (sigma[i] - Real(1)) * sigma[i] + pressure;
        // The shear values 2 mu sigma_1^2 (1 - 1/(sigma_i + sigma_j)) are always below the longitudinal one.
        // In compression sigma_1 may be below 1, but not the modulus below that at rest.
        found.wave_modulus = max(Real(2) * mu * sigma[0] * sigma[0] + lambda * J * J, lambda + Real(2) * mu);
        return found;
    }
};

/// Fixed corotated solid: Psi = mu |F - R|^2 + lambda/2 (J - 1)^2 with the rotation R of the polar
/// decomposition (Stomakhin et al. 2012, eq. 6). Finite under inversion, from which it recovers; soft towards
/// J = 0.
template <class Space>
using FixedCorotated = Elastoplastic<FixedCorotatedLaw, NoFlow<Space>>;

} // namespace firn
