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
/// Where material flows along a surface and leaves it, as below a jet that a wall turns, velocities grow with
/// the distance from the surface, on both sides of it: what is a little inside is driven deeper. So a shift
/// that ends in a solid by less than half a cell goes on until it is out of it. A face that lies inside
/// another solid is no surface. A shift that ends deeper is left as it is, since the nearest face may be that
/// at the solid's back.
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

    /// `way` [m] as it is to be, from a place at the beginning of the step.
    FIRN_HOST_DEVICE Vector<Number, d> operator()(LanePosition<Number, d> const& place,
                                                  Vector<Number, d> way) const
    {
        constexpr int passes = 4; // in a corner one solid moves particles into the other
        bool moves = true;
        for (int pass = 0; pass < passes && moves; ++pass) {
            moves = false;
            for_each_solid(place, [&](auto const& solid) {
                if (!solid.on_particles && push_out(place, solid, way)) moves = true;
            });
        }
        return way;
    }

private:
    using At = SurfaceAt<Number, d>;
    /// In cells; a solid's surface moves by less than `moves_less` in a step.
    static constexpr Number deepest = Number(0.5), little = Number(0.02), moves_less = Number(0.5);

    template <class Use>
    FIRN_HOST_DEVICE void for_each_solid(LanePosition<Number, d> const& place, Use const& use) const
    {
        for_each_solid_at_surface(now->actions, place, static_cast<Number>(place.lattice.cell_size),
                                  [&](std::uint32_t, auto const& solid) { use(solid); });
    }

    /// Lengthens the way to the face through which it leads into a solid. Returns whether it did.
    template <class Solid>
    FIRN_HOST_DEVICE bool push_out(LanePosition<Number, d> const& place, Solid const& solid,
                                   Vector<Number, d>& way) const
    {
        Number const cell = static_cast<Number>(place.lattice.cell_size);
        At at = solid.template surface_at<Number>(place, way);
        if (!(at.distance < moves_less * cell)) return false;
        // the solid goes on in the step, and the particle with it
        Vector<Number, d> const end = way + solid.template velocity_at<Number>(at.arm) * now->dt;
        at = solid.template surface_at<Number>(place, end);
        if (!(at.distance < Number(0)) || !(at.distance > -deepest * cell)) return false;
        Vector<Number, d> const nearest = at.normal * -at.distance;
        if (is_free(place, Vector<Number, d>(end + nearest), at.normal)) {
            way += nearest;
            return true;
        }
        // as the end of a tile at the next one: then the nearest face behind it
        Vector<Number, d> found = out_of(place, solid, end, Vector<Number, d>(at.normal * Number(-1)));
        bool has_found = dot<Number, d>(found, found) > Number(0) &&
                         is_free(place, Vector<Number, d>(end + found), direction(found));
        // or as a floor below the edge of a wall: out of that, too
        for_each_solid(place, [&](auto const& other) {
            Vector<Number, d> const foot = end + nearest;
            if (has_found || !is_in(place, other, Vector<Number, d>(foot + at.normal * (little * cell))))
                return;
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
        Number const far = deepest * static_cast<Number>(place.lattice.cell_size);
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
        return solid.template surface_at<Number>(place, way).distance < Number(0);
    }
    /// Whether the place behind a way, and a little in this direction, lies in no solid.
    FIRN_HOST_DEVICE bool is_free(LanePosition<Number, d> const& place, Vector<Number, d> const& way,
                                  Vector<Number, d> const& towards) const
    {
        Vector<Number, d> const there =
            way + towards * (little * static_cast<Number>(place.lattice.cell_size));
        bool is = true;
        for_each_solid(place, [&](auto const& solid) { is = is && !is_in(place, solid, there); });
        return is;
    }
};

} // namespace firn
