// SPDX-License-Identifier: MIT
#pragma once

/// All of the core: solver, materials, kernels, transfers, effects. Pulls in no backend, no CGAL and no
/// assimp.
#include <firn/effects/gravity.hpp>
#include <firn/effects/obstacle.hpp>
#include <firn/effects/reflecting_wall.hpp>
#include <firn/effects/rigid_body.hpp>
#include <firn/effects/shapes/all.hpp>
#include <firn/interpolation/all.hpp>
#include <firn/models/all.hpp>
#include <firn/models/bodies.hpp>
#include <firn/models/heterogeneous.hpp>
#include <firn/models/materials.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/recommended.hpp>
#include <firn/solver.hpp>
#include <firn/transfer/all.hpp>
#include <firn/version.hpp>
