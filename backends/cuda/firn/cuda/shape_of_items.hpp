// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/cell_work.hpp>
#include <firn/cuda/migration.hpp>
#include <firn/cuda/shared_tiles.hpp>
#include <firn/cuda/teams.hpp>

#include <algorithm>
#include <cstddef>
#include <cstdint>

// How many threads work on the items of a block of cells, and what lies where in their shared memory: see
// items_of_block.hpp.
namespace firn::cuda::detail
{

/// What a phase needs of a group of threads that works on the items of a block.
template <class GridType, class Phase>
struct ShapeOfItems
{
    static constexpr int d = Phase::d;
    using Number = typename GridType::Number;
    using Tile = typename GridType::TileShape;
    using Shape = typename GridType::Shape;
    using Sums = typename GridType::Sums;
    static constexpr bool gathers = Phase::work.gathers, moves = Phase::work.moves,
                          scatters = Phase::work.scatters_to != ScatterTarget::nothing;

    /// The places of a stencil along its first axis.
    static constexpr unsigned width = [] {
        if constexpr (scatters) return unsigned(Phase::Scatter::width);
        return 2u;
    }();
    /// How many of these are one layer, whose sums a thread has in its registers. In the plane all are, if
    /// they take few registers, so that each item is read once. In space one is: with fewer threads for a
    /// block, shared memory for its items would limit how many of them run at once.
    static constexpr unsigned depth = [] {
        if constexpr (scatters && d == 2) {
            std::size_t const sums = std::size_t(Phase::Scatter::width * Phase::Scatter::rows) *
                                     std::size_t(Phase::Scatter::channels) * sizeof(Number);
            if (sums <= 64 * sizeof(std::uint32_t)) return unsigned(Phase::Scatter::width);
        }
        return 1u;
    }();
    static constexpr unsigned layers = width / depth;
    static constexpr unsigned team_threads = layers * block_threads;
    /// Whether a thread needs many registers: for values that are held across a call, or numbers in double
    /// precision, which need two each.
    static constexpr bool holds_much = [] {
        if constexpr (moves) return sizeof(Number) > sizeof(float) || Phase::calls_amid_much;
        return false;
    }();
    /// Whether the results of a warp are so long, as those of some fifty obstacles are, that those of the
    /// largest group would not fit into the memory that a loop may declare.
    static constexpr bool has_long_results = moves && sizeof(typename Phase::Result) > 2560;
    /// Where there are few blocks, at most so many teams share the items of a block: a thread has one or two
    /// items to gather then, in a block of eight per cell, or one of four in the plane. A loop for them is
    /// compiled by itself, since so many threads have fewer registers each, and a group of one team has to
    /// leave room for others.
    static constexpr unsigned most_threads = d == 2 ? 256 : holds_much || has_long_results ? 384 : 576;
    static constexpr unsigned most_teams = std::max(1u, most_threads / team_threads);
    /// Groups of one team that must fit on a multiprocessor in the loop that moves items: this leaves 80
    /// registers per thread, 100 with a linear kernel in space, or 168. With more of them and fewer threads
    /// the loop is slower, although the compiler spills some.
    static constexpr unsigned registers = holds_much ? 168 : layers == 2 ? 100 : 80;
    static constexpr unsigned groups = std::max(1u, 65536 / registers / team_threads);

    static constexpr std::size_t aligned(std::size_t bytes) { return (bytes + 15) / 16 * 16; }
    /// The shared memory of all but contributions, if chunks have so many items [bytes].
    static constexpr std::size_t before_contributions(std::size_t items)
    {
        return SharedTiles<GridType>::bytes(gathers, false) +
               aligned((Shape::cells + 1) * sizeof(std::uint32_t)) + aligned(items) +
               (moves ? aligned(items * sizeof(std::uint32_t)) +
                            aligned((items / 32 + 1) * sizeof(std::uint32_t))
                      : 0) +
               (scatters ? aligned(Shape::cells + Shape::groups * sizeof(std::uint32_t)) : 0);
    }

    /// Whether threads leave their results in shared memory: unless they are many words, as those of several
    /// obstacles are. Then the loop declares memory for a result of each warp [bytes].
    static constexpr bool leaves_results = moves && sizeof(typename Phase::Result) <= 64;
    static constexpr std::size_t declared_results(unsigned teams)
    {
        if constexpr (moves && !leaves_results)
            return teams * team_threads / 32 * sizeof(typename Phase::Result);
        return 0;
    }
    /// Whether a group may have so much dynamic shared memory [bytes].
    static constexpr bool may_have(std::size_t bytes)
    {
        return bytes <= least_shared || bytes + declared_results(most_teams) <= most_shared;
    }

    /// The channels of what an item scatters.
    static constexpr int channels = [] {
        if constexpr (scatters) return int(Phase::Scatter::scratch_channels);
        return 0;
    }();
    /// The same in whole vectors: what lies in shared memory, and in a list of leavers.
    static constexpr int stored_channels = in_whole_vectors<Number>(channels);
    static constexpr std::uint32_t padding = 8; ///< a place is left free behind so many items
    /// How many items make a chunk: as many as lie in a block of eight per cell, unless some of its cells are
    /// crowded; fewer where they scatter much, so that as many groups fit as there are registers for.
    static constexpr std::uint32_t room = [] {
        constexpr std::size_t usual = (layers == 2 ? 37 : 43) * 1024;
        auto const fit = [](std::size_t items) {
            std::size_t const scattered = (items + items / padding) * stored_channels * sizeof(Number);
            return (scattered <= usual || groups <= 2) && may_have(before_contributions(items) + scattered);
        };
        std::uint32_t most = d == 3 ? 640 : 320;
        while (most > 64 && !fit(most)) most -= 64;
        return most;
    }();
    static constexpr int stride = int(room + room / padding);
    /// The nodes that belong to a layer of the stencils of cells that extend so far.
    static constexpr int nodes_of_layer(int extent) { return (extent + int(depth) - 1) * Tile::plane; }

    // Where what lies in shared memory begins [bytes].
    static constexpr std::size_t begins = SharedTiles<GridType>::bytes(gathers, false);
    static constexpr std::size_t places = begins + aligned((Shape::cells + 1) * sizeof(std::uint32_t));
    static constexpr std::size_t leavers = places + aligned(room);
    static constexpr std::size_t left = leavers + aligned(room * sizeof(std::uint32_t));
    static constexpr std::size_t contributions = before_contributions(room);
    static constexpr std::size_t by_count =
        contributions - aligned(Shape::cells + Shape::groups * sizeof(std::uint32_t));
    static constexpr bool has_room_for_tiles(int nodes)
    {
        return may_have(contributions + most_teams * layers * Shape::groups * unsigned(nodes) * sizeof(Sums));
    }
    /// Whether, if there is one team, one of the two warps of a layer works on the cells with more items than
    /// the mean, so that the other has no need to wait for these: its tile of sums is one of all cells, if
    /// there is room. Where there is but one layer this only lets its second warp wait.
    static constexpr bool divides_by_count =
        scatters && depth == 1 && has_room_for_tiles(nodes_of_layer(Shape::extent));
    /// Whether there is room for a tile of each warp's sums, or for one tile to which they add in turn.
    static constexpr bool has_tiles_of_warps =
        divides_by_count || has_room_for_tiles(nodes_of_layer(Shape::group_extent));
    static constexpr int nodes_of_warp(unsigned teams)
    {
        return nodes_of_layer(divides_by_count && teams == 1 ? Shape::extent : Shape::group_extent);
    }
    static constexpr std::size_t tiles(unsigned teams)
    {
        if (!scatters) return 0;
        return sizeof(Sums) * (has_tiles_of_warps
                                   ? teams * layers * Shape::groups * unsigned(nodes_of_warp(teams))
                                   : Tile::nodes);
    }
    /// The shared memory of a group of so many teams. What lies where contributions lay is the longest.
    static constexpr std::size_t bytes(unsigned teams = 1)
    {
        return contributions +
               std::max({std::size_t(stored_channels * stride) * sizeof(Number), tiles(teams),
                         leaves_results ? teams * team_threads * sizeof(typename Phase::Result) : 0});
    }

    /// How many teams share a block in a scene of so many blocks: the number is the same on every device,
    /// since sums are added up team by team.
    static constexpr unsigned teams(std::uint32_t blocks)
    {
        static_assert(bytes(most_teams) <= most_shared, "a block's items do not fit into shared memory");
        unsigned teams = most_teams;
        while (teams > 1 && teams * blocks > 1024) teams /= 2;
        return teams;
    }
};

} // namespace firn::cuda::detail
