// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/cuda/cell_group.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/teams.hpp>

#include <array>
#include <cstddef>
#include <cstdint>

// The loop over nodes: they add up the tiles that cover them, and are updated.
namespace firn::cuda::detail
{

/// Adds up the tiles of a layer that cover a node of a block; sets `any` if one of the sums is not zero.
/// Returns whether the layer has a block of cells that reaches the node's block.
template <class GridType, int d>
__device__ __forceinline__ bool add_tiles(typename GridType::Cover const& of, std::uint32_t n,
                                          Coordinates<d> const& here, typename GridType::Sums& sums,
                                          bool& any)
{
    using Shape = typename GridType::Shape;
    using Tile = typename GridType::TileShape;
    using Sums = typename GridType::Sums;
    std::uint32_t block[GridType::corners]; // loaded together: otherwise each would wait for the one before
    bool reached = false;
#pragma unroll
    for (int corner = 0; corner < GridType::corners; ++corner)
        block[corner] = of.covered_by[n * GridType::corners + static_cast<unsigned>(corner)];
#pragma unroll
    for (int corner = 0; corner < GridType::corners; ++corner) {
        Coordinates<d> at = here; // in the tile of a block that lies `corner` before this one
        bool covers = block[corner] != absent;
        reached = reached || covers;
#pragma unroll
        for (int a = 0; a < d; ++a) {
            at[a] += ((corner >> (d - 1 - a)) & 1) * Shape::extent;
            covers = covers && at[a] < Tile::width;
        }
        Sums more{};
        if (covers)
            more =
                of.tiles[std::size_t(block[corner]) * Tile::nodes + static_cast<std::size_t>(Tile::at(at))];
#pragma unroll
        for (int c = 0; c < Sums::stored; ++c) {
            sums.of[c] += more.of[c];
            any = any || more.of[c] != 0;
        }
    }
    return reached;
}

/// The same for all layers.
template <class GridType, int d>
__device__ __forceinline__ typename GridType::Sums
sum_of_tiles(typename GridType::View const& grid, std::uint32_t n, Coordinates<d> const& here, bool& any)
{
    typename GridType::Sums sums{};
#pragma unroll
    for (int layer = 0; layer < GridType::layers; ++layer)
        add_tiles<GridType, d>(grid.layer[layer], n, here, sums, any);
    return sums;
}

/// The block of a node, and the node's place in it.
template <class GridType, int d>
__device__ __forceinline__ std::uint32_t block_of(BlockSet::View const& blocks, Periods<d> const& periods,
                                                  Coordinates<d> const& node, Coordinates<d>& here)
{
    using Shape = typename GridType::Shape;
    Coordinates<d> block;
    for (int a = 0; a < d; ++a) {
        int const at = node[a] + GridType::reach;
        block[a] = at >> Shape::bits;
        here[a] = at & (Shape::extent - 1);
    }
    return blocks.find(block_key<d>(periods.wrapped(block)));
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
        Coordinates<d> here;
        std::uint32_t const n = block_of<GridType, d>(blocks_, grid_.periods, node, here);
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

/// The values of one node where they lie, since a phase keeps those that it does not set.
template <class GridType>
class ValuesInPlace
{
public:
    using Number = typename GridType::Number;

    __device__ ValuesInPlace(typename GridType::View const& grid, std::size_t i) : grid_(grid), i_(i) {}

    __device__ Number value(int channel) const { return grid_.value(i_, channel); }
    __device__ void set(int channel, Number value) const { grid_.value(i_, channel) = value; }

private:
    typename GridType::View const& grid_;
    std::size_t i_;
};

/// One node on a grid that has values which items do not gather.
template <class GridType, int d>
class NodeInPlace : public ValuesInPlace<GridType>
{
public:
    using Real = typename GridType::Number;

    __device__ NodeInPlace(ValuesInPlace<GridType> const& values, typename GridType::Sums const& sums,
                           Coordinates<d> const& at)
        : ValuesInPlace<GridType>(values), sums_(sums), at_(at)
    {}

    __device__ Real sum(int channel) const { return sums_.of[channel]; }
    __device__ Coordinates<d> first() const { return at_; }
    __device__ static Vector<Real, d> offset() { return Vector<Real, d>::Zero(); }

private:
    typename GridType::Sums const& sums_;
    Coordinates<d> at_;
};

/// The same of a node that reads the sums of others.
template <class GridType, int d>
class LoneNodeInPlace : public LoneNode<GridType, d>
{
public:
    using Real = typename GridType::Number;

    __device__ LoneNodeInPlace(ValuesInPlace<GridType> const& values, LoneNode<GridType, d> const& node)
        : LoneNode<GridType, d>(node), values_(values)
    {}

    __device__ Real value(int channel) const { return values_.value(channel); }
    __device__ void set(int channel, Real value) const { values_.set(channel, value); }

private:
    ValuesInPlace<GridType> values_;
};

/// Whether a node concerns a phase, if that says so.
template <class Phase, int d>
__device__ __forceinline__ bool concerns([[maybe_unused]] Phase const& phase,
                                         [[maybe_unused]] Coordinates<d> const& node)
{
    if constexpr (SaysWhichConcern<Phase>)
        return phase.template concerns<typename Phase::Number>(
            node, Vector<typename Phase::Number, d>(zeros<Vector<typename Phase::Number, d>>()));
    else
        return true;
}

/// Calls a phase for node i of all, in block n, whose values it reads and sets where they lie.
template <class GridType, class Phase, class Blocks, int d>
__device__ __forceinline__ void update_in_place(Phase const& phase, typename GridType::View const& grid,
                                                [[maybe_unused]] Blocks const& blocks, std::uint32_t n,
                                                std::size_t i, Coordinates<d> const& here,
                                                Coordinates<d> const& node, typename Phase::Result& result)
{
    bool any = AsksNoSums<Phase> || TakesZeroSums<Phase>;
    typename GridType::Sums sums{};
    if constexpr (!AsksNoSums<Phase>)
        if (concerns(phase, node)) sums = sum_of_tiles<GridType, d>(grid, n, here, any);
    ValuesInPlace<GridType> const values(grid, i);
    if constexpr (!KeepsValues<Phase>)
        for (int c = 0; c < GridType::values_count + GridType::ungathered; ++c) values.set(c, 0);
    if (!any) return; // nothing was added to it
    if constexpr (Phase::looks_around) {
        auto const walls = phase.walls();
        if (phase.looks_around_at(walls, node, 1)) {
            LoneNodeInPlace<GridType, d> lane(values, {grid, blocks, node});
            phase.look_around(walls, lane, result);
            return;
        }
    }
    NodeInPlace<GridType, d> lane(values, sums, node);
    phase(lane, result);
}

/// One node with the sums and values of each layer, for a phase that tells them apart.
template <class GridType, int d>
class NodeOfLayers
{
public:
    using Real = typename GridType::Number;

    /// The node at the place `here` of block n.
    __device__ NodeOfLayers(typename GridType::View const& grid, BlockSet::View const& blocks,
                            std::uint32_t n, Coordinates<d> const& here, Coordinates<d> const& at)
        : grid_(grid), blocks_(blocks), at_(at)
    {
        for (int layer = 0; layer < GridType::layers; ++layer) {
            bool any = false;
            sums_[layer] = {};
            if (add_tiles<GridType, d>(grid.layer[layer], n, here, sums_[layer], any))
                reached_ |= 1u << layer;
            if (any) has_ |= 1u << layer;
        }
    }

    __device__ bool has_any() const { return has_ != 0; }
    __device__ bool has(std::size_t layer) const { return (has_ >> layer & 1) != 0; }
    __device__ Real sum(std::size_t layer, int channel) const { return sums_[layer].of[channel]; }
    __device__ Real sum_beside(std::size_t layer, int channel, Coordinates<d> const& step, bool which) const
    {
        if (!which) return 0;
        Coordinates<d> here;
        std::uint32_t const n = block_of<GridType, d>(blocks_, grid_.periods, at_ + step, here);
        typename GridType::Sums sums{};
        bool any = false;
        if (n != absent) add_tiles<GridType, d>(grid_.layer[layer], n, here, sums, any);
        return sums.of[channel];
    }
    __device__ void set(std::size_t layer, int channel, Real value) { values_[layer].of[channel] = value; }
    __device__ Coordinates<d> first() const { return at_; }
    __device__ static Vector<Real, d> offset() { return Vector<Real, d>::Zero(); }

    /// Writes the values of all layers that reach the node's block, as node i of all.
    __device__ void write(std::size_t i) const
    {
        for (std::size_t layer = 0; layer < std::size_t(GridType::layers); ++layer)
            if ((reached_ >> layer & 1) != 0) grid_.values_of(layer)[i] = values_[layer];
    }

private:
    typename GridType::View const& grid_;
    BlockSet::View const& blocks_;
    Coordinates<d> at_;
    unsigned has_ = 0, reached_ = 0; ///< a bit for each layer
    typename GridType::Sums sums_[GridType::layers];
    typename GridType::Values values_[GridType::layers]{};
};

/// For phases that do not look around.
struct NoBlocks
{};

/// Nodes add up the tiles that cover them and are updated. `blocks` finds the blocks of other nodes that a
/// phase looks at. The loop also clears the incoming items of each layer's cells before new ones are listed.
/// `behind` is called once with the merged results, unless it is NothingBehind.
template <class GridType, class Phase, class Blocks, class Behind>
__global__ void __launch_bounds__(block_threads)
    for_each_node(Signal signal, Phase phase, typename GridType::View grid, Blocks blocks,
                  ResultsOfGroups<typename Phase::Result> results,
                  std::array<ArrivalsToForget, GridType::layers> to_forget, Behind behind)
{
    if (signal.stops()) return;
#pragma unroll
    for (int layer = 0; layer < GridType::layers; ++layer) to_forget[layer].forget(blockIdx.x);
    std::uint32_t const n = grid.block(blockIdx.x);
    if (!grid.shows(n)) return;
    using Shape = typename GridType::Shape;
    constexpr int d = Phase::d;
    Coordinates<d> here;
    int place = int(threadIdx.x);
    for (int a = d - 1; a >= 0; --a, place /= Shape::extent) here[a] = place % Shape::extent;

    Coordinates<d> const node = block_of_key<d>(grid.keys[n]) * int{Shape::extent} + here -
                                Coordinates<d>::Constant(int{GridType::reach});
    std::size_t const i = std::size_t(n) * Shape::cells + threadIdx.x;
    typename Phase::Result result{};
    if constexpr (TellsLayersApart<Phase>) {
        NodeOfLayers<GridType, d> lane(grid, blocks, n, here, node);
        if (lane.has_any()) phase(lane, result);
        lane.write(i);
    }
    else if constexpr (GridType::ungathered > 0)
        update_in_place<GridType>(phase, grid, blocks, n, i, here, node, result);
    else {
        bool any = TakesZeroSums<Phase>, alone = false;
        typename GridType::Sums sums{};
        if (concerns(phase, node)) sums = sum_of_tiles<GridType, d>(grid, n, here, any);
        typename GridType::Values& values = grid.node_values[i];
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
            NodeOfThread<GridType, d, KeepsValues<Phase>> lane(sums, values, node, i);
            if (any) phase(lane, result); // nothing was added to the others
            if (lane.are_new()) values = lane.values();
        }
    }
    __shared__ __align__(16) unsigned char parts[2 * sizeof(typename Phase::Result)];
    results.take(result, reinterpret_cast<typename Phase::Result*>(parts), n);
    if constexpr (!std::is_same_v<Behind, NothingBehind>) call_behind(results, behind);
}

} // namespace firn::cuda::detail
