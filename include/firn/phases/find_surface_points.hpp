// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/effects/chain.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/phases/scatter.hpp>
#include <firn/phases/step_context.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>

namespace firn
{

/// Calls `use(action)` for the action of the chain that acts at surfaces.
template <class... Actions, class Use>
FIRN_HOST_DEVICE void with_surface_action(Chain<Actions...> const& chain, Use const& use)
{
    chain.for_each([&](auto const& action) {
        if constexpr (is_group_at_surface<std::decay_t<decltype(action)>>) use(action);
    });
}

/// On nodes, before they are updated: finds points of obstacles' surfaces. Each node that has mass has, of
/// each obstacle, the point nearest to it, if that lies in the cube of a cell around the node.
///
/// A point inside another obstacle is no surface, so where obstacles touch, overlap or share a face they have
/// that of their union. Of two obstacles with the same face, the first in the list has it. One exception is a
/// surface that goes on where the other obstacle ends, as a floor does under a wall: without it the nodes
/// behind a corner would be free.
template <class Space, class Kernel, class Transfer, class Effects>
struct FindSurfacePoints
{
    static constexpr int d = Space::dimension;
    using Number = typename Space::Scalar;
    using Sums = NodeSums<d, SumsOf<Transfer>>;
    static constexpr bool looks_around = false;
    using Result = NothingFound;

    StepContext<Number, Effects> const* now;
    Lattice lattice;
    Number smallest_mass; ///< see UpdateGrid
    SurfacePoints<Number, d> found;

    template <class Node>
    FIRN_HOST_DEVICE void operator()(Node& node, Result&) const
    {
        using Real = typename Node::Real;
        Mask<Real> const filled = node.sum(Sums::mass) > Real(smallest_mass);
        if (!any(filled)) return;
        LanePosition<Real, d> const place{lattice, node.first(), node.offset(), kernel_reach(Kernel::degree)};
        with_surface_action(now->actions, [&](auto const& action) {
            action.for_each_within(place, in_cells<Real>(looks_as_far),
                                   [&](std::uint32_t i, auto const& obstacle) {
                                       find<Real>(action, place, filled, i, obstacle);
                                   });
        });
    }

    /// How far from a node obstacles matter: its points lie within a cell, and others may be a kernel's reach
    /// beside.
    static constexpr double looks_as_far = 3;

private:
    template <class Real>
    FIRN_HOST_DEVICE Real in_cells(double cells) const
    {
        return Real(static_cast<Number>(cells * lattice.cell_size));
    }

    template <class Real>
    FIRN_HOST_DEVICE static Real largest_of(Vector<Real, d> const& v)
    {
        Real largest = abs(v[0]);
        for (int a = 1; a < d; ++a) largest = max(largest, abs(v[a]));
        return largest;
    }

    template <class Real, class Action, class Obstacle>
    FIRN_HOST_DEVICE void find(Action const& action, LanePosition<Real, d> const& place,
                               Mask<Real> const& filled, std::uint32_t i, Obstacle const& obstacle) const
    {
        constexpr double rounding = 1.0001; // two cubes may have one point, and none may be missing
        Vector<Real, d> shift = zeros<Vector<Real, d>>();
        SurfaceAt<Real, d> at = obstacle.template surface_at<Real>(place, shift);
        // whatever sticks holds all that is inside
        Real const least = in_cells<Real>(obstacle.contact.sticks ? 0 : place.kernel_reach);
        Mask<Real> const deep = filled & (-at.distance > least);
        Mask<Real> here = filled & (abs(at.distance) * largest_of<Real>(at.normal) <= in_cells<Real>(0.52));
        if (any(deep)) emit<Real>(place, i, obstacle, at, shift, deep, true, 0);
        if (!any(here)) return;
        for (int twice = 0; twice < 2; ++twice) { // distances may be estimates
            shift -= at.normal * at.distance;
            at = obstacle.template surface_at<Real>(place, shift);
        }
        here = here & (largest_of<Real>(shift) <= in_cells<Real>(0.5 * rounding));
        if (!any(here)) return;
        action.for_each_within(place, in_cells<Real>(looks_as_far), [&](std::uint32_t j, auto const& other) {
            if (j != i) here = here & !is_inside<Real>(place, shift, at.normal, obstacle, other, i < j);
        });
        if (!any(here)) return;
        emit<Real>(place, i, obstacle, at, shift, here, false, 0);
        action.for_each_within(place, in_cells<Real>(looks_as_far), [&](std::uint32_t j, auto const& other) {
            if (j != i) go_on_behind<Real>(place, i, obstacle, at, shift, here, j, other);
        });
    }

    /// Where a surface ends at another obstacle, continues it into that one: a point at a distance from the
    /// corner has one as far behind it. Without these the nodes behind the corner would be free.
    template <class Real, class Obstacle, class Other>
    FIRN_HOST_DEVICE void go_on_behind(LanePosition<Real, d> const& place, std::uint32_t i,
                                       Obstacle const& obstacle, SurfaceAt<Real, d> at,
                                       Vector<Real, d> const& shift, Mask<Real> const& here, std::uint32_t j,
                                       Other const& other) const
    {
        auto const of_other = other.template surface_at<Real>(place, shift);
        Vector<Real, d> const way = at.normal * dot<Real, d>(of_other.normal, at.normal) - of_other.normal;
        Real const steepness2 = max(dot<Real, d>(way, way), Real(Number(0.01)));
        Real const distance =
            max(of_other.distance, Real(0)); // times the way, over steepness2: to the corner
        Real const reach = in_cells<Real>(place.kernel_reach), least = in_cells<Real>(0.05);
        Mask<Real> which =
            here & (steepness2 > Real(Number(0.1))) & (distance * distance < reach * reach * steepness2);
        if (!any(which)) return;
        Vector<Real, d> const along = way * (Real(2) * distance / steepness2), behind = shift + along;
        which = which & (other.template surface_at<Real>(place, behind).distance < -least) &
                (abs(obstacle.template surface_at<Real>(place, behind).distance) > least);
        if (!any(which)) return;
        at.arm += along;
        emit<Real>(place, i, obstacle, at, behind, which, false, j + 1);
    }

    /// Whether a point of an obstacle's surface, with this normal, lies inside another one and is no surface
    /// therefore. Where both have the same face it is that of the first.
    template <class Real, class Obstacle, class Other>
    FIRN_HOST_DEVICE Mask<Real> is_inside(LanePosition<Real, d> const& place, Vector<Real, d> const& shift,
                                          Vector<Real, d> const& normal, Obstacle const& obstacle,
                                          Other const& other, bool is_first) const
    {
        SurfaceAt<Real, d> const there = other.template surface_at<Real>(place, shift);
        Real const least = in_cells<Real>(0.01);
        Mask<Real> inside = there.distance < least;
        if (is_first)
            inside = inside &
                     !((there.distance > -least) & (dot<Real, d>(there.normal, normal) > Real(Number(0.99))));
        if (!any(inside)) return inside;
        // The way along the surface out of the other, as seen from above the surface, where a face that both
        // share is far: half a cell behind that the surface goes on.
        Real const reach = in_cells<Real>(place.kernel_reach);
        auto const above = other.template surface_at<Real>(place, Vector<Real, d>(shift + normal * reach));
        Vector<Real, d> const way = above.normal - normal * dot<Real, d>(above.normal, normal);
        Real const steepness2 = dot<Real, d>(way, way);
        Mask<Real> const leads_out =
            (steepness2 > Real(Number(0.1))) & (above.distance > -reach * Real(Number(1.5)));
        if (!any(inside & leads_out)) return inside;
        Real const steepness = sqrt(max(steepness2, Real(Number(0.01))));
        Vector<Real, d> const beyond =
            shift + way * ((in_cells<Real>(0.5) - min(above.distance, Real(0)) / steepness) / steepness);
        Mask<Real> const goes_on =
            leads_out &
            (abs(obstacle.template surface_at<Real>(place, beyond).distance) < in_cells<Real>(0.25));
        return inside & !goes_on;
    }

    /// Stores points of some lanes.
    template <class Real, class Obstacle>
    FIRN_HOST_DEVICE void emit(LanePosition<Real, d> const& place, std::uint32_t i, Obstacle const& obstacle,
                               SurfaceAt<Real, d> const& at, Vector<Real, d> const& shift,
                               Mask<Real> const& which, bool is_deep, std::uint32_t behind) const
    {
        constexpr int width = lane_width<Real>;
        auto const velocity = obstacle.template velocity_at<Real>(at.arm);
        Number along[std::size_t(d)][std::size_t(width)], of_shift[std::size_t(d)][std::size_t(width)],
            normal[std::size_t(d)][std::size_t(width)], of_surface[std::size_t(d)][std::size_t(width)],
            arm[std::size_t(d)][std::size_t(width)];
        for (int a = 0; a < d; ++a) {
            LaneTraits<Real>::store(place.offset[a], along[a]);
            LaneTraits<Real>::store(shift[a], of_shift[a]);
            LaneTraits<Real>::store(at.normal[a], normal[a]);
            LaneTraits<Real>::store(velocity[a], of_surface[a]);
            LaneTraits<Real>::store(at.arm[a], arm[a]);
        }
        Number const per_metre = static_cast<Number>(1 / lattice.cell_size);
        for_each_lane<width>(bits(which), [&](int lane) {
            std::uint32_t const number = next_number(*found.count);
            if (number >= found.room) return; // the host makes room, and looks again
            auto& point = found.points[number];
            for (int a = 0; a < d; ++a) {
                point.node[a] = place.first[a] + static_cast<int>(along[a][lane]);
                point.offset[a] = of_shift[a][lane] * per_metre;
                point.normal[a] = normal[a][lane];
                point.velocity[a] = of_surface[a][lane];
                point.arm[a] = arm[a][lane];
                point.impulse[a] = point.tried[a] = 0;
            }
            point.obstacle = i;
            point.behind = behind;
            point.is_deep = is_deep;
            Contact contact = obstacle.contact;
            if (is_deep && !contact.sticks) // nothing slides there
                contact = Contact::coulomb(std::numeric_limits<double>::max());
            point.separates = contact.separates;
            point.sticks = contact.sticks;
            point.friction =
                static_cast<Number>(min(contact.friction, double(std::numeric_limits<Number>::max())));
        });
    }
};

} // namespace firn
