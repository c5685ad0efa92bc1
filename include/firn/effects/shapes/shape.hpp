// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/space.hpp>

#include <concepts>

namespace firn
{

/// Where a point stands to a surface.
template <class Real, int d>
struct SurfaceSample
{
    Real distance;          ///< signed distance [m], negative inside
    Vector<Real, d> normal; ///< outward unit normal of the closest surface
};

/// A solid in its own frame: answers the signed distance and outward normal at a point [m].
template <class T, class Real, int d>
concept Shape = requires(T const shape, Vector<Real, d> const x)
{
    {
        shape.surface(x)
        } -> std::same_as<SurfaceSample<Real, d>>;
};

} // namespace firn
