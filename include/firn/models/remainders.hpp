// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/response.hpp>

// What is left of functions beyond their first order: elastic energies are of the second order in strains,
// and would be differences of numbers of the first.
namespace firn
{

/// x - ln(1 + x), without the cancellation for small x: below 1/4 by the series of ln(1 + x) = 2 artanh t
/// with t = x / (2 + x), of which the first term leaves x - 2 t = x t.
template <Lane Real>
FIRN_HOST_DEVICE inline Real log_remainder(Real x)
{
    using Number = ScalarOf<Real>;
    constexpr int terms = sizeof(Number) == 4 ? 4 : 9;
    Real const t = x / (Real(2) + x), square = t * t;
    Real series(0);
    FIRN_UNROLL
    for (int n = terms; n > 0; --n) series = (series + Real(Number(1.0 / (2 * n + 1)))) * square;
    return select(abs(x) < Real(Number(0.25)), t * (x - Real(2) * series), x - log_one_plus(x));
}

/// e^x - 1 - x, without the cancellation for small x: below 1/4 by the series of x^n / n!.
template <Lane Real>
FIRN_HOST_DEVICE inline Real exp_remainder(Real x)
{
    using Number = ScalarOf<Real>;
    constexpr int terms = sizeof(Number) == 4 ? 7 : 13;
    Real series(1);
    FIRN_UNROLL
    for (int n = terms; n > 2; --n) series = Real(1) + series * x * Real(Number(1.0 / n));
    return select(abs(x) < Real(Number(0.25)), x * x * Real(Number(0.5)) * series, exp(x) - Real(1) - x);
}

/// (|F|^2 - d) / 2 - (J - 1) from H = F - I.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real stretch_remainder(Matrix<Real, d> const& H)
{
    return Real(ScalarOf<Real>(0.5)) * squared_norm<Real, d>(H) - volume_remainder<Real, d>(H);
}

/// The same from the principal extensions sigma_i - 1.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Real stretch_remainder(Vector<Real, d> const& extension)
{
    Real volume = extension[0] * extension[1];
    if constexpr (d == 3) volume += (extension[0] + extension[1] + volume) * extension[2];
    return Real(ScalarOf<Real>(0.5)) * dot<Real, d>(extension, extension) - volume;
}

} // namespace firn
