// SPDX-License-Identifier: MIT
#pragma once

#include <firn/distributed/communicator.hpp>
#include <firn/distributed/parcel.hpp>
#include <firn/grid/block_key.hpp>
#include <firn/grid/lattice.hpp>

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

// What one rank tells those nearby of single nodes, so that each finds for itself what depends on them.
namespace firn::distributed
{

/// The blocks of nodes of a grid, which are as large as those of cells.
template <class GridType>
struct BlocksOf
{
    static constexpr int degree = GridType::row_length - GridType::Shape::along; ///< of stencils
    static int extent(int axis) { return GridType::Shape::extent(axis); }
    static auto block(Coordinates<GridType::dimension> const& node)
    {
        return GridType::block_and_place(node).first;
    }
};

/// The other ranks that may have cells whose stencils reach so many nodes near to a block of nodes.
template <class GridType, class Order, int d>
std::vector<std::size_t> ranks_near(Order const& order, Coordinates<d> const& block, int distance)
{
    constexpr double most = 4096; // blocks to look at; beyond it all ranks are near
    auto const own = static_cast<std::size_t>(order.communicator().rank());
    Coordinates<d> low, width;
    double count = 1;
    for (int a = 0; a < d; ++a) { // cells stand before their nodes by up to the degree of the kernel
        int const extent = BlocksOf<GridType>::extent(a), before = distance + BlocksOf<GridType>::degree;
        low[a] = -((before + extent - 1) / extent);
        width[a] = (distance + extent - 1) / extent - low[a] + 1;
        count *= width[a];
    }
    std::vector<char> is_near(static_cast<std::size_t>(order.communicator().size()), count > most ? 1 : 0);
    if (count <= most)
        for (int step = 0; step < static_cast<int>(count); ++step) {
            Coordinates<d> at = block + low;
            for (int a = 0, rest = step; a < d; rest /= width[a++]) at[a] += rest % width[a];
            is_near[static_cast<std::size_t>(order.owner(at))] = 1;
        }
    std::vector<std::size_t> ranks;
    for (std::size_t rank = 0; rank < is_near.size(); ++rank)
        if (is_near[rank] != 0 && rank != own) ranks.push_back(rank);
    return ranks;
}

/// Sends what this rank says of some nodes to all ranks with cells whose stencils reach so near to them.
/// Returns what came from others; `node_of(value)` is the node that a value is about.
template <class GridType, class Order, class T, class NodeOf>
std::vector<T> exchange_near(Order const& order, std::vector<T> const& own, int distance,
                             NodeOf const& node_of)
{
    std::vector<Parcel> to(static_cast<std::size_t>(order.communicator().size()));
    std::map<std::uint64_t, std::vector<std::size_t>> ranks_of; // by block of nodes
    for (T const& value : own) {
        auto const block = BlocksOf<GridType>::block(node_of(value));
        auto const [at, is_new] = ranks_of.try_emplace(block_key<block.RowsAtCompileTime>(block));
        if (is_new) at->second = ranks_near<GridType>(order, block, distance);
        for (std::size_t const rank : at->second) put(to[rank], value);
    }
    std::vector<T> all;
    for (Parcel const& of_rank : order.communicator().exchange(to))
        for (Reader from(of_rank); !from.at_end();) all.push_back(from.template get<T>());
    return all;
}

} // namespace firn::distributed
