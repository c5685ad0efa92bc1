// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/math/singular_values.hpp>

#include <limits>

namespace firn
{

/// How F = I + H stretches: F = sum_i (1 + extension_i) u_i v_iᵀ.
///
/// Extensions are exact to rounding of the strain near rest, and to rounding of 1 elsewhere: they never are
/// differences of stretches near one. They are not sorted; where det F < 0, the smallest stretch counts as
/// negative.
template <class Real, int d>
struct PrincipalAxes
{
    Matrix<Real, d> U;         ///< u_i: the axes after the deformation, a rotation
    Vector<Real, d> extension; ///< sigma_i - 1
    Matrix<Real, d> stretched; ///< sigma_i v_i = Fᵀ u_i: the axes before it, stretched
};

namespace detail
{

/// Lets all lanes turn.
struct AllTurn
{
    template <class Real>
    FIRN_HOST_DEVICE Turn<Real> operator()(Turn<Real> const& turn) const
    {
        return turn;
    }
    template <class Real>
    FIRN_HOST_DEVICE Real operator()(Real const& turned, Real const&) const
    {
        return turned;
    }
};

/// Lets some lanes turn.
template <class Mask>
struct SomeTurn
{
    Mask some;

    template <class Real>
    FIRN_HOST_DEVICE Turn<Real> operator()(Turn<Real> const& turn) const
    {
        return {select(some, turn.cosine, Real(1)), select(some, turn.sine, Real(0))};
    }
    template <class Real>
    FIRN_HOST_DEVICE Real operator()(Real const& turned, Real const& kept) const
    {
        return select(some, turned, kept);
    }
};

/// One step of Jacobi: turns the axes p and q so that S(p, q) vanishes. S = Uᵀ A U is symmetric, and only its
/// upper triangle is stored.
template <int p, int q, Lane Real, int d, class Choose>
FIRN_HOST_DEVICE inline void turn_axes(Matrix<Real, d>& S, Matrix<Real, d>& U, Choose const& choose)
{
    Real const difference = S(q, q) - S(p, p);
    Real root;
    Turn<Real> const turn = choose(turn_of(difference, ScalarOf<Real>(2) * S(p, q), root));
    turn.template turn<p, q>(U);

    Real const half = ScalarOf<Real>(0.5) * (root - abs(difference)); // the mean stays
    Real const apart = choose(select(difference < Real(0), -half, half), Real(0));
    S(p, p) -= apart;
    S(q, q) += apart;
    S(p, q) = choose(Real(0), S(p, q));
    if constexpr (d == 3) {
        constexpr int r = 3 - p - q;
        Real& a = S(p < r ? p : r, p < r ? r : p);
        Real& b = S(q < r ? q : r, q < r ? r : q);
        Real const x = a;
        a = x * turn.cosine - b * turn.sine;
        b = x * turn.sine + b * turn.cosine;
    }
}

/// The axes of a symmetric 2 × 2 matrix.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 2> axes_of(Matrix<Real, 2>& S)
{
    Matrix<Real, 2> U = Matrix<Real, 2>::Identity();
    turn_axes<0, 1>(S, U, AllTurn{});
    return U;
}

/// The axes of a symmetric 3 × 3 matrix, in a few sweeps of Jacobi. Three are enough for nearly all matrices;
/// lanes that need more iterate alone, so that no lane depends on the others.
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 3> axes_of(Matrix<Real, 3>& S)
{
    constexpr int sweeps = 3, most = 8;
    Matrix<Real, 3> U = Matrix<Real, 3>::Identity();
#pragma GCC unroll 1
    for (int sweep = 0; sweep < sweeps; ++sweep) {
        turn_axes<0, 1>(S, U, AllTurn{});
        turn_axes<0, 2>(S, U, AllTurn{});
        turn_axes<1, 2>(S, U, AllTurn{});
    }
#pragma GCC unroll 1
    for (int sweep = sweeps; sweep < most; ++sweep) {
        Real const off = max(abs(S(0, 1)), abs(S(0, 2))); // S(1, 2) was the last to vanish
        Real const size = max(max(abs(S(0, 0)), abs(S(1, 1))), abs(S(2, 2)));
        Mask<Real> const unfinished = off > size * Real(std::numeric_limits<ScalarOf<Real>>::epsilon());
        if (!any(unfinished)) break;
        SomeTurn<Mask<Real>> const they{unfinished};
        turn_axes<0, 1>(S, U, they);
        turn_axes<0, 2>(S, U, they);
        turn_axes<1, 2>(S, U, they);
    }
    make_orthonormal(U);
    return U;
}

/// Turns the axes p and q so that they are orthogonal in their stretched form too.
template <int p, int q, Lane Real, int d, class Choose>
FIRN_HOST_DEVICE inline void part_axes(Matrix<Real, d>& G, Matrix<Real, d>& U, Choose const& choose)
{
    auto const turn = choose(turn_to_orthogonal<p, q>(G));
    turn.template turn<p, q>(G);
    turn.template turn<p, q>(U);
}

} // namespace detail

/// The principal axes and extensions of F = I + H.
///
/// u_i are the axes of F Fᵀ − I = H + Hᵀ + H Hᵀ, which is exact to rounding of H. The extensions follow from
/// them with g_i = Fᵀ u_i and h_i = Hᵀ u_i: sigma_i = |g_i| and sigma_i − 1 = (2 u_i·h_i + |h_i|²) / (1 +
/// sigma_i). Errors of the axes enter by their squares, and a small stretch is not lost, as it would be among
/// the eigenvalues of F Fᵀ. Where two stretches are small beside the third, their axes are improved from g_i
/// directly.
///
/// There is no scaling: squares of H must be finite. singular_values() is exact at any scale.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline PrincipalAxes<Real, d> principal_axes(Matrix<Real, d> const& H)
{
    using Number = ScalarOf<Real>;
    Matrix<Real, d> S;
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) FIRN_UNROLL
    for (int j = i; j < d; ++j) S(i, j) = H(i, j) + H(j, i) + H.row(i).dot(H.row(j));

    PrincipalAxes<Real, d> axes;
    axes.U = detail::axes_of(S);
    Matrix<Real, d>&U = axes.U, &G = axes.stretched;
    Matrix<Real, d> h = H.transpose() * U;
    G = U + h;
    if constexpr (d == 3) {
        Vector<Real, d> const square = G.colwise().squaredNorm();
        Real const most = max(max(square[0], square[1]), square[2]);
        // Two stretches are small beside the third: their squares were lost beside its square.
        Mask<Real> const flat = square.sum() < most * Real(Number(1 + 1.0 / 128));
        if (any(flat)) {
            detail::SomeTurn<Mask<Real>> const they{flat};
#pragma GCC unroll 1
            for (int sweep = 0; sweep < 2; ++sweep) {
                detail::part_axes<0, 1>(G, U, they);
                detail::part_axes<0, 2>(G, U, they);
                detail::part_axes<1, 2>(G, U, they);
            }
            FIRN_UNROLL
            for (int i = 0; i < d * d; ++i) h(i) = select(flat, G(i) - U(i), h(i));
        }
    }
    Vector<Real, d> sigma;
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) {
        Vector<Real, d> const u = U.col(i), change = h.col(i);
        Real const square = G.col(i).squaredNorm();
        sigma[i] = square * inverse_sqrt(max(square, Real(std::numeric_limits<Number>::min())));
        axes.extension[i] = (Number(2) * u.dot(change) + change.squaredNorm()) / (Real(1) + sigma[i]);
    }
    Real least = sigma[0];
    FIRN_UNROLL
    for (int i = 1; i < d; ++i) least = min(least, sigma[i]);
    Mask<Real> inverted = axes.stretched.determinant() < Real(0); // that of F, since U is a rotation
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) {
        Mask<Real> const turned = inverted & exactly_equal(sigma[i], least);
        axes.extension[i] = select(turned, Real(-1) - sigma[i], axes.extension[i]);
        inverted = inverted & !turned; // one of them, where several are equal
    }
    return axes;
}

} // namespace firn
