// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/exactly_equal.hpp>
#include <firn/core/host_device.hpp>
#include <firn/particles/observables.hpp>
#include <firn/particles/readback.hpp>
#include <firn/phases/gather_velocity_gradient.hpp>

#include <cstddef>
#include <vector>

// Computes the observed fields of a scene's particles. `Scene` is a SceneState.
namespace firn
{

namespace detail
{
/// The velocity gradients of a material's particles, stored in `memory`.
template <std::size_t k, class Scene, class Array>
FIRN_COLD GradientsByRow<typename Scene::Number> velocity_gradients(Scene const& scene, Array& memory)
{
    using Traits = typename Scene::Sets::template MaterialTraits<k>;
    using Number = typename Scene::Number;
    constexpr int d = Scene::d, components = d * d;
    auto const& table = scene.sets.template particles<k>();
    memory.resize(table.size() * components);
    if constexpr (Traits::State::template contains<AffineVelocity>) {
        scene.grid_state.template write<AffineVelocity, k>(scene.sets, memory.data(), components);
        return {memory.data(), components, 1};
    }
    else {
        // The grid has them from a step until particles change.
        bool const have_moved = table.ordered().id != table.current().id;
        if (!have_moved || exactly_equal(scene.grid_state.scattered_dt(), 0)) return {};
        FieldsById<Number, d, Fields<VelocityGradient>> to{.component = {}, .present = true};
        for (std::size_t c = 0; c < components; ++c) to.component[c] = memory.data() + c * table.size();
        using Grid = typename Scene::GridStateType::Grid;
        auto const layer = const_cast<Grid&>(scene.grid_state.grid()).layer(k); // only read
        scene.backend.for_each_cell(
            table.cells(), layer,
            GatherVelocityGradient<typename Scene::Space, typename Scene::Kernel, typename Scene::Transfer,
                                   typename Traits::Stored>{
                {}, scene.transfer, table.ordered(), to, static_cast<Number>(scene.lattice.cell_size)});
        return {memory.data(), 1, table.size()};
    }
}
} // namespace detail

/// Computes an observed field of a material's particles and writes it to memory that the backend's loops
/// reach; see Solver::write.
template <class Tag, std::size_t k, class Scene>
FIRN_COLD void write_observed(Scene const& scene, typename Scene::Number* to, std::size_t stride)
{
    using Number = typename Scene::Number;
    using Traits = typename Scene::Sets::template MaterialTraits<k>;
    using Model = typename Traits::Model;
    auto const& table = scene.sets.template particles<k>();
    typename Scene::Backend::template Array<Number> memory(scene.backend);
    GradientsByRow<Number> gradients;
    if constexpr (Tag::template uses_velocity_gradient<Model>)
        gradients = detail::velocity_gradients<k>(scene, memory);
    scene.backend.for_each(table.places(),
                           ObserveField<Tag, typename Scene::Space, Model, typename Traits::Stored>{
                               scene.sets.template model<k>(), table.current(), gradients, to, stride});
}

/// An observed field of a material's particles, by row.
template <class Tag, std::size_t k, class Scene>
FIRN_COLD auto download_observed(Scene const& scene, detail::Rows wanted)
{
    using Number = typename Scene::Number;
    constexpr int d = Scene::d;
    constexpr std::size_t components = component_count<Tag>(d);
    std::size_t const count = scene.sets.template particles<k>().size();
    std::vector<FieldValue<Tag, Number, d>> by_row(count, value_at_rest<Tag, Number, d>());
    if (count == 0) return by_row;
    typename Scene::Backend::template Array<Number> there(scene.backend);
    there.resize(count * components);
    write_observed<Tag, k>(scene, there.data(), components);
    std::vector<Number> here(there.size());
    there.download(0, here);
    for (std::size_t row = 0; row < count; ++row)
        for_each_component<Tag, d>(
            by_row[row], [&](int c, Number& value) { value = here[row * components + std::size_t(c)]; });
    auto const& table = scene.sets.template particles<k>();
    detail::share_rows(scene.backend, detail::rows_of(table), by_row, wanted);
    return by_row;
}

} // namespace firn
