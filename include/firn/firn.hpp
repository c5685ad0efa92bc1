// SPDX-License-Identifier: MIT
#pragma once

/// All of the core: solver, materials, kernels, transfers, effects. Pulls in no backend, no CGAL and no
/// assimp.
#include <firn/effects/gravity.hpp>
#include <firn/effects/obstacle.hpp>
#include <firn/effects/reflecting_wall.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/effects/shapes/half_space.hpp>
#include <firn/effects/shapes/height_field.hpp>
#include <firn/effects/shapes/inside.hpp>
#include <firn/effects/shapes/shell.hpp>
#include <firn/effects/shapes/signed_distance_grid.hpp>
#include <firn/effects/shapes/solids.hpp>
#include <firn/interpolation/cubic_b_spline.hpp>
#include <firn/interpolation/linear.hpp>
#include <firn/interpolation/quadratic_b_spline.hpp>
#include <firn/models/heterogeneous.hpp>
#include <firn/models/materials.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/recommended.hpp>
#include <firn/solver.hpp>
#include <firn/transfer/apic.hpp>
#include <firn/transfer/asflip.hpp>
#include <firn/transfer/flip.hpp>
#include <firn/transfer/mls.hpp>
#include <firn/transfer/pic.hpp>
#include <firn/transfer/tpic.hpp>
#include <firn/transfer/xpic.hpp>
#include <firn/version.hpp>
