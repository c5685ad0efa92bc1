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

/// Whether a material in single precision and space adds what its State declares to position and id, has one
/// buffer of all that beside the one in use, and nothing else.
template <class Model>
constexpr bool keeps_what_it_declares()
{
    using Here = Scene<Model, QuadraticBSpline, Mls>;
    using Lively = Scene<Model, CubicBSpline, Flip>; // with a velocity of its own
    std::size_t const bytes = 4 * (3 + 1 + std::size_t(Model::State::components(3)));
    return state<Here> == bytes && resident<Here> == 2 * bytes + order_of_cells &&
           state<Lively> == bytes + 12 && resident<Lively> == 2 * (bytes + 12) + order_of_cells;
}
template <class... Models>
constexpr bool keep_what_they_declare(std::tuple<Models...> const*)
{
    return (keeps_what_it_declares<Models>() && ...);
}
static_assert(keep_what_they_declare(static_cast<firn::AllModels<SolidFloat>*>(nullptr)));
static_assert(keeps_what_it_declares<Heterogeneous<Snow<SolidFloat>>>());

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
