// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/node_halo.hpp>
#include <firn/phases/coarse_nodes.hpp>

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace firn
{

/// What ranks divide of the first coarse grid: each sums up over the fine nodes that its own coarse nodes
/// reach. All of them then know all sums, and have the coarser grids each for itself.
template <class Number, int d>
struct CoarseOverRanks
{
    NodeHalo<Number, d> halo;
    std::vector<std::uint32_t> near;  ///< the coarse nodes that may reach nodes here, by number
    std::vector<std::uint32_t> own;   ///< which of these are this rank's, by their places
    std::vector<std::uint32_t> order; ///< the numbers of those of all ranks, one rank's behind the other's

    /// Finds the coarse nodes that matter here.
    template <class Backend, class Grid, class Orders>
    void find(Backend const& backend, Grid& grid, Orders const& orders,
              std::vector<CoarseNode<d>> const& coarse)
    {
        auto const nodes = halo.nodes(grid);
        near.clear();
        own.clear();
        std::vector<std::uint32_t> numbers;
        for (std::uint32_t number = 0; number < coarse.size(); ++number) {
            Coordinates<d> const at = coarse[number].at * int{coarsening};
            bool const is_own = grid.rank_of(orders, at) == backend.rank();
            if (!is_own && !may_reach(nodes, at)) continue;
            if (is_own) {
                own.push_back(static_cast<std::uint32_t>(near.size()));
                numbers.push_back(number);
            }
            near.push_back(number);
        }
        order = detail::of_all_ranks(backend, std::move(numbers));
    }

    /// Lets all ranks know what each found for its own coarse nodes: `of_near` are those near.
    template <class Backend, class T>
    void share(Backend const& backend, T const* of_near, T* of_all) const
    {
        std::vector<T> values;
        values.reserve(own.size());
        for (std::uint32_t const place : own) values.push_back(of_near[place]);
        values = detail::of_all_ranks(backend, std::move(values));
        for (std::size_t i = 0; i < order.size(); ++i) of_all[order[i]] = values[i];
    }

private:
    /// Whether there may be nodes of the grid among those that a coarse node reaches. Blocks of nodes are no
    /// smaller than the distance of those that are looked for.
    template <class Nodes>
    static bool may_reach(Nodes const& nodes, Coordinates<d> const& at)
    {
        for (int i = 0; i < CoarseNode<d>::beside_count; ++i) {
            Coordinates<d> node = at;
            for (int a = 0, rest = i; a < d; ++a, rest /= 3) node[a] += (rest % 3 - 1) * (coarsening - 1);
            if (nodes.find(node) != nodes.absent) return true;
        }
        return false;
    }
};

} // namespace firn
