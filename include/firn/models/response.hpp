// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

namespace firn
{

/// What a material answers to a step of deformation.
template <class Real, int d>
struct Response
{
    Matrix<Real, d> kirchhoff_stress; ///< tau = P F^T [Pa], symmetric
    Real wave_modulus;                ///< rho_0 c^2 [Pa] of the fastest wave in the current state
    Mask<Real> inverted; ///< det F <= 0 where the material has no stress for it: the step is rejected
    Mask<Real> capped;   ///< the state reached a stated cap: a warning
};

/// The trial deformation gradient (I + dt L) F of a step (Stomakhin et al. 2013, eq. 11).
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> deformed(Matrix<Real, d> const& F,
                                                 Matrix<Real, d> const& velocity_gradient, Real dt)
{
    return F + velocity_gradient * F * dt;
}

/// A mask that is false in every lane.
template <Lane Real>
FIRN_HOST_DEVICE inline Mask<Real> nowhere()
{
    return Real(1) < Real(0);
}

} // namespace firn
