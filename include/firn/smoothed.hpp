// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/components.hpp>
#include <firn/core/error.hpp>
#include <firn/core/finite.hpp>
#include <firn/core/host_device.hpp>
#include <firn/core/space.hpp>
#include <firn/models/several_materials.hpp>
#include <firn/particles/host_nodes.hpp>

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <string>
#include <type_traits>
#include <unordered_map>
#include <utility>
#include <vector>

// What particles carry, read through the grid. Nodes see the force of all particles around them. Stresses of
// alternate sign, such as those of two particles in a cell along an axis, exert none: nothing drives them
// out, and the stress of a single particle is as wrong as they are large. From the weights w_ip of the kernel
// and the volumes V_p:
//
//   q_i = sum_p w_ip V_p q_p / sum_p w_ip V_p,   smoothed q_p = sum_i w_ip q_i
namespace firn
{

namespace detail
{
/// A number, or a vector or a matrix of Eigen's of a size that is known when it is compiled.
template <class Value>
concept SmoothedValue = std::floating_point<Value> ||
    (std::floating_point<typename Value::Scalar>&& int(Value::SizeAtCompileTime) > 0);

template <SmoothedValue Value>
constexpr int components_in()
{
    if constexpr (std::floating_point<Value>)
        return 1;
    else
        return Value::SizeAtCompileTime;
}

/// The component i of a value, const or not.
template <class Value>
auto& component_at(Value& value, int i)
{
    if constexpr (std::floating_point<std::remove_const_t<Value>>)
        return value;
    else
        return value.data()[i];
}

/// Places and volumes of particles.
template <int d>
struct PlacesAndVolumes
{
    std::vector<Vector<double, d>> places; ///< [m]
    std::vector<double> volumes;           ///< [m^3]
};

/// Those of the particles that a call is about, by rising id.
template <class Which, class Solver>
FIRN_COLD auto places_and_volumes(Solver const& solver)
{
    using List = typename MaterialsOf<typename Solver::Model>::Type;
    PlacesAndVolumes<Solver::d> all{solver.template positions<Which>(), {}};
    if constexpr (PlaceOf<Which, List>::value < Solver::materials)
        all.volumes = present_volumes<Which>(solver);
    else {
        auto const ids = solver.ids();
        all.volumes.resize(ids.size());
        auto const add = [&]<std::size_t k>(std::integral_constant<std::size_t, k>) {
            auto const own = solver.template ids<Material<k>>();
            auto const volumes = present_volumes<Material<k>>(solver);
            auto at = ids.begin();
            for (std::size_t i = 0; i < own.size(); ++i) {
                at = std::lower_bound(at, ids.end(), own[i]);
                all.volumes[static_cast<std::size_t>(at - ids.begin())] = volumes[i];
            }
        };
        [&]<std::size_t... k>(std::index_sequence<k...>)
        {
            (add(std::integral_constant<std::size_t, k>{}), ...);
        }
        (std::make_index_sequence<Solver::materials>{});
    }
    return all;
}
} // namespace detail

/// Values of particles, smoothed through the grid: the mean around each node by the solver's kernel and by
/// volume, interpolated at the particles. `values` has one for each particle by rising id, as
/// `download<Pressure>()` returns them: numbers, vectors or matrices, and so does the result, in their unit.
/// Constants stay as they are. Inside of the material so do linear fields where particles lie evenly; within
/// the kernel's reach of a surface the mean lies further inside than the particle.
///
/// With several materials `smoothed<Snow>(solver, values)` is about the particles of one, and sees no other;
/// without it values are of all of them, in one mean. Ends of a periodic lattice are no ends. The host
/// computes it, in double precision and with the same bits for any number of threads.
///
/// Throws an Error if there is not one value for each particle, one is not finite, or the scene has many
/// worlds.
template <class Which = EveryMaterial, class Solver, detail::SmoothedValue Value>
FIRN_COLD std::vector<Value> smoothed(Solver const& solver, std::vector<Value> const& values)
{
    constexpr int d = Solver::d, components = detail::components_in<Value>();
    require(solver.lattice().half_world == 0, "the scene has many worlds, which would be added up",
            "smoothed", "Smooth what worlds of scenes of their own carry.");
    auto const particles = detail::places_and_volumes<Which>(solver);
    if (values.size() != particles.places.size())
        throw Error{"there are " + std::to_string(values.size()) + " values, and " +
                        std::to_string(particles.places.size()) + " particles",
                    "smoothed", "Pass a value for each particle that the call is about, by rising id."};
    for (std::size_t p = 0; p < values.size(); ++p)
        for (int c = 0; c < components; ++c)
            if (!is_finite(detail::component_at(values[p], c)))
                throw Error{"the value is not finite", "smoothed, value " + std::to_string(p),
                            "Pass what download() returns, or numbers that are computed from it."};

    struct Sums
    {
        double volume = 0;
        std::array<double, std::size_t(components)> of{};
    };
    std::unordered_map<Coordinates<d>, Sums, detail::HashOfNode<d>> nodes;
    auto const for_each_node = [&](std::size_t p, auto const& use) {
        detail::for_each_node_around<typename Solver::kernel, d>(
            solver.lattice(), particles.places[p],
            [&](Coordinates<d> const& node, double weight, auto const&) { use(nodes[node], weight); });
    };
    for (std::size_t p = 0; p < values.size(); ++p)
        for_each_node(p, [&](Sums& sums, double weight) {
            double const volume = weight * particles.volumes[p];
            sums.volume += volume;
            for (int c = 0; c < components; ++c)
                sums.of[std::size_t(c)] += volume * double(detail::component_at(values[p], c));
        });
    std::vector<Value> smooth(values);
    for (std::size_t p = 0; p < values.size(); ++p) {
        std::array<double, std::size_t(components)> mean{};
        for_each_node(p, [&](Sums const& sums, double weight) {
            if (!(sums.volume > 0)) return; // no weight either
            for (std::size_t c = 0; c < mean.size(); ++c) mean[c] += weight * sums.of[c] / sums.volume;
        });
        for (int c = 0; c < components; ++c) {
            auto& to = detail::component_at(smooth[p], c);
            to = static_cast<std::remove_reference_t<decltype(to)>>(mean[std::size_t(c)]);
        }
    }
    return smooth;
}

} // namespace firn
