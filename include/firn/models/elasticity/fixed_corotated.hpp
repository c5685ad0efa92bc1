// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elastoplastic.hpp>

namespace firn
{

/// The fixed corotated law, in principal stretches sigma: Psi = mu sum (sigma_i - 1)^2 + lambda/2 (J - 1)^2
/// (Stomakhin et al. 2012, section 3).
struct FixedCorotatedLaw : MeasuredByExtension
{
    static constexpr auto name = "fixed_corotated";

    template <Lane Real, int d>
    FIRN_HOST_DEVICE static Mask<Real> inverted(Vector<Real, d> const&)
    {
        return nowhere<Real>();
    }

    /// tau_i = 2 mu (sigma_i - 1) sigma_i + lambda (J - 1) J; the wave modulus max_i sigma_i^2 Psi_ii =
    /// 2 mu sigma_1^2 + lambda J^2 or that of shear, not below its value at rest.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalStress<Real, d> stress(Vector<Real, d> const& extension, Real mu,
                                                            Real lambda)
    {
        Real const volume = volume_change<Real, d>(extension), J = Real(1) + volume;
        Real const pressure = lambda * volume * J;
        Real longest = extension[0];
        PrincipalStress<Real, d> found;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            found.kirchhoff[i] = Real(2) * mu * extension[i] * (Real(1) + extension[i]) + pressure;
            longest = max(longest, extension[i]);
        }
        // The shear values 2 mu sigma_1^2 (1 - 1/(sigma_1 + sigma_j)) are at most mu sigma_1 (2 sigma_1 - 1):
        // below the longitudinal one, unless nu < 0. In compression sigma_1 may be below 1, but not the
        // modulus below that at rest.
        Real const sigma = Real(1) + longest, rest = lambda + Real(2) * mu;
        Real const longitudinal = Real(2) * mu * sigma * sigma + lambda * J * J;
        found.wave_modulus = max(max(longitudinal, mu * sigma * (Real(2) * sigma - Real(1))), rest);
        return found;
    }
};

/// Fixed corotated solid: Psi = mu |F - R|^2 + lambda/2 (J - 1)^2 with the rotation R of the polar
/// decomposition (Stomakhin et al. 2012, eq. 6). Finite under inversion, from which a particle does not come
/// back, though: a step that is safe keeps the sign of det F. Soft towards J = 0.
template <class Space>
using FixedCorotated = Elastoplastic<FixedCorotatedLaw, NoFlow<Space>>;

} // namespace firn
