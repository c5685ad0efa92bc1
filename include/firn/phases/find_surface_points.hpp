// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/effects/contact.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/phases/find_candidates.hpp>
#include <firn/phases/step_context.hpp>
#include <firn/phases/surface_stencils.hpp>

#include <cstddef>
#include <cstdint>
#include <limits>

namespace firn
{

/// Finds the points of obstacles' surfaces by these candidates, or where points were before. Each of these
/// nodes has the point of the obstacle nearest to it, if that lies in the cube of a cell around the node.
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
        std::size_t const first = found.kept.mask != 0 ? 0 : found.known.count, number = first + c;
        if (number >= found.known.count + *found.new_candidates || number >= found.candidates_room ||
            found.seen[number] != found.step)
            return;
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
        if (-at.distance > Candidates::template deep_from<Number>(obstacle, place, at.normal))
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
        SurfacePoint<Number, d> point{};
        point.node = place.first;
        point.offset = shift * static_cast<Number>(1 / lattice.cell_size);
        point.normal = at.normal;
        point.velocity = obstacle.template velocity_at<Number>(at.arm);
        point.arm = at.arm;
        point.impulse = zeros<Vector<Number, d>>();
        point.found = found.step;
        point.obstacle = found.candidates[candidate].obstacle;
        point.candidate = candidate;
        point.behind = behind;
        point.is_deep = is_deep;
        point.is_plain = false;
        point.is_whole = true;
        Contact contact = obstacle.contact;
        if (is_deep && !contact.sticks) // nothing slides there
            contact = Contact::coulomb(std::numeric_limits<double>::max());
        point.is_two_sided = obstacle.is_thin(lattice);
        point.separates = contact.separates && !point.is_two_sided;
        point.sticks = contact.sticks;
        point.friction =
            static_cast<Number>(min(contact.friction, double(std::numeric_limits<Number>::max())));
        if (!moves(point)) note(point);
    }

    /// Whether it is a point of the step before, which has moved at most within its cell: then it takes this
    /// one's place. If that one came into another cell this one goes on with its impulse.
    FIRN_HOST_DEVICE bool moves(SurfacePoint<Number, d>& point) const
    {
        SurfacePoint<Number, d>* const before = found.kept.find(point);
        if (before == nullptr) return false;
        using Loop = PointLoop<Kernel, Number, d>;
        Vector<Number, d> offset;
        auto const cell = Loop::cell_of(point, offset), cell_before = Loop::cell_of(*before, offset);
        bool same = true;
        for (int a = 0; a < d; ++a) same = same && cell[a] == cell_before[a];
        if (!same) {
            before->gone = found.step;
            point.impulse = before->impulse;
            return false;
        }
        before->offset = point.offset;
        before->normal = point.normal;
        before->velocity = point.velocity;
        before->arm = point.arm;
        before->candidate = point.candidate;
        before->found = found.step;
        return true;
    }

    FIRN_HOST_DEVICE void note(SurfacePoint<Number, d> const& point) const
    {
        std::uint32_t const number = found.known_points + next_number_of_all(*found.new_points);
        if (number < found.points_room)
            found.points[number] = point; // else the host makes room, and looks again
    }
};

} // namespace firn
