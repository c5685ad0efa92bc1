// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/lane.hpp>
#include <firn/effects/effect.hpp>

namespace firn
{

/// Cundall's local damping (Cundall 1987, *Distinct element models of rock and soil structure*): along each
/// axis the force on a node, of the material and of all effects, is weakened by a share where it drives the
/// node on, and strengthened by it where it slows the node down. For loading a scene, as Damping is, and not
/// for its physics.
///
///   f -> f - share |f| sign(v)
///
/// It does nothing where forces balance, whatever the velocity, so steady motion is not damped, and all
/// frequencies are damped alike: by 4 share of the energy in a period, for small shares. Bodies that fall
/// freely do so at 1 - share of gravity. The force must be known apart from the momentum, so the transfer is
/// Flip or Asflip; others are refused at compile time.
struct LocalDamping
{
    double share = 0.8; ///< of the force [-]

    /// Throws an Error unless the share is in [0, 1).
    void validate() const
    {
        require(is_finite(share) && share >= 0 && share < 1, "the share of local damping is outside [0, 1)",
                "LocalDamping", "Pass e.g. 0.8 to bring a scene to rest.");
    }

    /// Of one step: weakens impulses that drive nodes on.
    template <class Number>
    struct Action
    {
        Number share;

        template <Lane Real, int d>
        FIRN_HOST_DEVICE void on_impulse(Vector<Real, d>& impulse, Vector<Real, d> const& momentum) const
        {
            Real const zero(Number(0)), alpha(share);
            for (int a = 0; a < d; ++a) {
                Real const less = alpha * abs(impulse[a]);
                impulse[a] -= select(momentum[a] > zero, less, select(momentum[a] < zero, -less, zero));
            }
        }
    };

    template <class Number, int d>
    FIRN_HOST_DEVICE Action<Number> over(Interval const&) const
    {
        return {static_cast<Number>(share)};
    }
};

} // namespace firn
