// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/elastoplastic.hpp>

namespace firn
{

/// det^(1/d) of a volume ratio J > 0, and its inverse power: what scales shape and volume apart.
template <int d, Lane Real>
FIRN_HOST_DEVICE inline Real root_of_volume(Real J)
{
    if constexpr (d == 2)
        return sqrt(J);
    else
        return exp(log(J) * Real(Scalar<Real>(1.0 / 3)));
}

/// The neo-Hookean law that splits shape from volume, with the bulk modulus kappa = lambda + 2 mu / d:
/// Psi = mu/2 (J^(-2/d) |F|^2 - d) + kappa/2 ((J^2 - 1)/2 - ln J) (Simo & Hughes 1998, eq. 9.2.3 and 9.2.6).
struct SplitNeoHookeanLaw : MeasuredByExtension, RefusesInversion
{
    static constexpr auto name = "split_neo_hookean";

    /// tau_i = mu J^(-2/d) (sigma_i^2 - |F|^2 / d) + kappa/2 (J^2 - 1), with sigma_i^2 - 1 instead of the
    /// squares: the shift is none to a deviator.
    template <Lane Real, int d>
    FIRN_HOST_DEVICE static PrincipalStress<Real, d> stress(Vector<Real, d> const& extension, Real mu,
                                                            Real lambda)
    {
        using Number = Scalar<Real>;
        Vector<Real, d> const square = squares_less_one<Real, d>(extension);
        Real const volume = volume_change<Real, d>(extension), J = Real(1) + volume;
        Real sum = square[0], least = sum, most = sum;
        FIRN_UNROLL
        for (int i = 1; i < d; ++i) {
            sum += square[i];
            least = min(least, square[i]);
            most = max(most, square[i]);
        }
        Real const root = root_of_volume<d>(select(J > Real(0), J, Real(1)));
        Real const shear = mu / (root * root), bulk = lambda + mu * Real(Number(2.0 / d));
        Real const pressure = Real(Number(0.5)) * bulk * volume * (J + Real(1)),
                   mean = sum * Real(Number(1.0 / d));
        PrincipalStress<Real, d> found;
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) found.kirchhoff[i] = shear * (square[i] - mean) + pressure;
        // sigma_i^2 Psi_ii = mu J^(-2/d) ((1 - 4/d) sigma_i^2 + (2/d + 1) |F|^2 / d) + kappa/2 (J^2 + 1) is
        // largest at the smallest stretch; the shear value is mu J^(-2/d) sigma_1^2.
        Real const longitudinal = shear * (Real(Number(1 - 4.0 / d)) * (least + Real(1)) +
                                           Real(Number(2.0 / d + 1)) * (mean + Real(1))) +
                                  pressure + bulk;
        found.wave_modulus = max(max(longitudinal, shear * (most + Real(1))), lambda + Real(2) * mu);
        return found;
    }
};

/// Neo-Hookean solid whose shape and volume do not couple: for what is nearly incompressible, and below the
/// models of soils and yield-stress fluids. An inverted particle is an error.
template <class Space>
using SplitNeoHookean = Elastoplastic<SplitNeoHookeanLaw, NoFlow<Space>>;

} // namespace firn
