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

/// Calls `use(action, first)` for each action of the chain that acts at surfaces. Their obstacles are
/// numbered through, those of this one from `first` on.
template <class... Actions, class Use>
FIRN_HOST_DEVICE void for_each_at_surface(Chain<Actions...> const& chain, Use const& use)
{
    std::uint32_t first = 0;
    chain.for_each([&](auto const& action) {
        if constexpr (is_group_at_surface<std::decay_t<decltype(action)>>) {
            use(action, first);
            first += action.sums.obstacles;
        }
    });
}

/// Calls `use(action, i)` for the one of them that has an obstacle, whose number is `i` there.
template <class... Actions, class Use>
FIRN_HOST_DEVICE void with_surface_action(Chain<Actions...> const& chain, std::uint32_t obstacle,
                                          Use const& use)
{
    for_each_at_surface(chain, [&](auto const& action, std::uint32_t first) {
        if (obstacle - first < action.sums.obstacles) use(action, obstacle - first); // wraps if it is before
    });
}

/// On nodes, before they are updated: finds those at which points of obstacles' surfaces may lie, since they
/// have mass and are near a surface, or that lie deep inside.
template <class Space, class Kernel, class Transfer, class Effects>
struct FindCandidates
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
        auto const in_cells = [&](double cells) {
            return Real(static_cast<Number>(cells * lattice.cell_size));
        };
        for_each_at_surface(now->actions, [&](auto const& action, std::uint32_t first) {
            // a point lies at most half the diagonal of a cell from its node
            action.for_each_within(place, in_cells(1), [&](std::uint32_t i, auto const& obstacle) {
                auto const at = obstacle.template surface_at<Real>(place, zeros<Vector<Real, d>>());
                add<Real>(place, first + i,
                          filled & ((-at.distance > in_cells(deep_from(obstacle, place))) |
                                    (abs(at.distance) * largest_component<Real, d>(at.normal) <=
                                     in_cells(nearly_half_a_cell))));
            });
        });
    }

    /// From which depth on [cells] nodes are held: whatever sticks holds all that is inside. Others let
    /// particles lie a tenth of a cell inside before nodes that only these reach slow them down. Thin shells
    /// have no inside.
    FIRN_HOST_DEVICE static double deep_from(auto const& obstacle, auto const& place)
    {
        if (obstacle.is_thin(place.lattice)) return 1e9;
        return obstacle.contact.sticks ? 0 : place.kernel_reach + 0.1;
    }
    static constexpr double nearly_half_a_cell = 0.52;

private:
    template <class Real>
    FIRN_HOST_DEVICE void add(LanePosition<Real, d> const& place, std::uint32_t obstacle,
                              Mask<Real> const& which) const
    {
        if (!any(which)) return;
        constexpr int width = lane_width<Real>;
        Number along[std::size_t(d)][std::size_t(width)];
        for (int a = 0; a < d; ++a) LaneTraits<Real>::store(place.offset[a], along[a]);
        for_each_lane<width>(bits(which), [&](int lane) {
            SurfaceCandidate<d> candidate;
            for (int a = 0; a < d; ++a) candidate.node[a] = place.first[a] + static_cast<int>(along[a][lane]);
            candidate.obstacle = obstacle;
            std::uint32_t number = found.known.find(candidate);
            if (number == KnownCandidates<d>::absent) {
                number = found.known.count + next_number_of_all(*found.new_candidates);
                if (number >= found.candidates_room) return; // the host makes room, and looks again
                found.candidates[number] = candidate;
            }
            found.seen[number] = found.step;
        });
    }
};

/// Finds the points of obstacles' surfaces by these candidates. Each of these nodes has the point of the
/// obstacle nearest to it, if that lies in the cube of a cell around the node.
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
    using Candidates = FindCandidates<Space, Kernel, Transfer, Effects>;

    StepContext<Number, Effects> const* now;
    Lattice lattice;
    SurfacePoints<Number, d> found;

    FIRN_HOST_DEVICE void operator()(std::size_t c) const
    {
        std::size_t const number = found.known.count + c;
        if (c >= *found.new_candidates || number >= found.candidates_room) return;
        SurfaceCandidate<d> const candidate = found.candidates[number];
        LanePosition<Number, d> const place{lattice, candidate.node, zeros<Vector<Number, d>>(),
                                            kernel_reach(Kernel::degree)};
        with_surface_action(now->actions, candidate.obstacle, [&](auto const& action, std::uint32_t i) {
            find(place, static_cast<std::uint32_t>(number), action.obstacles[i]);
        });
    }

    /// How far from a node obstacles matter: its points lie within a cell, and others may be a kernel's reach
    /// beside.
    static constexpr double looks_as_far = 3;

private:
    using At = SurfaceAt<Number, d>;

    FIRN_HOST_DEVICE Number in_cells(double cells) const
    {
        return static_cast<Number>(cells * lattice.cell_size);
    }

    /// Calls `use(j, other)` for each obstacle near a place but thin shells and the one with this number.
    template <class Use>
    FIRN_HOST_DEVICE void for_each_other(LanePosition<Number, d> const& place, std::uint32_t number,
                                         Use const& use) const
    {
        for_each_at_surface(now->actions, [&](auto const& action, std::uint32_t first) {
            action.for_each_within(place, in_cells(looks_as_far), [&](std::uint32_t j, auto const& other) {
                if (first + j != number && !other.is_thin(place.lattice)) use(first + j, other);
            });
        });
    }

    template <class Obstacle>
    FIRN_HOST_DEVICE void find(LanePosition<Number, d> const& place, std::uint32_t number,
                               Obstacle const& obstacle) const
    {
        std::uint32_t const i = found.candidates[number].obstacle;
        constexpr double rounding = 1.0001; // two cubes may have one point, and none may be missing
        Vector<Number, d> shift = zeros<Vector<Number, d>>();
        At at = obstacle.template surface_at<Number>(place, shift);
        if (-at.distance > in_cells(Candidates::deep_from(obstacle, place)))
            add(place, number, obstacle, at, shift, true, 0);
        if (!(abs(at.distance) * largest_component<Number, d>(at.normal) <=
              in_cells(Candidates::nearly_half_a_cell)))
            return;
        for (int twice = 0; twice < 2; ++twice) { // distances may be estimates
            shift -= at.normal * at.distance;
            at = obstacle.template surface_at<Number>(place, shift);
        }
        if (!(largest_component<Number, d>(shift) <= in_cells(0.5 * rounding))) return;
        auto const is_covered = [&] {
            bool is_inside_another = false;
            for_each_other(place, i, [&](std::uint32_t j, auto const& other) {
                if (!is_inside_another)
                    is_inside_another = is_inside(place, shift, at.normal, obstacle, other, i < j);
            });
            return is_inside_another;
        };
        Vector<Number, d> inwards = zeros<Vector<Number, d>>();
        for (int face = 0; is_covered(); ++face)
            if (face == d || !look_beside(place, obstacle, inwards, at, shift) ||
                !(largest_component<Number, d>(shift) <= in_cells(0.5 * rounding)))
                return;
        add(place, number, obstacle, at, shift, false, 0);
        for_each_other(place, i, [&](std::uint32_t j, auto const& other) {
            go_on_behind(place, number, obstacle, at, shift, j, other);
        });
    }

    /// The face nearest to a node may lie inside another obstacle, as where two boxes stand side by side, and
    /// another one may lie in the node's cube, too: the nearest face farther inside. False if there is none.
    template <class Obstacle>
    FIRN_HOST_DEVICE bool look_beside(LanePosition<Number, d> const& place, Obstacle const& obstacle,
                                      Vector<Number, d>& inwards, At& at, Vector<Number, d>& shift) const
    {
        inwards -= at.normal * in_cells(0.55);
        At const deeper = obstacle.template surface_at<Number>(place, inwards);
        if (dot<Number, d>(deeper.normal, at.normal) > Number(0.9)) return false;
        shift = deeper.normal * (dot<Number, d>(inwards, deeper.normal) - deeper.distance);
        at = obstacle.template surface_at<Number>(place, shift);
        at.normal = deeper.normal;
        return abs(at.distance) < in_cells(0.01);
    }

    /// Where a surface ends at another obstacle, continues it into that one: a point at a distance from the
    /// corner has one as far behind it. Without these the nodes behind the corner would be free.
    template <class Obstacle, class Other>
    FIRN_HOST_DEVICE void go_on_behind(LanePosition<Number, d> const& place, std::uint32_t candidate,
                                       Obstacle const& obstacle, At at, Vector<Number, d> const& shift,
                                       std::uint32_t j, Other const& other) const
    {
        At const of_other = other.template surface_at<Number>(place, shift);
        Vector<Number, d> const way =
            at.normal * dot<Number, d>(of_other.normal, at.normal) - of_other.normal;
        Number const steepness2 = dot<Number, d>(way, way), reach = in_cells(place.kernel_reach),
                     least = in_cells(0.05);
        Number const distance =
            max(of_other.distance, Number(0)); // times the way, over steepness2: to the corner
        if (!(steepness2 > Number(0.1)) || !(distance * distance < reach * reach * steepness2)) return;
        Vector<Number, d> const along = way * (2 * distance / steepness2), behind = shift + along;
        // just above it: the other may stand on this one
        if (!(other.template surface_at<Number>(place, Vector<Number, d>(behind + at.normal * (2 * least)))
                  .distance < -least) ||
            !(abs(obstacle.template surface_at<Number>(place, behind).distance) > least))
            return;
        at.arm += along;
        add(place, candidate, obstacle, at, behind, false, j + 1);
    }

    /// Whether a point of an obstacle's surface, with this normal, lies inside another one and is no surface
    /// therefore. Where both have the same face it is that of the first.
    template <class Obstacle, class Other>
    FIRN_HOST_DEVICE bool is_inside(LanePosition<Number, d> const& place, Vector<Number, d> const& shift,
                                    Vector<Number, d> const& normal, Obstacle const& obstacle,
                                    Other const& other, bool is_first) const
    {
        At const there = other.template surface_at<Number>(place, shift);
        Number const least = in_cells(0.01), little = in_cells(0.05);
        if (!(there.distance < least)) return false;
        At const outside =
            other.template surface_at<Number>(place, Vector<Number, d>(shift + normal * little));
        if (outside.distance > little - least)
            return !is_first && dot<Number, d>(outside.normal, normal) > Number(0.99);
        // The way along the surface out of the other, as seen from above the surface, where a face that both
        // share is far: half a cell behind that the surface goes on.
        Number const reach = in_cells(place.kernel_reach);
        At const above = other.template surface_at<Number>(place, Vector<Number, d>(shift + normal * reach));
        Vector<Number, d> const way = above.normal - normal * dot<Number, d>(above.normal, normal);
        Number const steepness2 = dot<Number, d>(way, way);
        if (!(steepness2 > Number(0.1)) || !(above.distance > Number(-1.5) * reach)) return true;
        Number const steepness = sqrt(steepness2);
        Vector<Number, d> const beyond =
            shift + way * ((in_cells(0.5) - min(above.distance, Number(0)) / steepness) / steepness);
        return !(abs(obstacle.template surface_at<Number>(place, beyond).distance) < in_cells(0.25));
    }

    template <class Obstacle>
    FIRN_HOST_DEVICE void add(LanePosition<Number, d> const& place, std::uint32_t candidate,
                              Obstacle const& obstacle, At const& at, Vector<Number, d> const& shift,
                              bool is_deep, std::uint32_t behind) const
    {
        std::uint32_t const number = found.known_points + next_number_of_all(*found.new_points);
        if (number >= found.points_room) return; // the host makes room, and looks again
        SurfacePoint<Number, d>& point = found.points[number];
        point.node = place.first;
        point.offset = shift * static_cast<Number>(1 / lattice.cell_size);
        point.normal = at.normal;
        point.velocity = obstacle.template velocity_at<Number>(at.arm);
        point.arm = at.arm;
        point.impulse = zeros<Vector<Number, d>>();
        point.obstacle = found.candidates[candidate].obstacle;
        point.candidate = candidate;
        point.behind = behind;
        point.is_deep = is_deep;
        point.is_plain = point.is_listed = false;
        point.is_whole = true;
        Contact contact = obstacle.contact;
        if (is_deep && !contact.sticks) // nothing slides there
            contact = Contact::coulomb(std::numeric_limits<double>::max());
        point.is_two_sided = obstacle.is_thin(lattice);
        point.separates = contact.separates && !point.is_two_sided;
        point.sticks = contact.sticks;
        point.friction =
            static_cast<Number>(min(contact.friction, double(std::numeric_limits<Number>::max())));
    }
};

} // namespace firn
