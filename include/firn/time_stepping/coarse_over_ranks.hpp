// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/all_ranks.hpp>
#include <firn/core/host_device.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/phases/coarse_nodes.hpp>

#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <utility>
#include <vector>

namespace firn
{

/// Finds which coarse nodes may reach nodes of a grid. Blocks of nodes are no smaller than the distance of
/// those that are looked for.
template <class Nodes, int d>
struct FindCoarseNearby
{
    Nodes nodes;
    Coordinates<d> const* at; ///< of each coarse node, on the grid
    std::uint32_t* may_reach; ///< 1 or 0

    FIRN_HOST_DEVICE void operator()(std::size_t number) const
    {
        may_reach[number] = 0;
        for (int i = 0; i < CoarseNode<d>::beside_count; ++i) {
            Coordinates<d> node = at[number];
            for (int a = 0, rest = i; a < d; ++a, rest /= 3) node[a] += (rest % 3 - 1) * (coarsening - 1);
            if (nodes.find(node) != Nodes::absent) may_reach[number] = 1;
        }
    }
};

namespace detail
{
/// Where a backend has all nodes: there are none of other ranks.
struct NoHalo
{
    explicit NoHalo(auto const& /*backend*/) {}
    static constexpr std::size_t size() { return 0; }
};
template <class Backend, class Number, int d>
struct HaloOf
{
    using Type = NoHalo;
};
template <class Backend, class Number, int d>
    requires spans_ranks<Backend>
struct HaloOf<Backend, Number, d>
{
    using Type = typename Backend::template Halo<Number, d>;
};
} // namespace detail

/// What ranks divide of the first coarse grid: each sums up over the fine nodes that its own coarse nodes
/// reach. All of them then know all sums, and have the coarser grids each for itself.
template <class Backend, class Number, int d>
struct CoarseOverRanks
{
    template <class T>
    using Array = typename Backend::template Array<T>;

    typename detail::HaloOf<Backend, Number, d>::Type halo;
    std::vector<std::uint32_t> near;  ///< the coarse nodes that may reach nodes here, by number
    std::vector<std::uint32_t> own;   ///< which of these are this rank's, by their places
    std::vector<std::uint32_t> order; ///< the numbers of those of all ranks, one rank's behind the other's

    explicit CoarseOverRanks(Backend const& backend) : halo(backend), at_(backend), may_reach_(backend) {}

    /// Finds the coarse nodes that matter here.
    template <class Grid, class Orders>
    void find(Backend const& backend, Grid& grid, Orders const& orders,
              std::vector<CoarseNode<d>> const& coarse)
    {
        std::vector<Coordinates<d>> at;
        at.reserve(coarse.size());
        for (auto const& node : coarse) at.push_back(node.at * int{coarsening});
        auto const nodes = halo.nodes(grid);
        at_.resize(at.size(), 0);
        at_.upload(0, at);
        may_reach_.resize(at.size(), 0);
        backend.for_each(at.size(), FindCoarseNearby<std::remove_const_t<decltype(nodes)>, d>{
                                        nodes, at_.data(), may_reach_.data()});
        std::vector<std::uint32_t> may_reach(at.size());
        may_reach_.download(0, may_reach);
        near.clear();
        own.clear();
        std::vector<std::uint32_t> numbers;
        for (std::uint32_t number = 0; number < coarse.size(); ++number) {
            bool const is_own = grid.rank_of(orders, at[number]) == backend.rank();
            if (!is_own && may_reach[number] == 0) continue;
            if (is_own) {
                own.push_back(static_cast<std::uint32_t>(near.size()));
                numbers.push_back(number);
            }
            near.push_back(number);
        }
        order = detail::of_all_ranks(backend, std::move(numbers));
    }

    /// Lets all ranks know what each found for its own coarse nodes: `of_near` are those near.
    template <class T>
    void share(Backend const& backend, Array<T> const& of_near, Array<T>& of_all) const
    {
        std::vector<T> here(near.size()), values;
        of_near.download(0, here);
        values.reserve(own.size());
        for (std::uint32_t const place : own) values.push_back(here[place]);
        values = detail::of_all_ranks(backend, std::move(values));
        here.resize(order.size());
        for (std::size_t i = 0; i < order.size(); ++i) here[order[i]] = values[i];
        of_all.upload(0, here);
    }

private:
    Array<Coordinates<d>> at_;
    Array<std::uint32_t> may_reach_;
};

} // namespace firn
