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
/// behind a corner would be free. For the same reason a surface that ends at a corner is continued behind it.
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
            (number < found.known.count && found.seen[number] != found.step))
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
        for_each_solid_at_surface(now->actions, place, in_cells(looks_as_far),
                                  [&](std::uint32_t j, auto const& other) {
                                      if (j != number) use(j, other);
                                  });
    }

    template <class Obstacle>
    FIRN_HOST_DEVICE void find(LanePosition<Number, d> const& place, std::uint32_t number,
                               Obstacle const& obstacle) const
    {
        std::uint32_t const i = found.candidates[number].obstacle;
        Vector<Number, d> shift = zeros<Vector<Number, d>>();
        At at = obstacle.template surface_at<Number>(place, shift);
        if (-at.distance > Candidates::template deep_from<Number>(obstacle, place, at.normal))
            add(place, number, obstacle, at, shift, true, 0);
        if (!(abs(at.distance) * largest_component<Number, d>(at.normal) <=
              in_cells(Candidates::nearly_half_a_cell)))
            return;
        if (!move_to_surface(place, obstacle, at, shift)) return;
        auto const is_covered = [&] {
            bool has_same = false, is_inside_another = false, goes_on = true;
            for_each_other(place, i, [&](std::uint32_t j, auto const& other) {
                Is const is = in_other(place, shift, at.normal, other);
                has_same = has_same || (is == Is::on_same_face && j < i);
                if (is != Is::inside) return;
                is_inside_another = true;
                goes_on = goes_on && goes_on_beyond(place, shift, at.normal, obstacle, other);
            });
            return has_same ||
                   (is_inside_another && (is_at_edge(place, obstacle, at, shift) ||
                                          !(goes_on || is_beside_open(place, i, obstacle, at, shift))));
        };
        Vector<Number, d> inwards = zeros<Vector<Number, d>>();
        for (int face = 0; is_covered(); ++face)
            if (face == d || !look_beside(place, obstacle, inwards, at, shift) || !is_in_cube(shift)) return;
        uncover(place, i, obstacle, at, shift);
        add(place, number, obstacle, at, shift, false, 0);
        for_each_other(place, i, [&](std::uint32_t j, auto const& other) {
            go_on_behind(place, number, obstacle, at, shift, j, other);
        });
    }

    /// Moves a place from a node to the point of the surface nearest to it. Returns whether that lies in the
    /// cube of the node.
    template <class Obstacle>
    FIRN_HOST_DEVICE bool move_to_surface(LanePosition<Number, d> const& place, Obstacle const& obstacle,
                                          At& at, Vector<Number, d>& shift) const
    {
        for (int twice = 0; twice < 2; ++twice) { // distances may be estimates
            shift -= at.normal * at.distance;
            at = obstacle.template surface_at<Number>(place, shift);
        }
        return is_in_cube(shift);
    }
    FIRN_HOST_DEVICE bool is_in_cube(Vector<Number, d> const& shift) const
    {
        constexpr double rounding = 1.0001; // two cubes may have one point, and none may be missing
        return largest_component<Number, d>(shift) <= in_cells(0.5 * rounding);
    }

    /// Whether a surface has an edge between a point of it and the foot of the node in the point's plane.
    template <class Obstacle>
    FIRN_HOST_DEVICE bool is_at_edge(LanePosition<Number, d> const& place, Obstacle const& obstacle,
                                     At const& at, Vector<Number, d> const& shift) const
    {
        Vector<Number, d> const foot = at.normal * dot<Number, d>(at.normal, shift);
        return abs(obstacle.template surface_at<Number>(place, foot).distance) > in_cells(0.05);
    }
    /// Whether the node in whose cube a place lies has a point of the surface with this normal.
    template <class Obstacle>
    FIRN_HOST_DEVICE bool has_point(LanePosition<Number, d> const& place, Obstacle const& obstacle,
                                    Vector<Number, d> const& normal, Vector<Number, d> const& shift) const
    {
        LanePosition<Number, d> node = place;
        for (int a = 0; a < d; ++a)
            node.first[a] +=
                static_cast<int>(floor(shift[a] * static_cast<Number>(1 / lattice.cell_size) + Number(0.5)));
        Vector<Number, d> there = zeros<Vector<Number, d>>();
        At at = obstacle.template surface_at<Number>(node, there);
        return move_to_surface(node, obstacle, at, there) && dot<Number, d>(at.normal, normal) > Number(0.99);
    }

    /// A point stands for the surface in its cube. If it lies inside another obstacle that leaves a part of
    /// this, it moves to the middle of that: else it would push the light nodes behind a corner too much, so
    /// that those before it yield, and material creeps in between them.
    template <class Obstacle>
    FIRN_HOST_DEVICE void uncover(LanePosition<Number, d> const& place, std::uint32_t number,
                                  Obstacle const& obstacle, At& at, Vector<Number, d>& shift) const
    {
        Vector<Number, d> way = zeros<Vector<Number, d>>();
        for_each_other(place, number, [&](std::uint32_t, auto const& other) {
            way += way_out_of(place, at.normal, shift, other);
        });
        if (!(largest_component<Number, d>(way) > Number(0))) return;
        Vector<Number, d> moved = shift + way;
        At there = obstacle.template surface_at<Number>(place, moved);
        if (!(abs(there.distance) < in_cells(0.1)) ||
            !(dot<Number, d>(there.normal, at.normal) > Number(0.9)))
            return; // it ends before
        moved -= there.normal * there.distance;
        at = obstacle.template surface_at<Number>(place, moved);
        shift = moved;
    }
    /// The way from a point of a surface, which lies inside another obstacle, to the middle of what that
    /// leaves of the point's cube; 0 if it leaves nothing.
    template <class Other>
    FIRN_HOST_DEVICE Vector<Number, d> way_out_of(LanePosition<Number, d> const& place,
                                                  Vector<Number, d> const& normal,
                                                  Vector<Number, d> const& shift, Other const& other) const
    {
        // from above the surface, where a face that both share is far
        Number const above = in_cells(0.5);
        At const from = other.template surface_at<Number>(place, Vector<Number, d>(shift + normal * above));
        Number const along = dot<Number, d>(from.normal, normal);
        Vector<Number, d> way = from.normal - normal * along;
        Number const steepness2 = dot<Number, d>(way, way), steepness = sqrt(steepness2);
        if (!(steepness2 > Number(0.1))) return zeros<Vector<Number, d>>();
        way = way * (1 / steepness);
        return way * to_middle(way, (from.distance - above * along) / -steepness);
    }
    /// How far along this way [m] the middle is of what a corner leaves of a point's cube, if it is so far to
    /// the corner.
    FIRN_HOST_DEVICE Number to_middle(Vector<Number, d> const& way, Number to_corner) const
    {
        Number const half = in_cells(0.5) / largest_component<Number, d>(way);
        return to_corner > in_cells(0.05) && to_corner < half ? (half + to_corner) / 2 : Number(0);
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

    /// Where a surface ends at another obstacle, continues it behind the corner as if it went on: points
    /// there lie as far from one another as those before it. Without these the nodes behind the corner would
    /// be free, and material would creep out between points that lie farther apart.
    template <class Obstacle, class Other>
    FIRN_HOST_DEVICE void go_on_behind(LanePosition<Number, d> const& place, std::uint32_t candidate,
                                       Obstacle const& obstacle, At const& at, Vector<Number, d> const& shift,
                                       std::uint32_t j, Other const& other) const
    {
        ToCorner const to = to_corner(place, obstacle, at, shift, other);
        Vector<Number, d> const way = to.way;
        Number const distance = to.distance;
        if (!(distance >= Number(0))) return;
        Number const step = in_cells(1) / largest_component<Number, d>(way), least = in_cells(0.05);
        if (distance - step > -least &&
            has_point(place, obstacle, at.normal, Vector<Number, d>(shift + way * step)))
            return;            // which is nearer
        bool is_known = false; // the corner is that with an earlier obstacle
        for_each_other(
            place, found.candidates[candidate].obstacle, [&](std::uint32_t k, auto const& earlier) {
                if (is_known || k >= j) return;
                auto const same = to_corner(place, obstacle, at, shift, earlier);
                is_known = same.distance >= Number(0) && dot<Number, d>(same.way, way) > Number(0.99);
            });
        if (is_known) return;
        for (std::uint32_t k = 1; k <= 3; ++k) {
            Number const moved = step * static_cast<Number>(k);
            if (moved - distance > in_cells(place.kernel_reach)) return;
            Vector<Number, d> const along = way * moved, behind = shift + along;
            if (distance - moved > -least
                    ? has_point(place, obstacle, at.normal, behind)
                    : !(abs(obstacle.template surface_at<Number>(place, behind).distance) > least))
                continue; // it does go on
            Vector<Number, d> const back = way * to_middle(way, moved - distance);
            At there = at;
            there.arm += along - back;
            add(place, candidate, obstacle, there, Vector<Number, d>(behind - back), false, 3 * j + k);
        }
    }

    /// A way along a surface, and how far along it [m] it ends at another obstacle; negative if it does not.
    struct ToCorner
    {
        Vector<Number, d> way;
        Number distance;
    };
    template <class Obstacle, class Other>
    FIRN_HOST_DEVICE ToCorner to_corner(LanePosition<Number, d> const& place, Obstacle const& obstacle,
                                        At const& at, Vector<Number, d> const& shift,
                                        Other const& other) const
    {
        ToCorner to{zeros<Vector<Number, d>>(), Number(-1)};
        At const of_other = other.template surface_at<Number>(place, shift);
        Number const along = dot<Number, d>(of_other.normal, at.normal);
        Vector<Number, d> const way = at.normal * along - of_other.normal;
        Number const steepness2 = dot<Number, d>(way, way), reach = in_cells(place.kernel_reach),
                     distance = max(of_other.distance, Number(0)), near = in_cells(0.3);
        // nearly in one plane it is no corner, but it may be as sharp as a wedge
        if (!(steepness2 > (along > Number(0) ? Number(0.1) : Number(0.005))) ||
            !(distance * distance < reach * reach * steepness2))
            return to;
        Number const steepness = sqrt(steepness2);
        to.way = way * (1 / steepness);
        Vector<Number, d> const corner = shift + to.way * (distance / steepness),
                                up = (at.normal - of_other.normal * along) * (1 / steepness),
                                in_other = corner + up * near - of_other.normal * in_cells(0.1);
        // the other rises there, as a tile beside another one does not
        if (abs(obstacle.template surface_at<Number>(place, corner).distance) < near &&
            other.template surface_at<Number>(place, in_other).distance < in_cells(-0.05))
            to.distance = distance / steepness;
        return to;
    }

    /// Whether a point of an obstacle's surface, which lies inside others, has a part of it beside that does
    /// not: nodes there need it as if there were no others, wherever they have seams.
    template <class Obstacle>
    FIRN_HOST_DEVICE bool is_beside_open(LanePosition<Number, d> const& place, std::uint32_t i,
                                         Obstacle const& obstacle, At const& at,
                                         Vector<Number, d> const& shift) const
    {
        constexpr int ways = d == 2 ? 2 : 8, distances = 2;
        for (int n = 0; n < ways * distances; ++n) {
            Number const distance = in_cells(0.5 * place.kernel_reach) * Number(1 + n / ways);
            Vector<Number, d> beside = shift + tangent(at.normal, n % ways) * distance;
            At const there = obstacle.template surface_at<Number>(place, beside);
            if (!(abs(there.distance) < in_cells(0.25)) ||
                !(dot<Number, d>(there.normal, at.normal) > Number(0.9)))
                continue;
            beside -= there.normal * there.distance;
            bool is_open = true;
            for_each_other(place, i, [&](std::uint32_t j, auto const& other) {
                if (!is_open) return;
                Is const is = in_other(place, beside, there.normal, other);
                is_open = is == Is::outside || (is == Is::on_same_face && j > i);
            });
            if (is_open) return true;
        }
        return false;
    }
    /// A direction across a normal: of two in the plane, and of eight in space.
    FIRN_HOST_DEVICE static Vector<Number, d> tangent(Vector<Number, d> const& normal, int way)
    {
        Vector<Number, d> along = zeros<Vector<Number, d>>();
        Number const sign = way % 2 == 0 ? Number(1) : Number(-1);
        if constexpr (d == 2) {
            along[0] = -normal[1] * sign, along[1] = normal[0] * sign;
            return along;
        }
        else {
            int axis = 0; // the one most across
            for (int a = 1; a < d; ++a) axis = abs(normal[a]) < abs(normal[axis]) ? a : axis;
            along[axis] = 1;
            along -= normal * normal[axis];
            along = along * (1 / sqrt(dot<Number, d>(along, along)));
            Vector<Number, d> across = zeros<Vector<Number, d>>();
            for (int a = 0; a < 3; ++a)
                across[a] =
                    normal[(a + 1) % 3] * along[(a + 2) % 3] - normal[(a + 2) % 3] * along[(a + 1) % 3];
            constexpr auto diagonal = static_cast<Number>(0.70710678118654752);
            Number const of_along = way < 2   ? Number(1)
                                    : way < 4 ? Number(0)
                                              : diagonal,
                         of_across = way < 2   ? Number(0)
                                     : way < 4 ? Number(1)
                                     : way < 6 ? diagonal
                                               : -diagonal;
            return (along * of_along + across * of_across) * sign;
        }
    }

    /// Where a point of an obstacle's surface, with this normal, is to another one.
    enum class Is
    {
        outside,
        on_same_face,
        inside
    };
    template <class Other>
    FIRN_HOST_DEVICE Is in_other(LanePosition<Number, d> const& place, Vector<Number, d> const& shift,
                                 Vector<Number, d> const& normal, Other const& other) const
    {
        Number const least = in_cells(0.01), little = in_cells(0.05);
        if (!(other.template surface_at<Number>(place, shift).distance < least)) return Is::outside;
        At const above = other.template surface_at<Number>(place, Vector<Number, d>(shift + normal * little));
        if (!(above.distance > little - least)) return Is::inside;
        return dot<Number, d>(above.normal, normal) > Number(0.99) ? Is::on_same_face : Is::outside;
    }

    /// Whether a surface goes on beyond another obstacle in which a point of it lies: half a cell behind the
    /// way along the surface out of the other, as seen from above the surface, where a face that both share
    /// is far.
    template <class Obstacle, class Other>
    FIRN_HOST_DEVICE bool goes_on_beyond(LanePosition<Number, d> const& place, Vector<Number, d> const& shift,
                                         Vector<Number, d> const& normal, Obstacle const& obstacle,
                                         Other const& other) const
    {
        Number const reach = in_cells(place.kernel_reach);
        At const above = other.template surface_at<Number>(place, Vector<Number, d>(shift + normal * reach));
        Vector<Number, d> const way = above.normal - normal * dot<Number, d>(above.normal, normal);
        Number const steepness2 = dot<Number, d>(way, way);
        if (!(steepness2 > Number(0.1)) || !(above.distance > Number(-1.5) * reach)) return false;
        Number const steepness = sqrt(steepness2);
        Vector<Number, d> const beyond =
            shift + way * ((in_cells(0.5) - min(above.distance, Number(0)) / steepness) / steepness);
        return abs(obstacle.template surface_at<Number>(place, beyond).distance) < in_cells(0.25);
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
        point.per_light = 1; // until it begins: it is to be listed
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
