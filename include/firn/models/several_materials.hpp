// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <tuple>
#include <type_traits>
#include <utility>

namespace firn
{

/// Several materials in one scene, on one grid: a table of particles for each, and no branch on the material
/// of a particle.
///
///   Solver<OpenMP, Materials<Snow<Space>, Sand<Space>>> solver(lattice, {fresh_snow, dry_sand});
///   solver.template add<Sand<Space>>(points, volume, velocity);
///
/// A call that concerns one of them names it by its type or, as a type may occur more than once, by its
/// place: `Material<0>`.
template <class First, class... Rest>
struct Materials
{
    using Space = typename First::Space;
    static_assert((std::is_same_v<typename Rest::Space, Space> && ...),
                  "the materials of one scene have one dimension and one precision");

    std::tuple<First, Rest...> of;

    Materials() = default;
    Materials(First first, Rest... rest) : of(std::move(first), std::move(rest)...) {}
    template <class... Given>
        requires(sizeof...(Given) > 1 && sizeof...(Given) != 1 + sizeof...(Rest))
    Materials(Given...)
    {
        static_assert(sizeof...(Given) == 1 + sizeof...(Rest),
                      "pass one set of parameters for each material");
    }
};

/// The material in this place of Materials, counted from 0.
template <std::size_t place>
struct Material
{};

/// All materials of a scene.
struct EveryMaterial
{};

namespace detail
{
/// One material, or several, as a list.
template <class Model>
struct MaterialsOf
{
    using Type = Materials<Model>;
};
template <class... Models>
struct MaterialsOf<Materials<Models...>>
{
    using Type = Materials<Models...>;
};

/// The place of a material in the list; for EveryMaterial the number of materials, or 0 if there is one.
template <class Which, class List>
struct PlaceOf;

template <class Which, template <class...> class List, class... Models>
struct PlaceOf<Which, List<Models...>>
{
    static constexpr std::size_t find()
    {
        static_assert((int(std::is_same_v<Which, Models>) + ...) == 1,
                      "the scene has no such material, or more than one: say Material<place>");
        std::size_t place = 0;
        bool found = false;
        ((found = found || std::is_same_v<Which, Models>, place += found ? 0 : 1), ...);
        return place;
    }
    static constexpr std::size_t value = find();
};

template <std::size_t place, template <class...> class List, class... Models>
struct PlaceOf<Material<place>, List<Models...>>
{
    static_assert(place < sizeof...(Models), "the scene has fewer materials");
    static constexpr std::size_t value = place;
};

template <template <class...> class List, class... Models>
struct PlaceOf<EveryMaterial, List<Models...>>
{
    static constexpr std::size_t value = sizeof...(Models) == 1 ? 0 : sizeof...(Models);
};
} // namespace detail

} // namespace firn
