// SPDX-License-Identifier: MIT
#pragma once

#include <firn/math/deformation.hpp>
#include <firn/math/product.hpp>

#include <concepts>
#include <string>

namespace firn
{

/// A material's response to a step of deformation.
template <class Real, int d>
struct Response
{
    Matrix<Real, d> kirchhoff_stress; ///< tau = P F^T [Pa], symmetric
    Real wave_modulus;                ///< rho_0 c^2 [Pa] of the fastest wave in the current state
    Mask<Real> inverted; ///< det F <= 0 where the material has no stress for it: the step is rejected
    Mask<Real> capped;   ///< the state reached a stated cap: a warning
};

/// A material whose stress depends on how fast it is sheared: `is_viscous` says so, and
/// `kinematic_viscosity()` [m^2/s] bounds the step.
template <class Model>
concept Viscous = requires
{
    requires Model::is_viscous;
};

/// A material that cannot go on from every state with values in their ranges. `objection` says what is wrong
/// with an uploaded or restored state, or nothing. A state with det F <= 0 for which the material has no
/// stress is refused by the next step: see Response::inverted.
template <class Model, class Particle>
concept ObjectsToStates = requires(Model const model, Particle const state)
{
    {
        model.objection(state)
        } -> std::convertible_to<std::string>;
};

/// The state of a new particle of a material: its fields at rest, of which a model may set some by
/// `set_defaults(particle)`, where they are its own parameters.
template <class State, class Model>
State state_of_new(Model const& model)
{
    auto state = State::at_rest();
    if constexpr (requires { model.set_defaults(state); }) model.set_defaults(state);
    return state;
}

/// A material that tells its elastic energy per volume at rest [J/m^3], of which its stress is the
/// derivative.
template <class Model, class Real, class Particle>
concept TellsEnergy = requires(Model const model, Particle const state)
{
    {
        model.template energy<Real>(state)
        } -> std::same_as<Real>;
};

/// The trial deformation (I + dt L) F of a step (Stomakhin et al. 2013, eq. 11), in terms of H = F - I.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> deformed(Matrix<Real, d> const& H,
                                                 Matrix<Real, d> const& velocity_gradient, Real dt)
{
    Matrix<Real, d> const turned = product<Real, d>(velocity_gradient, H);
    return make_matrix<Real, d>(
        [&](int i, int j) { return H(i, j) + (turned(i, j) + velocity_gradient(i, j)) * dt; });
}

/// J - 1 from the principal extensions sigma_i - 1, without the cancellation near rest.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real volume_change(Vector<Real, d> const& extension)
{
    Real change = extension[0];
    FIRN_UNROLL
    for (int i = 1; i < d; ++i) change = change + extension[i] + change * extension[i];
    return change;
}

/// sigma_i^2 - 1 from the principal extensions, without the cancellation near rest.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Vector<Real, d> squares_less_one(Vector<Real, d> const& extension)
{
    Vector<Real, d> squares;
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) squares[i] = extension[i] * (Real(2) + extension[i]);
    return squares;
}

/// ln(1 + x) to 2 ulp, for small x too: with u the rounded 1 + x, it is ln u plus the rounded-off part over
/// u. That part is below half a unit of u, so 1/u need only be accurate where ln u is small; there 1 - x
/// stands for it and saves a division.
template <Lane Real>
FIRN_HOST_DEVICE inline Real log_one_plus(Real x)
{
    Real const one(1), u = one + x, rounded_off = x - (u - one);
    return log(u) + rounded_off * max(one - x, Real(0));
}

/// e^x - 1, accurate for small x too: below 1/4, where the difference would cancel, the series of x^n / n!.
template <Lane Real>
FIRN_HOST_DEVICE inline Real exp_minus_one(Real x)
{
    using Number = ScalarOf<Real>;
    constexpr int terms = sizeof(Number) == 4 ? 7 : 13;
    Real series(1);
    FIRN_UNROLL
    for (int n = terms; n > 1; --n) series = Real(1) + series * x * Real(Number(1.0 / n));
    return select(abs(x) < Real(Number(0.25)), x * series, exp(x) - Real(1));
}

/// A mask that is false in every lane.
template <Lane Real>
FIRN_HOST_DEVICE inline Mask<Real> no_lanes()
{
    return Real(1) < Real(0);
}

/// Whether a model is a fluid whose particles are moved to fill its volume: see KeepsVolume.
template <class Model>
concept KeepsItsVolume = requires
{
    requires Model::keeps_volume;
};

} // namespace firn
