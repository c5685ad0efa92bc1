// SPDX-License-Identifier: MIT
#pragma once

#include "catch.hpp"
#include "support/policies.hpp"

// Model only what a scene needs: a particle stores position, id, and what its transfer and its model declare.
// For the backend that this is compiled for.
namespace firn::test
{

template <class SceneType>
constexpr std::size_t state = SceneType::Solver::state_bytes_per_particle;
template <class SceneType>
constexpr std::size_t resident = SceneType::Solver::bytes_per_particle;

/// The order of cells: two indices of a particle, or one and a byte on a device.
constexpr std::size_t order_of_cells = TestedBackend::reaches_host_memory ? 8 : 5;

/// Whether a material in single precision and space adds so many numbers to position and id, has one buffer
/// of all that beside the one in use, and nothing else.
template <template <class> class Model>
constexpr bool keeps(std::size_t numbers)
{
    using Here = Scene<Model<SolidFloat>, QuadraticBSpline, Mls>;
    using Lively = Scene<Model<SolidFloat>, CubicBSpline, Flip>; // with a velocity of its own
    std::size_t const bytes = 4 * (3 + 1 + numbers);
    return state<Here> == bytes && resident<Here> == 2 * bytes + order_of_cells &&
           state<Lively> == bytes + 12 && resident<Lively> == 2 * (bytes + 12) + order_of_cells;
}

template <class Space>
using HeterogeneousSnow = Heterogeneous<Snow<Space>>;

static_assert(keeps<NeoHookean>(9));
static_assert(keeps<FixedCorotated>(9));
static_assert(keeps<Hencky>(9));
static_assert(keeps<SplitNeoHookean>(9));
static_assert(keeps<Snow>(9 + 1));
static_assert(keeps<VonMises>(9));
static_assert(keeps<HardeningVonMises>(9 + 1));
static_assert(keeps<Sand>(9 + 1));
static_assert(keeps<CamClay>(9 + 1));
static_assert(keeps<HerschelBulkley>(9));
static_assert(keeps<Fluid>(1)); // no deformation gradient
static_assert(keeps<HeterogeneousSnow>(9 + 1 + 1));

// what the guide to materials says
static_assert(resident<Scene<NeoHookean<SolidFloat>, QuadraticBSpline, Mls>> ==
              (TestedBackend::reaches_host_memory ? 112 : 109));
static_assert(resident<Scene<Snow<SolidFloat>, QuadraticBSpline, Mls>> ==
              (TestedBackend::reaches_host_memory ? 120 : 117));
static_assert(resident<Scene<Snow<SolidFloat>, CubicBSpline, Flip>> ==
              (TestedBackend::reaches_host_memory ? 144 : 141));
static_assert(resident<Scene<Fluid<SolidFloat>, QuadraticBSpline, Mls>> ==
              (TestedBackend::reaches_host_memory ? 48 : 45));

} // namespace firn::test
