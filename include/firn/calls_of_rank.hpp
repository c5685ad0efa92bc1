// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/fields.hpp>
#include <firn/core/space.hpp>
#include <firn/particles/readback.hpp>

#include <cstdint>
#include <vector>

namespace firn
{
struct EveryMaterial;
}

namespace firn::detail
{

/// What a Solver returns of the particles that lie on this rank, by rising id, without the values of the
/// others: each rank writes its part of a frame by them. All ranks make such a call, as any other. Where a
/// backend does not span ranks, all particles lie here.
template <class Solver>
class CallsOfRank
{
public:
    /// The permanent ids.
    template <class Which = EveryMaterial>
    std::vector<std::uint32_t> ids_here() const
    {
        return by_id_here<Which, std::uint32_t>(
            [](auto const& scene, auto k) { return scene.sets.template particles<k>().ids(); });
    }

    /// World positions [m].
    template <class Which = EveryMaterial>
    auto positions_here() const
    {
        return by_id_here<Which, Vector<double, Solver::d>>(
            [](auto const& scene, auto k) { return scene.template positions<k>(Rows::here); });
    }

    /// The values of a field: see Solver::download.
    template <class Tag, class Which = EveryMaterial>
    auto download_here() const
    {
        return by_id_here<Which, FieldValue<Tag, typename Solver::Number, Solver::d>>(
            [](auto const& scene, auto k) { return scene.template download<Tag, k>(Rows::here); });
    }

    /// A stored field in the backend's memory, see Solver::view. Rows are those of all particles: the one at
    /// place i has the id `ids()[row[i]]`, of the material.
    template <class Tag, class Which = EveryMaterial>
    auto view_here() const
    {
        auto const& solver = static_cast<Solver const&>(*this);
        using Traits = typename Solver::template MaterialTraits<Which>;
        static_assert(Traits::Stored::template contains<Tag>,
                      "this field is not stored: ask download_here() for it");
        auto const access = solver.guard_.read("Solver::view_here");
        return detail::view_here<Tag>(solver.scene_.sets.template particles<Traits::place>());
    }

private:
    template <class Which, class Value, class Ask>
    std::vector<Value> by_id_here(Ask const& ask) const
    {
        auto const& solver = static_cast<Solver const&>(*this);
        auto const access = solver.guard_.read("Solver::download_here");
        auto const& scene = solver.scene_;
        return scene.sets.template by_id_here<Solver::template place_of<Which>, Value>(
            [&](auto k) { return ask(scene, k); });
    }
};

} // namespace firn::detail
