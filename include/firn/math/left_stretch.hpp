// SPDX-License-Identifier: MIT
#pragma once

#include <firn/math/deformation.hpp>
#include <firn/math/inverse.hpp>
#include <firn/math/principal_axes.hpp>

#include <limits>

namespace firn
{

/// The left stretch V of the polar decomposition F = V R, R a rotation, as its strains: both vanish at rest
/// and are exact there to their own rounding. Where det F < 0, V has one negative eigenvalue: the smallest in
/// size.
template <class Real, int d>
struct LeftStretch
{
    Matrix<Real, d> strain; ///< V - I
    Matrix<Real, d> square; ///< V^2 - I = F F^T - I
};

namespace detail
{

/// Takes V - I from the principal axes where the rotation is undetermined, or nearly so. `settled` is the
/// product of the sums of two stretches each, with their signs: 2 in the plane and 8 in space at rest. Where
/// it is nearly 0, the closed form has an error of eps V times the square of its value at rest over itself.
/// That happens to needles and near-reflections: so few that the search for their axes does not count.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline void look_for_axes(Matrix<Real, d>& strain, Matrix<Real, d> const& H, Real settled)
{
    Mask<Real> const open = !(settled > Real(ScalarOf<Real>(0.1)));
    if (!any(open)) return;
    auto const axes = principal_axes<Real, d>(H);
    Matrix<Real, d> const found = axes.U * axes.extension.asDiagonal() * axes.U.transpose();
    FIRN_UNROLL
    for (int i = 0; i < d * d; ++i) strain(i) = select(open, found(i), strain(i));
}

/// V - I in the plane, where V = (V^2 + J I) / tr V and (tr V)^2 = (F_00 + F_11)^2 + (F_10 - F_01)^2.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 2> strain_of_stretch(Matrix<Real, 2> const& H,
                                                          Matrix<Real, 2> const& square, Real volume_change)
{
    Real const two(2), a = H(0, 0) + H(1, 1), b = H(1, 0) - H(0, 1);
    Real const trace = sqrt((two + a) * (two + a) + b * b);
    Real const strain_trace = (a * (Real(4) + a) + b * b) / (trace + two);
    Matrix<Real, 2> strain = square;
    strain(0, 0) += volume_change - strain_trace;
    strain(1, 1) += volume_change - strain_trace;
    strain = strain * (Real(1) / trace);
    look_for_axes(strain, H, trace); // s_1 + s_2, which is 2 at rest
    return strain;
}

/// tr V - 3 from the invariants of V^2 - I and from J - 1: tr V is the largest root of x^4 - 2 tr(F F^T) x^2
/// - 8 J x + tr(F F^T)^2 - 4 |cof F|^2, all roots of which are real. Halley's iteration descends to it from
/// above: each step leaves a third or less of the distance (at a double root), or its cube.
template <Lane Real>
FIRN_HOST_DEVICE inline Real trace_of_strain(Real square_trace, Real square_minors, Real volume_change)
{
    using Number = ScalarOf<Real>;
    constexpr int steps = 2, most = 8;
    auto const number = [](double x) { return Real(Number(x)); };
    // the polynomial of e = x - 3: the coefficients that should vanish at rest do
    Real const c0 =
        square_trace * (square_trace - number(20)) - number(4) * square_minors - number(24) * volume_change;
    Real const c1 = number(64) - number(12) * square_trace - number(8) * volume_change;
    Real const c2 = number(48) - number(2) * square_trace;
    // (tr V)^2 = tr V^2 + 2 i_2, and i_2^2 <= 3 |cof F|^2
    Real const cofactors2 = max(number(3) + number(2) * square_trace + square_minors, number(0));
    Real e =
        sqrt(max(number(3) + square_trace + number(2) * sqrt(number(3) * cofactors2), number(0))) - number(3);
    Real last =
        number(3) + e; // no step is longer than the one before, even where rounding spoils a double root
    auto const step = [&] {
        Real const value = (((e + number(12)) * e + c2) * e + c1) * e + c0;
        Real const slope = ((number(4) * e + number(36)) * e + number(2) * c2) * e + c1;
        Real const bend = (number(12) * e + number(72)) * e + number(2) * c2;
        Real const below = number(2) * slope * slope - value * bend;
        Real const down = number(2) * value * slope / select(below > number(0), below, number(1));
        return min(max(down, -last), last);
    };
    FIRN_UNROLL
    for (int i = 0; i < steps; ++i) {
        last = step();
        e -= last;
        last = abs(last);
    }
    // Lanes that are inverted or squeezed to a needle iterate alone, so that no lane depends on the others.
    Number const nearly = std::numeric_limits<Number>::epsilon();
#pragma GCC unroll 1
    for (int i = steps; i < most; ++i) {
        Real const size = number(3) + e;
        Mask<Real> const unfinished = last * last > Real(nearly) * size * size;
        if (!any(unfinished)) break;
        Real const down = select(unfinished, step(), number(0));
        e -= down;
        last = select(unfinished, abs(down), last);
    }
    return e;
}

/// V - I in space. By Cayley and Hamilton V (V^2 + i_2 I) = i_1 V^2 + i_3 I with the invariants of V; in
/// terms of V^2 - I, what remains near rest is of the order of the strain.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 3> strain_of_stretch(Matrix<Real, 3> const& H,
                                                          Matrix<Real, 3> const& square, Real volume_change)
{
    Real const trace = square(0, 0) + square(1, 1) + square(2, 2);
    Real minors(0);
    FIRN_UNROLL
    for (int i = 0; i < 3; ++i) {
        int const j = (i + 1) % 3;
        minors += square(i, i) * square(j, j) - square(i, j) * square(j, i);
    }
    Real const one(1), e1 = trace_of_strain(trace, minors, volume_change); // the invariants of V - I
    Real const e2 = Real(ScalarOf<Real>(0.5)) * (e1 * (e1 + Real(2)) - trace), e3 = volume_change - e1 - e2;
    Real const i1 = Real(3) + e1, i2 = Real(3) + Real(2) * e1 + e2, i3 = one + volume_change;
    Matrix<Real, 3> sum = square, times = square * (i1 - one);
    FIRN_UNROLL
    for (int i = 0; i < 3; ++i) {
        sum(i, i) += one + i2;
        times(i, i) += e3;
    }
    Matrix<Real, 3> const C = cofactors(sum);
    Real const whole = one / sum.col(0).dot(C.col(0));
    Matrix<Real, 3> strain; // matrices that commute have a symmetric product
    FIRN_UNROLL
    for (int i = 0; i < 3; ++i) FIRN_UNROLL
    for (int j = i; j < 3; ++j) strain(i, j) = strain(j, i) = times.row(i).dot(C.col(j)) * whole;

    // (s_1 + s_2) (s_2 + s_3) (s_3 + s_1), which is 8 at rest
    look_for_axes(strain, H, i1 * i2 - i3);
    return strain;
}

} // namespace detail

/// The left stretch of F = I + H, with its J - 1, which is known already.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline LeftStretch<Real, d> left_stretch(Matrix<Real, d> const& H, Real volume_change_of_H)
{
    // Far from rest, F is taken in units of its size, so that rounding is relative to F, not to I.
    Matrix<Real, d> G = deformation_gradient<Real, d>(H);
    Real const size2 = G.squaredNorm() * Real(ScalarOf<Real>(1.0 / d)), one(1);
    Mask<Real> const far = (size2 > Real(2)) | (size2 < Real(ScalarOf<Real>(0.5)));
    bool const any_far = any(far);
    Real unit = one, volume = volume_change_of_H;
    if (any_far) {
        unit = select(far, sqrt(max(size2, Real(std::numeric_limits<ScalarOf<Real>>::min()))), one);
        G = G * (one / unit);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) G(i, i) -= one;
        FIRN_UNROLL
        for (int i = 0; i < d * d; ++i) G(i) = select(far, G(i), H(i));
        volume = volume_change<Real, d>(G);
    }
    else
        G = H;
    LeftStretch<Real, d> V;
    V.square = squared_stretch_less_one<Real, d>(G);
    V.strain = detail::strain_of_stretch(G, V.square, volume);
    if (any_far) {
        V.strain = V.strain * unit;
        V.square = V.square * (unit * unit);
        FIRN_UNROLL
        for (int i = 0; i < d; ++i) {
            V.strain(i, i) += unit - one;
            V.square(i, i) += unit * unit - one;
        }
    }
    return V;
}

} // namespace firn
