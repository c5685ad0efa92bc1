// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/exactly_equal.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/core/space.hpp>

#include <cstdint>
#include <limits>

namespace firn
{

/// F = U diag(sigma) Vᵀ with U and V rotations (determinant +1) and sigma₁ ≥ sigma₂ ≥ |sigma₃|: the sign of
/// det F sits in the last singular value, so that U Vᵀ is a rotation for inverted F too.
template <class Real, int d>
struct SingularValues
{
    Matrix<Real, d> U;
    Vector<Real, d> sigma;
    Matrix<Real, d> V;
};

namespace detail
{

/// F divided by a power of two near its largest entry, which is returned in `scale`: no entry is rounded, and
/// squares neither overflow nor underflow afterwards. All NaN if one entry is not finite. Entries near the
/// smallest normal number (below 2e-31 in float) count as zero.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Matrix<Real, d> scaled_to_one(Matrix<Real, d> const& F, Real& scale)
{
    using Number = ScalarOf<Real>;
    using Limits = std::numeric_limits<Number>;
    constexpr Number shift = Number(std::int64_t{1} << Limits::digits);

    Real largest = abs(F(0, 0));
#pragma GCC unroll 9
    for (int i = 1; i < d * d; ++i) largest = max(largest, abs(F(i % d, i / d)));
    auto const none = largest < Real(Limits::min() * shift);
    // Adding and subtracting a number whose last bit is the first bit of `low` leaves a power of two.
    Real const low = select(none, Real(1), largest * (1 / shift)), high = low * (shift / 2);
    Real const power = (low + high) - high;
    scale = power * shift;

    Matrix<Real, d> B = F * select(none, Real(0), Real(1 / shift) / power);
    Real const sum = B.sum();
    Real const zero = sum - sum; // NaN if an entry is not finite
#pragma GCC unroll 9
    for (int i = 0; i < d * d; ++i) B(i % d, i / d) += zero;
    return B;
}

/// Cosine and sine of an angle.
template <class Real>
struct Turn
{
    Real cosine, sine;

    /// Turns columns p and q of a matrix by it.
    template <int p, int q, int d>
    FIRN_HOST_DEVICE void turn(Matrix<Real, d>& A) const
    {
        Vector<Real, d> const x = A.col(p), y = A.col(q);
        A.col(p) = x * cosine - y * sine;
        A.col(q) = x * sine + y * cosine;
    }
};

/// The angle of Jacobi that makes [[a, c], [c, b]] diagonal. The half angle comes from tan 2θ = 2c / (b − a)
/// without divisions: (cos θ, ± sin θ) ∝ (|b − a| + r, 2c), with r = √((b − a)² + 4c²), by which the two
/// eigenvalues lie apart.
template <Lane Real>
FIRN_HOST_DEVICE inline Turn<Real> turn_of(Real const& difference, Real const& twice, Real& root)
{
    // Keeps the roots finite where nothing is left to turn, and changes no other angle.
    using Number = ScalarOf<Real>;
    constexpr Number tiny = sizeof(Number) == 4 ? Number(1e-18) : Number(1e-150);
    Real const square = difference * difference + twice * twice;
    root = square * inverse_sqrt(square + Real(tiny * tiny));
    Real const sum = abs(difference) + root + Real(tiny);
    Real const opposite = select(difference < Real(0), -twice, twice);
    Real const length = inverse_sqrt(sum * sum + opposite * opposite);
    return {select(exactly_equal(opposite, Real(0)), Real(1), sum * length), opposite * length};
}

/// One step of one-sided Jacobi (Hestenes 1958): the angle that makes the columns p and q of B orthogonal.
template <int p, int q, Lane Real, int d>
FIRN_HOST_DEVICE inline Turn<Real> turn_to_orthogonal(Matrix<Real, d> const& B)
{
    Vector<Real, d> const x = B.col(p), y = B.col(q);
    Real root;
    return turn_of(y.dot(y) - x.dot(x), ScalarOf<Real>(2) * x.dot(y), root);
}

/// Makes columns p and q of B orthogonal, and turns those of V with them.
template <int p, int q, Lane Real, int d>
FIRN_HOST_DEVICE inline void make_orthogonal(Matrix<Real, d>& B, Matrix<Real, d>& V)
{
    auto const turn = turn_to_orthogonal<p, q>(B);
    turn.template turn<p, q>(B);
    turn.template turn<p, q>(V);
}

/// One sweep over the three pairs of columns.
template <Lane Real>
FIRN_HOST_DEVICE inline void make_orthogonal(Matrix<Real, 3>& B, Matrix<Real, 3>& V)
{
    make_orthogonal<0, 1>(B, V);
    make_orthogonal<0, 2>(B, V);
    make_orthogonal<1, 2>(B, V);
}

/// Exchanges columns p and q where p is the shorter one, and negates one of them: V stays a rotation.
template <int p, int q, Lane Real, int d>
FIRN_HOST_DEVICE inline void put_longer_first(Matrix<Real, d>& B, Matrix<Real, d>& V, Vector<Real, d>& square)
{
    auto const wrong = square[p] < square[q];
#pragma GCC unroll 3
    for (int i = 0; i < d; ++i) {
        Real const b = B(i, p), v = V(i, p);
        B(i, p) = select(wrong, B(i, q), b);
        B(i, q) = select(wrong, -b, B(i, q));
        V(i, p) = select(wrong, V(i, q), v);
        V(i, q) = select(wrong, -v, V(i, q));
    }
    Real const s = square[p];
    square[p] = select(wrong, square[q], s);
    square[q] = select(wrong, s, square[q]);
}

/// Rotation with its first axis along the first column of B, and its second in the plane of the first two
/// (Gram–Schmidt, twice: the second column may be small and then has lost its direction to rounding).
template <Lane Real>
FIRN_HOST_DEVICE inline Matrix<Real, 3> orthonormal_along(Matrix<Real, 3> const& B)
{
    // B was scaled: unless it is zero, its first column is longer than 1/2. A second column below an eighth
    // of the rounding error of the first has no direction; any perpendicular does (Duff et al. 2017, eq. 2).
    constexpr ScalarOf<Real> epsilon = std::numeric_limits<ScalarOf<Real>>::epsilon();
    Vector<Real, 3> u1 = B.col(0), u2, perpendicular;
    Real const square = u1.dot(u1);
    auto const zero = square < Real(0.25);
    u1 *= inverse_sqrt(select(zero, Real(1), square));
    u1[0] = select(zero, Real(1), u1[0]);

    u2 = B.col(1) - u1 * u1.dot(B.col(1));
    Real const rest = u2.dot(u2);
    auto const flat = rest < Real(epsilon * epsilon / 64);
    Real const side = select(u1[2] < Real(0), Real(-1), Real(1));
    Real const a = Real(-1) / (side + u1[2]);
    perpendicular << u1[0] * u1[1] * a, side + u1[1] * u1[1] * a, -u1[1];
    Real const inverse = inverse_sqrt(select(flat, Real(1), rest));
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) u2[i] = select(flat, perpendicular[i], u2[i] * inverse);
    u2 -= u1 * u1.dot(u2);
    u2 *= inverse_sqrt(u2.dot(u2));

    Matrix<Real, 3> U;
    U.col(0) = u1;
    U.col(1) = u2;
    U.col(2) = u1.cross(u2);
    return U;
}

/// Removes what rounding has added to a rotation: one step of Newton for the lengths is enough.
template <Lane Real>
FIRN_HOST_DEVICE inline void make_orthonormal(Matrix<Real, 3>& V)
{
    Vector<Real, 3> v1 = V.col(0), v2 = V.col(1);
    v1 *= Real(1.5) - Real(0.5) * v1.dot(v1);
    v2 -= v1 * v1.dot(v2);
    v2 *= Real(1.5) - Real(0.5) * v2.dot(v2);
    V.col(0) = v1;
    V.col(1) = v2;
    V.col(2) = v1.cross(v2);
}

} // namespace detail

/// Singular values of a 2 × 2 matrix: one rotation of one-sided Jacobi.
template <Lane Real>
FIRN_HOST_DEVICE inline SingularValues<Real, 2> singular_values(Matrix<Real, 2> const& F)
{
    Real scale;
    Matrix<Real, 2> B = detail::scaled_to_one<Real, 2>(F, scale);
    Matrix<Real, 2> V = Matrix<Real, 2>::Identity();
    detail::make_orthogonal<0, 1>(B, V);
    Vector<Real, 2> square(B.col(0).dot(B.col(0)), B.col(1).dot(B.col(1)));
    detail::put_longer_first<0, 1>(B, V, square);

    auto const zero = square[0] < Real(0.25);
    Real const inverse = inverse_sqrt(select(zero, Real(1), square[0]));
    Real const c = select(zero, Real(1), B(0, 0) * inverse), s = B(1, 0) * inverse;
    Real const sigma1 = square[0] * inverse * scale;
    Real const sigma2 = (c * B(1, 1) - s * B(0, 1)) * scale;

    SingularValues<Real, 2> result;
    result.U << c, -s, s, c;
    result.sigma << sigma1, max(-sigma1, min(sigma1, sigma2)); // the order holds to the last bit
    result.V = V;
    return result;
}

/// Singular values of a 3 × 3 matrix: one-sided Jacobi with a fixed number of sweeps, without branches. It
/// never forms FᵀF, which would lose the small singular values (relative to the largest) to rounding.
template <Lane Real>
FIRN_HOST_DEVICE inline SingularValues<Real, 3> singular_values(Matrix<Real, 3> const& F)
{
    constexpr int sweeps = 4; // three leave residuals of 5e-6, in float and in double
    Real scale;
    Matrix<Real, 3> const A = detail::scaled_to_one<Real, 3>(F, scale);
    Matrix<Real, 3> B = A, V = Matrix<Real, 3>::Identity();
#pragma GCC unroll 1
    for (int sweep = 1; sweep < sweeps; ++sweep) detail::make_orthogonal(B, V);
    // Start the last sweep afresh: the others have left rounding errors in B and V.
    detail::make_orthonormal(V);
    B = A * V;
    detail::make_orthogonal(B, V);

    Vector<Real, 3> square(B.col(0).dot(B.col(0)), B.col(1).dot(B.col(1)), B.col(2).dot(B.col(2)));
    detail::put_longer_first<0, 1>(B, V, square);
    detail::put_longer_first<0, 2>(B, V, square);
    detail::put_longer_first<1, 2>(B, V, square);

    SingularValues<Real, 3> result;
    result.U = detail::orthonormal_along(B);
    result.V = V;
    Real const sigma1 = result.U.col(0).dot(B.col(0)) * scale;
    Real const sigma2 = min(sigma1, abs(result.U.col(1).dot(B.col(1))) * scale);
    Real const sigma3 = result.U.col(2).dot(B.col(2)) * scale;
    result.sigma << sigma1, sigma2, max(-sigma2, min(sigma2, sigma3)); // the order holds to the last bit
    return result;
}

} // namespace firn
