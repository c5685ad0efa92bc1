// SPDX-License-Identifier: MIT
#pragma once

#include <firn/models/plasticity/deviator.hpp>

namespace firn
{

/// Principal extensions with the volume ratio J, where the squares of stretches have `share` of the deviator
/// of the given squares b: the result of flow that relaxes shear and keeps volume. `b` holds the squares less
/// one.
///
/// The squares are share dev b + m, and m solves det(share dev b + m I) = J^2. The common choice, which keeps
/// the trace of b instead, changes the volume by up to a half. In the plane m = sqrt(J^2 + |share dev b|^2 /
/// 2); in space Newton's iteration descends to the root from m = tr b / 3: the cubic is convex and increasing
/// there.
template <Lane Real, int d>
FIRN_HOST_DEVICE inline Vector<Real, d> relaxed_extensions(Deviator<Real, d> const& b, Real share, Real J)
{
    using Number = ScalarOf<Real>;
    Vector<Real, d> const s = b.part * share;
    Real m;
    if constexpr (d == 2)
        m = sqrt(J * J + Real(Number(0.5)) * s.squaredNorm());
    else {
        Real const half_square = Real(Number(0.5)) * s.squaredNorm(), cube = s[0] * s[1] * s[2] - J * J;
        Real const enough(Number(1e-3) *
                          std::sqrt(std::numeric_limits<Number>::epsilon())); // of the last step
        m = Real(1) + b.trace * Real(Number(1.0 / 3));
        Mask<Real> far = m > Real(0);
        for (int i = 0; i < 12; ++i) { // 4 to 6 are enough, 11 at the most
            // The slope vanishes only where two squares do, that is at zero volume.
            Real const slope = Real(3) * m * m - half_square;
            Real const step = ((m * m - half_square) * m + cube) / slope;
            m = select(far & (step > Real(0)), m - step, m);
            far = far & (step > enough * m);
            if (!any(far)) break;
        }
    }
    Vector<Real, d> extension;
    FIRN_UNROLL
    for (int i = 0; i < d; ++i) extension[i] = sqrt(max(s[i] + m, Real(0))) - Real(1);
    return extension;
}

} // namespace firn
