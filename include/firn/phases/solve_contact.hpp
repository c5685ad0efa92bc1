// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/lane.hpp>
#include <firn/math/product.hpp>

#include <cstddef>

// What obstacles leave of a node's motion while an implicit step is solved. All of it is found by asking them
// what they do to velocities, so it holds for any effect that acts as contact does, and for several at once.
namespace firn
{

/// What effects leave of motion in any velocity: c(v) = P v + still.
template <class Real, int d>
struct FreeMotion
{
    Matrix<Real, d> free; ///< P
    Vector<Real, d> still;
    Real bent;  ///< how far c is from that of a projection P
    Real moves; ///< how far c(c(v)) is from c(v), which contact leaves as it is
};

/// Asks effects about motion along each axis, forth and back, and whether they also let go of it or take hold
/// of it at speeds beyond that of any obstacle: one that moves as fast as it is asked about would seem to
/// hold on, or not to be there.
template <Lane Real, int d, class Touched>
FIRN_HOST_DEVICE FreeMotion<Real, d> free_motion(Touched const& touched)
{
    FreeMotion<Real, d> motion;
    motion.still = touched(zeros<Vector<Real, d>>());
    motion.bent = motion.moves = Real(0);
    auto const compare = [&](Real& most, Vector<Real, d> const& difference) {
        for (int i = 0; i < d; ++i) most = max(most, abs(difference[i]));
    };
    for (int a = 0; a < d; ++a) {
        Vector<Real, d> along = zeros<Vector<Real, d>>();
        along[a] = Real(1);
        Vector<Real, d> const forth = touched(along);
        along[a] = Real(-1);
        Vector<Real, d> const back = touched(along);
        for (int i = 0; i < d; ++i) motion.free(i, a) = forth[i] - motion.still[i];
        compare(motion.bent, Vector<Real, d>(forth + back - motion.still * Real(2)));
        compare(motion.moves, Vector<Real, d>(touched(forth) - forth));
        compare(motion.moves, Vector<Real, d>(touched(back) - back));
        constexpr double beyond = 0x1p40; // [m/s]
        along[a] = Real(ScalarOf<Real>(beyond));
        Vector<Real, d> both = touched(along);
        along[a] = Real(ScalarOf<Real>(-beyond));
        both += touched(along) - motion.still * Real(2);
        compare(motion.bent, Vector<Real, d>(both * Real(ScalarOf<Real>(1 / beyond))));
    }
    Matrix<Real, d> const& P = motion.free;
    Matrix<Real, d> const twice = product<Real, d>(P, P);
    for (int i = 0; i < d; ++i)
        for (int j = 0; j < d; ++j)
            motion.bent = max(motion.bent, max(abs(twice(i, j) - P(i, j)), abs(P(i, j) - P(j, i))));
    return motion;
}

/// The projection to the space that the columns of a matrix span, those that are short left out.
template <Lane Real, int d>
FIRN_HOST_DEVICE Matrix<Real, d> projection_to_range(Matrix<Real, d> columns)
{
    constexpr double shortest = 0.1; // of a column, where effects leave motion along an axis with length 1
    Matrix<Real, d> P = zeros<Matrix<Real, d>>();
    for (int rank = 0; rank < d; ++rank) {
        Vector<Real, d> longest = columns.col(0);
        Real square = dot<Real, d>(longest, longest);
        for (int a = 1; a < d; ++a) {
            Vector<Real, d> const other = columns.col(a);
            Real const of_other = dot<Real, d>(other, other);
            Mask<Real> const longer = of_other > square;
            for (int i = 0; i < d; ++i) longest[i] = select(longer, other[i], longest[i]);
            square = select(longer, of_other, square);
        }
        Mask<Real> const counts = square > Real(ScalarOf<Real>(shortest * shortest));
        Real const inverse = select(counts, Real(1) / sqrt(select(counts, square, Real(1))), Real(0));
        Vector<Real, d> const q = longest * inverse;
        for (int i = 0; i < d; ++i)
            for (int j = 0; j < d; ++j) P(i, j) += q[i] * q[j];
        for (int a = 0; a < d; ++a) {
            Vector<Real, d> const column = columns.col(a);
            columns.col(a) = column - q * dot<Real, d>(q, column);
        }
    }
    return P;
}

/// What contact leaves of a node's motion as it is just now.
template <class Real, int d>
struct ContactNow
{
    Matrix<Real, d> free;     ///< the projection to motion that is free
    Vector<Real, d> velocity; ///< of which the rest is prescribed
    Vector<Real, d> friction; ///< the change of velocity along free motion, times the node's weight
};

/// Contact of a node that forces drive to the velocity y: it is at the velocity c(y) then, and contact
/// changes the momentum by w (c(y) - y), w being the weight by which y was found. Along what is free that is
/// friction. Which motion is free is found by differences about a y that lies deeper in contact, where c is
/// the same: a node that sticks keeps nothing, one that slides its motion along the surface.
template <Lane Real, int d, class Touched>
FIRN_HOST_DEVICE ContactNow<Real, d> contact_now(Touched const& touched, Vector<Real, d> const& y,
                                                 Real const& weight)
{
    using Number = ScalarOf<Real>;
    ContactNow<Real, d> now;
    now.velocity = touched(y);
    Vector<Real, d> const held = y - now.velocity;
    Real const held2 = dot<Real, d>(held, held), y2 = dot<Real, d>(y, y);
    constexpr Number small = sizeof(Number) == 4 ? Number(1e-3) : Number(1e-6); // how near to sliding
    Real const rounding(Number(sizeof(Number) == 4 ? 1e-10 : 1e-24));           // of squares
    Mask<Real> const touches = held2 > rounding * y2;
    Real const deep = sqrt(max(y2, held2)),
               inverse = select(touches, Real(1) / sqrt(select(touches, held2, Real(1))), Real(0)),
               step = select(touches, deep * Real(small), Real(1));
    Vector<Real, d> const base = y + held * (inverse * deep);
    Matrix<Real, d> slopes;
    for (int a = 0; a < d; ++a) {
        Vector<Real, d> forth = base, back = base;
        forth[a] += step;
        back[a] -= step;
        Vector<Real, d> const difference = (touched(forth) - touched(back)) * (Real(Number(0.5)) / step);
        for (int i = 0; i < d; ++i) slopes(i, a) = select(touches, difference[i], i == a ? Real(1) : Real(0));
    }
    now.free = projection_to_range<Real, d>(slopes);
    now.friction = product<Real, d>(now.free, Vector<Real, d>(held * (Real(0) - weight)));
    return now;
}

} // namespace firn
