// SPDX-License-Identifier: MIT
#pragma once

#include <firn/cuda/block_set.hpp>
#include <firn/cuda/teams.hpp>
#include <firn/cuda/tuning.hpp>

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>

// What loops over blocks have in shared memory: node values that are read, and sums that are added to.
namespace firn::cuda::detail
{

/// The tiles of one block of cells in shared memory: node values, and for each team the sums of the block's
/// two groups.
template <class GridType>
struct SharedTiles
{
    using Tile = typename GridType::TileShape;
    using Shape = typename GridType::Shape;
    using Sums = typename GridType::Sums;
    using Values = typename GridType::Values;
    static constexpr int d = GridType::corners == 8 ? 3 : 2;

    static constexpr std::size_t bytes(bool reads, bool adds, unsigned teams = 1)
    {
        constexpr std::size_t values =
            ((Tile::nodes + 1) * sizeof(Values) + 15) / 16 * 16; // sums are aligned to 16 bytes
        return (reads ? values : 0) + (adds ? teams * 2 * Tile::group_nodes * sizeof(Sums) : 0);
    }

    /// How many teams scatter the items that came into a block, in a scene of so many blocks: together as
    /// many threads as a large device runs at once, within the shared memory that every device has. The
    /// number is the same on every device, since sums are added up team by team.
    static constexpr unsigned teams_that_rebin(std::uint32_t blocks)
    {
        unsigned teams = most_teams_that_rebin;
        while (teams > 1 && (teams * blocks > 1024 || bytes(false, true, teams) > unasked_shared)) teams /= 2;
        return teams;
    }

    Values* values;
    Sums* sums; ///< of both groups, one after the other, team by team

    __device__ SharedTiles(unsigned char* memory, bool reads)
        : values(reinterpret_cast<Values*>(memory)),
          sums(reinterpret_cast<Sums*>(memory + bytes(reads, false)))
    {}

    __device__ void clear_sums() const
    {
        int const teams = int(blockDim.x / block_threads);
        for (int n = int(threadIdx.x); n < teams * 2 * Tile::group_nodes; n += int(blockDim.x))
            sums[n] = Sums{};
    }

    /// Where the stencil of the thread's cell begins in the sums of its group and team.
    __device__ Sums* own_sums(int place) const
    {
        int const group = place / Shape::lanes, team = int(threadIdx.x / block_threads);
        return sums + team * 2 * Tile::group_nodes + group * (Tile::group_nodes - Tile::group_offset) +
               Tile::at(Shape::cell(place));
    }

    /// Adds the sums of both groups to the block's tile, team by team.
    __device__ void add_sums(Sums* tile, unsigned teams = 1) const
    {
        constexpr int at_once = 4; // independent loads: otherwise each would wait for the one before
        int const threads = int(teams * block_threads);
        for (int first = int(threadIdx.x); first < Tile::nodes; first += at_once * threads) {
            Sums sum[at_once];
#pragma unroll
            for (int i = 0; i < at_once; ++i)
                if (int const n = first + i * threads; n < Tile::nodes) sum[i] = tile[n];
#pragma unroll
            for (int i = 0; i < at_once; ++i)
                if (int const n = first + i * threads; n < Tile::nodes) {
                    plus_teams(sum[i], n, teams);
                    tile[n] = sum[i];
                }
        }
    }

    /// Loads the node values under a block of cells, relative to the value of one node, which is stored
    /// behind them: so weights, which add up to one but for rounding, do not round what all nodes have in
    /// common. That node lies amid the stencil of this cell of the block. The cell must have items, or the
    /// node may have no mass, and then its value is zero.
    __device__ void read_values(typename GridType::View const& grid, std::uint32_t block, int cell) const
    {
        Coordinates<d> amid = Shape::cell(cell);
        for (int a = 0; a < d; ++a) amid[a] += (Tile::width - Shape::extent + 1) / 2;
        Values const reference = value_at(grid, block, amid);
        if (threadIdx.x == 0) values[Tile::nodes] = reference;
        for (int n = int(threadIdx.x); n < Tile::nodes; n += int(blockDim.x)) {
            Coordinates<d> node;
            if (!Tile::node_at(n, node)) continue;
            Values value = value_at(grid, block, node);
#pragma unroll
            for (int c = 0; c < Values::stored; ++c) value.of[c] -= reference.of[c];
            values[n] = value;
        }
    }

    /// Adds all channels of a node.
    __device__ static void plus(Sums& sum, Sums const& other)
    {
#pragma unroll
        for (int c = 0; c < Sums::stored; ++c) sum.of[c] += other.of[c];
    }

private:
    /// The values of a node under a block of cells.
    __device__ static Values const& value_at(typename GridType::View const& grid, std::uint32_t block,
                                             Coordinates<d> const& node)
    {
        std::uint32_t corner = 0;
        int at = 0;
        for (int a = 0; a < d; ++a) {
            corner = 2 * corner + static_cast<std::uint32_t>(node[a] >> Shape::bits);
            at = at * Shape::extent + (node[a] & (Shape::extent - 1));
        }
        std::uint32_t const nodes = grid.nodes_of[block * GridType::corners + corner];
        assert(nodes != absent && "a block of cells has its nodes");
        return grid.node_values[std::size_t(nodes) * Shape::cells + static_cast<std::size_t>(at)];
    }

    /// Adds the sums of both groups of each team at one node of the tile.
    __device__ void plus_teams(Sums& sum, int n, unsigned teams) const
    {
        for (unsigned team = 0; team < teams; ++team) {
            Sums const* const of_team = sums + int(team) * 2 * Tile::group_nodes;
            if (n < Tile::group_nodes) plus(sum, of_team[n]);
            if (n >= Tile::group_offset) plus(sum, of_team[Tile::group_nodes + n - Tile::group_offset]);
        }
    }
};

} // namespace firn::cuda::detail
