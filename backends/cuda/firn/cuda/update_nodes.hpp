// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/teams.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// The loop over nodes: they add up the tiles that cover them, and are updated.
namespace firn::cuda::detail
{

/// Adds up the tiles that cover a node of a block; sets `any` if one of the sums is not zero.
template <class GridType, int d>
__device__ __forceinline__ typename GridType::Sums
sum_of_tiles(typename GridType::View const& grid, std::uint32_t n, Coordinates<d> const& here, bool& any)
{
    using Shape = typename GridType::Shape;
    using Tile = typename GridType::TileShape;
    using Sums = typename GridType::Sums;
    Sums sums{};
#pragma unroll
    for (int layer = 0; layer < GridType::layers; ++layer) {
        typename GridType::Cover const& of = grid.layer[layer];
        std::uint32_t
            block[GridType::corners]; // loaded together: otherwise each would wait for the one before
#pragma unroll
        for (int corner = 0; corner < GridType::corners; ++corner)
            block[corner] = of.covered_by[n * GridType::corners + static_cast<unsigned>(corner)];
#pragma unroll
        for (int corner = 0; corner < GridType::corners; ++corner) {
            Coordinates<d> at = here; // in the tile of a block that lies `corner` before this one
            bool covers = block[corner] != absent;
#pragma unroll
            for (int a = 0; a < d; ++a) {
                at[a] += ((corner >> (d - 1 - a)) & 1) * Shape::extent;
                covers = covers && at[a] < Tile::width;
            }
            Sums more{};
            if (covers)
                more = of.tiles[std::size_t(block[corner]) * Tile::nodes +
                                static_cast<std::size_t>(Tile::at(at))];
#pragma unroll
            for (int c = 0; c < Sums::stored; ++c) {
                sums.of[c] += more.of[c];
                any = any || more.of[c] != 0;
            }
        }
    }
    return sums;
}

/// One node that reads the sums of others.
template <class GridType, int d>
class LoneNode
{
public:
    using Real = typename GridType::Number;

    __device__ LoneNode(typename GridType::View const& grid, BlockSet::View const& blocks,
                        Coordinates<d> const& at)
        : grid_(grid), blocks_(blocks), at_(at)
    {}

    __device__ Coordinates<d> first() const { return at_; }
    __device__ static Vector<Real, d> offset() { return Vector<Real, d>::Zero(); }
    __device__ void set(int channel, Real value) { values_.of[channel] = value; }
    __device__ typename GridType::Values const& values() const { return values_; }

    /// The sums of the node `first` + `along`, the latter on the last axis; zeros if there is none.
    template <int channels>
    __device__ void sums_at(Coordinates<d> const& first, Real along, bool, Real (&found)[channels]) const
    {
        Coordinates<d> node = first;
        node[d - 1] += static_cast<int>(along);
        using Shape = typename GridType::Shape;
        Coordinates<d> block, here;
        for (int a = 0; a < d; ++a) {
            int const at = node[a] + GridType::reach;
            block[a] = at >> Shape::bits;
            here[a] = at & (Shape::extent - 1);
        }
        std::uint32_t const n = blocks_.find(block_key<d>(block));
        typename GridType::Sums sums{};
        bool any = false;
        if (n != absent) sums = sum_of_tiles<GridType, d>(grid_, n, here, any);
        for (int c = 0; c < channels; ++c) found[c] = sums.of[c];
    }

private:
    typename GridType::View const& grid_;
    BlockSet::View const& blocks_;
    typename GridType::Values values_{};
    Coordinates<d> at_;
};

/// For phases that do not look around.
struct NoBlocks
{};

/// Nodes add up the tiles that cover them and are updated. `blocks` finds the blocks of other nodes that a
/// phase looks at. The loop also clears the incoming items of each layer's cells before new ones are listed.
template <class GridType, class Phase, class Blocks>
__global__ void __launch_bounds__(block_threads)
    for_each_node(Signal signal, Phase phase, typename GridType::View grid, Blocks blocks,
                  ResultsOfGroups<typename Phase::Result> results,
                  std::array<ArrivalsToForget, GridType::layers> to_forget)
{
    if (signal.stops()) return;
#pragma unroll
    for (int layer = 0; layer < GridType::layers; ++layer) to_forget[layer].forget(blockIdx.x);
    using Shape = typename GridType::Shape;
    constexpr int d = Phase::d;
    Coordinates<d> here;
    int place = int(threadIdx.x);
    for (int a = d - 1; a >= 0; --a, place /= Shape::extent) here[a] = place % Shape::extent;

    bool any = false;
    typename GridType::Sums const sums = sum_of_tiles<GridType, d>(grid, blockIdx.x, here, any);
    Coordinates<d> const node = block_of_key<d>(grid.keys[blockIdx.x]) * int{Shape::extent} + here -
                                Coordinates<d>::Constant(int{GridType::reach});
    typename Phase::Result result{};
    typename GridType::Values& values =
        grid.node_values[std::size_t(blockIdx.x) * Shape::cells + threadIdx.x];
    bool alone = false;
    if constexpr (Phase::looks_around) {
        auto const walls = phase.walls();
        alone = phase.looks_around_at(walls, node, 1);
        if (alone) {
            LoneNode<GridType, d> lane(grid, blocks, node);
            if (any) phase.look_around(walls, lane, result);
            values = lane.values();
        }
    }
    if (!alone) {
        NodeOfThread<GridType, d> lane(sums, values, node);
        if (any) phase(lane, result); // nothing was added to the others
        values = lane.values();
    }
    __shared__ __align__(16) unsigned char parts[2 * sizeof(typename Phase::Result)];
    results.take(result, reinterpret_cast<typename Phase::Result*>(parts));
}

} // namespace firn::cuda::detail
