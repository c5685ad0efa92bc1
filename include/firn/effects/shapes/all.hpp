// SPDX-License-Identifier: MIT
#pragma once

#include <firn/effects/shapes/deforming_grid.hpp>
#include <firn/effects/shapes/half_space.hpp>
#include <firn/effects/shapes/height_field.hpp>
#include <firn/effects/shapes/inside.hpp>
#include <firn/effects/shapes/shell.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>
#include <firn/effects/shapes/solids.hpp>

#include <tuple>

namespace firn
{

/// The list of the shapes that are plain values, for code that is to cover all of them. A Shell makes a
/// two-sided shape of any of them; a HeightField and a SignedDistanceGrid hold samples. AnyShape is one of
/// these, and asks each in turn: a Cylinder, which few scenes have, would cost all others registers on a
/// device, so it is an own shape of AnyShape<Cylinder>.
using AllPlainShapes = std::tuple<HalfSpace, Sphere, Capsule, Box>;

} // namespace firn
