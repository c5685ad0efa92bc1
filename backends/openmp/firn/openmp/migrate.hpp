// SPDX-License-Identifier: MIT
#pragma once

#include <firn/core/lane.hpp>
#include <firn/openmp/compress.hpp>
#include <firn/openmp/for_each_group.hpp>
#include <firn/openmp/items.hpp>
#include <firn/openmp/scatter.hpp>
#include <firn/openmp/tile_rows.hpp>
#include <firn/openmp/tuning.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <numeric>
#include <span>

// How leavers scatter in their new cells, from lists that are sorted by cell.
namespace firn::openmp
{

namespace detail
{
/// Copies the contributions of a group's items, listed cell by cell, to where a group of cells expects them:
/// rank by rank.
template <int channels, class Lane, int d, class Leaver>
void copy_contributions(Leaver const* leavers, std::uint32_t const* counts, Scratch<Lane, d>& scratch)
{
    using Number = ScalarOf<Lane>;
    constexpr int lanes = lane_width<Lane>;
    std::uint32_t first[std::size_t(lanes)];
    std::exclusive_scan(counts, counts + lanes, first, std::uint32_t(0));
    std::size_t item = 0;
    for (std::uint32_t rank = 0;; ++rank) {
        std::uint64_t pattern = lanes_above<lanes>(counts, rank);
        if (pattern == 0) break;
        for (; pattern != 0; pattern &= pattern - 1, ++item) {
            Number const* const contribution = leavers[first[std::countr_zero(pattern)] + rank].contribution;
            for (int c = 0; c < channels; ++c) *scratch.at(c, item) = contribution[c];
        }
    }
}

/// Scatters listed items, in the order of their cells, to the tile of their block.
template <class Lane, class Scatter, class Layer, class Leaver>
void scatter_listed(std::span<Leaver const> leavers, Layer const&, typename Scatter::Number* tile,
                    std::uint64_t& touched, ScatterBuffers<Lane, Scatter>& buffers)
{
    auto& [scratch, spreads] = buffers;
    using Shape = typename Layer::Shape;
    constexpr int lanes = lane_width<Lane>;
    if (leavers.empty()) return;
    std::array<std::uint32_t, Shape::cells> counts;
    counts.fill(0);
    for (auto const& leaver : leavers) ++counts[leaver.place];
    std::array<std::size_t, Shape::groups> of_group;
    std::size_t filled = 0;
    std::uint64_t rows = 0;
    for (int g = 0; g < Shape::groups; ++g) {
        std::uint32_t const* const count = &counts[std::size_t(g * lanes)];
        of_group[std::size_t(g)] = std::accumulate(count, count + lanes, std::size_t(0));
        if (of_group[std::size_t(g)] == 0) continue;
        rows |= Layer::touched_by(count, g);
        ++filled;
    }
    clear_rows<Layer, Scatter::channels>(tile, rows & ~touched);
    touched |= rows;

    auto const* next = leavers.data();
    if constexpr (may_go_alone<Layer::dimension, lanes>)
        if (go_alone((leavers.size() + lanes - 1) / lanes, filled)) {
            scratch.reserve(Scatter::scratch_channels, lanes);
            for (auto const* const end = next + leavers.size(); next < end; next += lanes) {
                int const count = static_cast<int>(std::min<std::ptrdiff_t>(lanes, end - next));
                int places[std::size_t(lanes)];
                for (int l = 0; l < count; ++l) {
                    places[l] = next[l].place;
                    for (int c = 0; c < Scatter::scratch_channels; ++c)
                        *scratch.at(c, std::size_t(l)) = next[l].contribution[c];
                }
                ScatteredItems<Lane, Layer> items(places, count, scratch, nullptr, tile);
                scatter<Scatter>(items, spreads);
            }
            return;
        }
    for (int g = 0; g < Shape::groups; next += of_group[std::size_t(g++)]) {
        if (of_group[std::size_t(g)] == 0) continue;
        std::uint32_t const* const count = &counts[std::size_t(g * lanes)];
        scratch.reserve(Scatter::scratch_channels, of_group[std::size_t(g)]);
        copy_contributions<Scatter::scratch_channels>(next, count, scratch);
        GroupOf<Lane, Layer> group(count, g, scratch, 0, nullptr, tile);
        scatter<Scatter>(group, spreads);
    }
}
} // namespace detail

/// Completes the order of cells if needed, and the sums: items in the cells where they stayed have scattered
/// already; the leavers scatter where they are now.
template <class Lane, class Phase, class Order, class GridType>
void scatter_leavers(Order& cells, GridType& grid)
{
    using ScatterBuffers = detail::ScatterBuffers<Lane, typename Phase::Scatter>;
    cells.complete([&](int thread) {
        return [&, &buffers = cells.workspace().template of<ScatterBuffers>(thread)](int b) {
            detail::scatter_listed<Lane, typename Phase::Scatter>(cells.leavers(std::size_t(b)), grid,
                                                                  grid.tile(std::size_t(b)),
                                                                  grid.touched(std::size_t(b)), buffers);
        };
    });
}

} // namespace firn::openmp
