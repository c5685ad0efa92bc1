// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/effects/surface_points.hpp>
#include <firn/phases/find_candidates.hpp>
#include <firn/phases/step_context.hpp>

#include <cstdint>

namespace firn
{

/// What keeps a particle that is moved, as one of a fluid that keeps its volume, out of solids that act at
/// their surface alone.
///
/// A shift begins outside of solids, and ends where it would lead into one: from there it goes on along the
/// face, a little in front of it. So none leads through an edge that two boards have in common which move
/// alike: beside a solid a particle is taken to move with it in the step.
///
/// Where material flows along a surface and leaves it, as below a jet that a wall turns, velocities grow with
/// the distance from the surface, on both sides of it: what is a little inside is driven deeper. So what lies
/// in a solid by less than half a cell is first moved out of it, by the nearest way, or at an edge through
/// the face on the side of the material. A face that lies inside another solid is no surface. What finds no
/// way, or lies deeper, where the nearest face may be that at the solid's back, is not moved. So no shift
/// leads deeper into a solid.
template <class Number, int d, class Effects>
struct KeepOutOfSolids
{
    StepContext<Number, Effects> const* now;

    /// Whether lanes may be in a solid at the end of their ways [m].
    template <Lane Real>
    FIRN_HOST_DEVICE Mask<Real> are_near(LanePosition<Real, d> const& place,
                                         Vector<Real, d> const& ways) const
    {
        Real const cell(static_cast<Number>(place.lattice.cell_size));
        Mask<Real> near = Real(1) < Real(0);
        for_each_solid_at_surface(now->actions, place, cell, [&](std::uint32_t, auto const& solid) {
            if (!solid.on_particles)
                near =
                    near | (solid.template surface_at<Real>(place, ways).distance < cell * Real(moves_less));
        });
        return near;
    }

    /// `shift` [m] as it is to be, from a place at the beginning of the step: no component of it is larger
    /// than `bound`. Most material lies in about the direction `inwards`, of any length.
    FIRN_HOST_DEVICE Vector<Number, d> operator()(LanePosition<Number, d> const& place,
                                                  Vector<Number, d> const& shift,
                                                  Vector<Number, d> const& inwards, Number bound) const
    {
        Vector<Number, d> const stays = zeros<Vector<Number, d>>();
        Vector<Number, d> out = stays;
        if (!lead_out(place, inwards, out)) return stays;
        for (bool const in_parts : {false, true}) { // the nearest way may take several corrections
            Vector<Number, d> way = in_parts ? out : go_along_faces(place, out, shift);
            if (in_parts || lead_out(place, inwards, way)) {
                Number const most = largest_component<Number, d>(way);
                if (!(most > bound)) return way;
                way *= bound / most;
                if (!leads_deeper(place, way, in_parts)) return way;
            }
        }
        return stays;
    }

private:
    using At = SurfaceAt<Number, d>;
    /// In cells; a solid's surface moves by less than `moves_less` in a step, what lies inside by less than
    /// `rounding` is at its surface, and what lies less than `at_edge` below two faces is at their edge.
    static constexpr Number deepest = Number(0.5), little = Number(0.02), moves_less = Number(0.5),
                            rounding = Number(5e-4), at_edge = Number(0.2);

    template <class Use>
    FIRN_HOST_DEVICE void for_each_solid(LanePosition<Number, d> const& place, Use const& use) const
    {
        for_each_solid_at_surface(now->actions, place, static_cast<Number>(place.lattice.cell_size), use);
    }

    /// Where a way ends, as it is relative to a solid: that goes on in the step, and the particle with it.
    struct End
    {
        Vector<Number, d> way;
        At at;
    };
    template <class Solid>
    FIRN_HOST_DEVICE End end_of(LanePosition<Number, d> const& place, Solid const& solid,
                                Vector<Number, d> const& way) const
    {
        End end{way, solid.template surface_at<Number>(place, way)};
        if (!(end.at.distance < in_metres(place, moves_less))) return end;
        end.way += solid.template velocity_at<Number>(end.at.arm) * now->dt;
        end.at = solid.template surface_at<Number>(place, end.way);
        return end;
    }
    /// Whether it is in the solid, or between this one and another at the same face.
    FIRN_HOST_DEVICE bool is_inside(LanePosition<Number, d> const& place, std::uint32_t solid,
                                    End const& end) const
    {
        Number const least = in_metres(place, rounding);
        return end.at.distance < -least ||
               (end.at.distance < least && !is_free(place, end.way, end.at.normal, solid));
    }

    /// A way that ends in no solid, and behind it a shift that goes along the faces to which it leads.
    ///
    /// A convex solid lies behind the plane that touches it where it is nearest. So the shift is free up to
    /// the first of these planes. There it either is at a solid, or finds the planes anew: that of a board
    /// goes on beyond its end. Of other shapes the plane is an estimate, and the end is to be looked at.
    FIRN_HOST_DEVICE Vector<Number, d> go_along_faces(LanePosition<Number, d> const& place,
                                                      Vector<Number, d> way, Vector<Number, d> shift) const
    {
        constexpr int planes = 6;
        Number const beside = in_metres(place, little), least = in_metres(place, rounding);
        for (int plane = 0; plane < planes; ++plane) {
            Number share(1);
            for_each_solid(place, [&](std::uint32_t, auto const& solid) {
                if (solid.on_particles) return;
                At const at = end_of(place, solid, way).at;
                Number const before = max(at.distance - beside, Number(0)),
                             closer = -dot<Number, d>(at.normal, shift);
                if (closer > at.distance - beside)
                    share = min(share, closer > before ? before / closer : Number(0));
            });
            way += shift * share;
            if (!(share < Number(1))) return way;
            shift *= 1 - share;
            for_each_solid(place, [&](std::uint32_t, auto const& solid) {
                if (solid.on_particles) return;
                At const at = end_of(place, solid, way).at;
                Number const missing = beside - at.distance - dot<Number, d>(at.normal, shift);
                if (at.distance < beside + least && missing > Number(0)) shift += at.normal * missing;
            });
        }
        return way;
    }

    /// Lengthens a way until it ends in no solid. Returns whether it does.
    FIRN_HOST_DEVICE bool lead_out(LanePosition<Number, d> const& place, Vector<Number, d> const& inwards,
                                   Vector<Number, d>& way) const
    {
        // in a corner one solid moves particles into the other, and distances may be estimates
        constexpr int passes = 5;
        for (int pass = 0; pass < passes; ++pass) {
            bool ends_inside = false, moves = false;
            for_each_solid(place, [&](std::uint32_t number, auto const& solid) {
                if (solid.on_particles) return;
                End const end = end_of(place, solid, way);
                if (!is_inside(place, number, end)) return;
                ends_inside = true;
                if (push_out(place, number, solid, end, inwards, way)) moves = true;
            });
            if (!moves) return !ends_inside;
        }
        return false;
    }

    /// Whether a way ends in a solid; `in_parts`, whether it is deeper there than where it began.
    FIRN_HOST_DEVICE bool leads_deeper(LanePosition<Number, d> const& place, Vector<Number, d> const& way,
                                       bool in_parts) const
    {
        bool is_deeper = false;
        for_each_solid(place, [&](std::uint32_t number, auto const& solid) {
            if (is_deeper || solid.on_particles) return;
            End const end = end_of(place, solid, way);
            if (!is_inside(place, number, end)) return;
            At const from = end_of(place, solid, zeros<Vector<Number, d>>()).at;
            is_deeper = !in_parts || end.at.distance < from.distance - in_metres(place, rounding);
        });
        return is_deeper;
    }

    /// Lengthens the way to the face through which it leads into a solid. Returns whether it did.
    template <class Solid>
    FIRN_HOST_DEVICE bool push_out(LanePosition<Number, d> const& place, std::uint32_t number,
                                   Solid const& solid, End const& ending, Vector<Number, d> const& inwards,
                                   Vector<Number, d>& way) const
    {
        auto const& [end, at] = ending;
        if (!(at.distance > -in_metres(place, deepest))) return false;
        Vector<Number, d> const nearest = at.normal * -at.distance;
        bool const is_open = is_free(place, Vector<Number, d>(end + nearest), at.normal, number);
        // beside an edge it may have come through either face
        if (is_open && !(dot<Number, d>(at.normal, inwards) < Number(0))) {
            way += nearest;
            return true;
        }
        // as the end of a tile at the next one: then the nearest face behind it
        Vector<Number, d> found = out_of(place, solid, end, Vector<Number, d>(at.normal * Number(-1)));
        Number const length = dot<Number, d>(found, found), near = in_metres(place, at_edge);
        bool has_found =
            length > Number(0) && is_free(place, Vector<Number, d>(end + found), direction(found));
        if (is_open) {
            bool const is_edge =
                has_found && length < near * near && dot<Number, d>(found, inwards) > Number(0);
            way += is_edge ? found : nearest;
            return true;
        }
        // or as a floor below the edge of a wall: out of that, too
        Vector<Number, d> const foot = end + nearest, above = foot + at.normal * in_metres(place, little);
        for_each_solid(place, [&](std::uint32_t, auto const& other) {
            if (has_found || !is_in(place, other, above)) return;
            Vector<Number, d> const beside = out_of(place, other, foot, at.normal);
            if (!(dot<Number, d>(beside, beside) > Number(0))) return;
            has_found = is_free(place, Vector<Number, d>(foot + beside),
                                Vector<Number, d>(at.normal + direction(beside)));
            found = nearest + beside;
        });
        if (has_found) way += found;
        return has_found;
    }

    /// The way from a place to the face of a solid that is nearest half a cell away in this direction; 0 if
    /// it is that across the direction, or far.
    template <class Solid>
    FIRN_HOST_DEVICE Vector<Number, d> out_of(LanePosition<Number, d> const& place, Solid const& solid,
                                              Vector<Number, d> const& way,
                                              Vector<Number, d> const& towards) const
    {
        Number const far = in_metres(place, deepest);
        At const there = solid.template surface_at<Number>(place, Vector<Number, d>(way + towards * far));
        Number const turned = dot<Number, d>(there.normal, towards), depth = turned * far - there.distance;
        bool const counts = abs(turned) < Number(0.9) && depth > Number(0) && depth < far;
        return there.normal * (counts ? depth : Number(0));
    }
    FIRN_HOST_DEVICE static Vector<Number, d> direction(Vector<Number, d> const& way)
    {
        return way * (1 / sqrt(dot<Number, d>(way, way)));
    }

    template <class Solid>
    FIRN_HOST_DEVICE static bool is_in(LanePosition<Number, d> const& place, Solid const& solid,
                                       Vector<Number, d> const& way)
    {
        return solid.template surface_at<Number>(place, way).distance < -in_metres(place, rounding);
    }
    static constexpr std::uint32_t none = ~std::uint32_t(0);
    /// Whether the place behind a way, and a little in this direction, lies in no solid but perhaps this one.
    FIRN_HOST_DEVICE bool is_free(LanePosition<Number, d> const& place, Vector<Number, d> const& way,
                                  Vector<Number, d> const& towards, std::uint32_t but = none) const
    {
        Vector<Number, d> const there = way + towards * in_metres(place, little);
        bool is = true;
        for_each_solid(place, [&](std::uint32_t number, auto const& solid) {
            is = is && (number == but || !is_in(place, solid, there));
        });
        return is;
    }
    FIRN_HOST_DEVICE static Number in_metres(LanePosition<Number, d> const& place, Number cells)
    {
        return cells * static_cast<Number>(place.lattice.cell_size);
    }
};

} // namespace firn
