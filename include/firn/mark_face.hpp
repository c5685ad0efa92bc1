// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/effects/shapes/inside.hpp>
#include <firn/math/product.hpp>
#include <firn/transfer/loaded_surfaces.hpp>

#include <cstddef>
#include <vector>

namespace firn
{

/// Marks the particles in a region as those of a plane face of a body, for a Traction to load: they share its
/// area, each by its mass. `area` is the face's area times its outward unit normal [m^2, in the plane m].
/// Marks add up, so a particle at an edge may belong to two faces. Returns how many particles the region has.
///
///     firn::mark_face(solver, firn::Inside<firn::Box>{{{0.5, 0.01, 0.5}}, {.position = {0, 1, 0}}}, {0, 1,
///     0});
///
/// Let the region have the outermost layer of particles alone: the load enters between it and the face. In a
/// scene of several materials `mark_face<Snow>` is about one of them. Throws an Error, and marks nothing, if
/// there is no particle in the region or the area makes no sense.
template <class... Which, class Solver, class ShapeType>
std::size_t mark_face(Solver& solver, Inside<ShapeType> const& region, Vector<double, Solver::d> const& area)
{
    constexpr int d = Solver::d;
    using Number = typename Solver::Number;
    region.validate();
    if constexpr (d == 2) region.validate_in_plane();
    require(all_finite(area) && norm(area) > 0, "the area of a face is not finite, or 0", "mark_face",
            "Pass the area times the outward normal in m^2, in the plane in m.");
    auto const inside = region.with_images(solver.lattice(), d);
    auto const positions = solver.template positions<Which...>();
    auto const masses = solver.template masses<Which...>();
    std::vector<std::size_t> found;
    double mass = 0;
    for (std::size_t i = 0; i < positions.size(); ++i)
        if (inside(positions[i])) {
            found.push_back(i);
            mass += masses[i];
        }
    require(!found.empty(), "no particle lies in the region of the face", "mark_face",
            "Let the region hold the outermost layer of particles, half a spacing below the face.");
    auto marks = solver.template download<AreaPerMass, Which...>();
    for (std::size_t const i : found)
        for (int a = 0; a < d; ++a) marks[i][a] += static_cast<Number>(area[a] / mass);
    solver.template upload<AreaPerMass, Which...>(marks);
    return found.size();
}

} // namespace firn
