// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/grid.hpp>
#include <firn/cuda/parts_of_tiles.hpp>
#include <firn/distributed/grid.hpp>
#include <firn/distributed/near_ranks.hpp>
#include <firn/grid/lattice.hpp>
#include <firn/grid/listed_nodes.hpp>

#include <cstdint>
#include <vector>

// Single nodes of a grid of which several devices have parts.
namespace firn::distributed
{

template <class Number, int d, int degree_, int sums, int values, int layers, bool own_values, int ungathered>
struct BlocksOf<cuda::Grid<Number, d, degree_, sums, values, layers, own_values, ungathered>>
{
    using GridType = cuda::Grid<Number, d, degree_, sums, values, layers, own_values, ungathered>;
    static constexpr int degree = degree_;
    static int extent(int) { return GridType::Shape::extent; }
    static Coordinates<d> block(Coordinates<d> node)
    {
        for (int a = 0; a < d; ++a) node[a] = (node[a] + GridType::reach) >> GridType::Shape::bits;
        return node;
    }
};

/// What a rank has of the nodes of a block, by the kind of the block.
__host__ __device__ inline NodeShare share_of_kind(unsigned char kind)
{
    namespace of = cuda::detail::kind_of_nodes;
    return (kind & of::own) != 0      ? NodeShare::results
           : (kind & of::others) != 0 ? NodeShare::values
                                      : NodeShare::none;
}

/// What a rank has of nodes by their indices, `cells` of them in each block.
template <int cells>
struct SharesOfNodes
{
    unsigned char const* kind; ///< of each block
    __device__ NodeShare operator()(std::uint32_t index) const { return share_of_kind(kind[index / cells]); }
};
/// The same for the host.
template <int cells>
struct SharesOnHost
{
    std::vector<unsigned char> kind;
    NodeShare operator()(std::uint32_t index) const { return share_of_kind(kind[index / cells]); }
};

} // namespace firn::distributed
