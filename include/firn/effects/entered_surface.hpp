// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/effects/contact.hpp>
#include <firn/effects/effect.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/math/product.hpp>

#include <limits>

namespace firn
{

/// Where lanes of particles came into a solid on their way through a step.
template <Lane Real, int d>
struct EnteredSurface
{
    Mask<Real> found;
    Real when;              ///< the share of the way until there
    Real depth;             ///< of the end of the way below the plane that touches the surface there [m]
    Vector<Real, d> normal; ///< of that plane, outward

    /// Takes over what lanes found elsewhere.
    FIRN_HOST_DEVICE void take(Mask<Real> const& lanes, EnteredSurface const& from)
    {
        when = select(lanes, from.when, when);
        depth = select(lanes, from.depth, depth);
        for (int a = 0; a < d; ++a) normal[a] = select(lanes, from.normal[a], normal[a]);
    }
};

/// How many times the distance from a solid is asked for at most along a way.
inline constexpr int most_looks = 16;

/// Finds where lanes came into the solid of an action that is larger than its shape by `skin` [m].
/// `place` is the end of their way [m], which is relative to the solid. Lanes that began inside did not come
/// in.
///
/// A step along the way leads to the plane that touches the solid at the point nearest to where the lanes
/// are. No convex solid begins before it. Others are as far away as the distance says: a step is at most
/// sixteen times that. Beside an edge the plane where lanes came in lies across it, so that of the face in
/// front of which they began counts, if they are behind it now.
template <Lane Real, int d, class Action>
FIRN_HOST_DEVICE EnteredSurface<Real, d>
entered_surface(Action const& action, LanePosition<Real, d> const& place, Vector<Real, d> const& way,
                Real skin, Mask<Real> open)
{
    using Number = ScalarOf<Real>;
    EnteredSurface<Real, d> entered{Real(1) < Real(0), Real(0), Real(0), zeros<Vector<Real, d>>()};
    Real const length = sqrt(dot<Real, d>(way, way)),
               per_length = Real(1) / max(length, Real(std::numeric_limits<Number>::min()));
    Real gone(0); // [m]
    for (int look = 0; look < most_looks && any(open); ++look) {
        Real const left = Real(1) - gone * per_length;
        SurfaceAt<Real, d> const at = action.template surface_at<Real>(place, Vector<Real, d>(way * -left));
        if (look == 0) open = open & !(at.distance < -skin) & !(at.distance > length + skin);
        Real const slope = dot<Real, d>(way, at.normal), depth = skin - at.distance - slope * left;
        Mask<Real> const is_here = open & !(at.distance > skin * Real(Number(0.5)));
        entered.found = entered.found | is_here;
        entered.when = select(is_here, gone * per_length, entered.when);
        Mask<Real> const is_of_face = entered.depth > Real(0);
        Real const turned = dot<Real, d>(entered.normal, at.normal);
        Mask<Real> const counts = is_here & !(is_of_face & (turned < Real(Number(0.99))));
        Mask<Real> const takes = look == 0 ? open : counts;
        entered.depth = select(takes, depth, entered.depth);
        for (int a = 0; a < d; ++a) entered.normal[a] = select(takes, at.normal[a], entered.normal[a]);
        gone += (at.distance - skin * Real(Number(0.25))) / max(-slope * per_length, Real(Number(0.0625)));
        open = open & !is_here & !(gone > length);
    }
    return entered;
}

/// Lets lanes that came in touch the plane there, in place of what they touch otherwise.
template <Lane Real, int d, class Action>
FIRN_HOST_DEVICE void touch_where_entered(Action const& action, EnteredSurface<Real, d> const& entered,
                                          Vector<Real, d> const& velocity, Contact const& rule,
                                          ContactResult<Real, d>& touched)
{
    touched.surface = action.template velocity_at<Real>(touched.arm);
    Vector<Real, d> const left =
        touched.surface + rule.after<Real, d>(Vector<Real, d>(velocity - touched.surface), entered.normal);
    for (int a = 0; a < d; ++a) {
        touched.velocity[a] = select(entered.found, left[a], touched.velocity[a]);
        touched.normal[a] = select(entered.found, entered.normal[a], touched.normal[a]);
    }
    touched.depth = select(entered.found, entered.depth, touched.depth);
    touched.surface_speed2 =
        select(entered.found, dot<Real, d>(touched.surface, touched.surface), touched.surface_speed2);
    touched.inside = touched.inside | entered.found;
}

} // namespace firn
